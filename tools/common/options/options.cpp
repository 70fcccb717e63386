#include "tools/common/options/options.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <thread>

#include "format/text.h"
#include "kernels/visbuffer.h"

namespace scree::tools {
namespace {

struct Unit {
  std::string_view name;  // lower case
  double factor;
};

struct Amount {
  double number;
  std::string unit;  // lower case
};

/// Splits "1.5 GiB". std::from_chars ignores the locale, so the decimal point is always a point.
bool split_amount(std::string_view text, Amount& out) {
  const char* end = text.data() + text.size();
  const auto [rest, status] = std::from_chars(text.data(), end, out.number);
  if (status != std::errc{} || !std::isfinite(out.number)) return false;
  std::string_view unit(rest, static_cast<size_t>(end - rest));
  while (!unit.empty() && unit.front() == ' ') unit.remove_prefix(1);
  out.unit = format::lower_case(unit);
  return true;
}

template <size_t N>
const Unit* find_unit(const std::array<Unit, N>& units, const std::string& name) {
  for (const Unit& unit : units)
    if (unit.name == name) return &unit;
  return nullptr;
}

Error usage(std::string_view text, const char* expected) {
  return {ErrorCode::kUsage, "'" + std::string(text) + "' is not " + expected};
}

constexpr double kKibi = 1024.0;
constexpr std::array<Unit, 14> kSizeUnits{{{"", 1},
                                           {"b", 1},
                                           {"k", kKibi},
                                           {"kib", kKibi},
                                           {"m", kKibi* kKibi},
                                           {"mib", kKibi* kKibi},
                                           {"g", kKibi* kKibi* kKibi},
                                           {"gib", kKibi* kKibi* kKibi},
                                           {"t", kKibi* kKibi* kKibi* kKibi},
                                           {"tib", kKibi* kKibi* kKibi* kKibi},
                                           {"kb", 1e3},
                                           {"mb", 1e6},
                                           {"gb", 1e9},
                                           {"tb", 1e12}}};
constexpr std::array<Unit, 8> kLengthUnits{
    {{"", 1}, {"um", 1e-6}, {"mm", 1e-3}, {"cm", 1e-2}, {"m", 1}, {"km", 1e3}, {"in", 0.0254}, {"ft", 0.3048}}};

std::string three_digits(double value, const char* unit) {
  char text[48];
  const int decimals = value < 9.995 ? 2 : value < 99.95 ? 1 : 0;
  std::snprintf(text, sizeof text, "%.*f %s", decimals, value, unit);
  return text;
}

}  // namespace

Result<uint64_t> parse_size(std::string_view text) {
  constexpr const char* kExpected = "a size such as 4096, 64KiB or 2GiB";
  Amount amount;
  if (!split_amount(text, amount)) return usage(text, kExpected);
  const Unit* unit = find_unit(kSizeUnits, amount.unit);
  if (unit == nullptr) return usage(text, kExpected);
  const double bytes = std::floor(amount.number * unit->factor);
  if (!(bytes >= 0 && bytes < 0x1p63)) return usage(text, "a size of 0 to 2^63 bytes");
  return static_cast<uint64_t>(bytes);
}

Result<uint64_t> parse_size(std::string_view text, std::string_view option, uint64_t otherwise) {
  if (text.empty()) return otherwise;
  return SCREE_TRY_AT(std::string(option), parse_size(text));
}

Result<double> parse_length(std::string_view text) {
  constexpr const char* kExpected = "a length such as 0.001, 0.5mm or 2cm";
  Amount amount;
  if (!split_amount(text, amount)) return usage(text, kExpected);
  const Unit* unit = find_unit(kLengthUnits, amount.unit);
  if (unit == nullptr) return usage(text, kExpected);
  const double length = amount.number * unit->factor;
  if (!(length > 0 && std::isfinite(length))) return usage(text, "a length above 0");
  return length;
}

Result<uint64_t> parse_whole(std::string_view text, uint64_t lowest, uint64_t highest, std::string_view what) {
  uint64_t value = 0;
  const char* end = text.data() + text.size();
  const auto [rest, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc{} || rest != end || value < lowest || value > highest)
    return Error{ErrorCode::kUsage, std::string(what) + ": '" + std::string(text) + "' is not a whole number of " +
                                        std::to_string(lowest) + " to " + std::to_string(highest)};
  return value;
}

Result<uint32_t> parse_threads(std::string_view text) {
  const uint64_t threads = SCREE_TRY(parse_whole(text, 0, kMostThreads, "--threads"));
  return threads != 0 ? static_cast<uint32_t>(threads) : std::max(1u, std::thread::hardware_concurrency());
}

Result<ImageSize> parse_image_size(std::string_view text, std::string_view what) {
  const size_t by = std::min(text.find_first_of("xX"), text.size());
  const Result<uint64_t> width = parse_whole(text.substr(0, by), 1, kernels::kMaxImageSide, what);
  const Result<uint64_t> height =
      parse_whole(text.substr(std::min(by + 1, text.size())), 1, kernels::kMaxImageSide, what);
  if (!width || !height)
    return Error{ErrorCode::kUsage, std::string(what) + ": '" + std::string(text) +
                                        "' is not WxH with each side 1 to " + std::to_string(kernels::kMaxImageSide)};
  return ImageSize{static_cast<uint32_t>(*width), static_cast<uint32_t>(*height)};
}

std::string format_bytes(uint64_t bytes) {
  if (bytes < 1024) return std::to_string(bytes) + " bytes";
  constexpr std::array<const char*, 4> kNames{"KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes) / kKibi;
  size_t name = 0;
  while (value >= 999.5 && name + 1 < kNames.size()) {
    value /= kKibi;
    ++name;
  }
  return three_digits(value, kNames[name]);
}

bool is_same_file(const std::string& a, const std::string& b) {
  std::error_code ignored;
  if (a == b || std::filesystem::equivalent(a, b, ignored)) return true;
  // Two files that do not exist yet are the same if they have the same name in the same folder.
  const std::filesystem::path path_a = a, path_b = b;
  const auto folder_of = [](const std::filesystem::path& path) {
    return path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  };
  return path_a.has_filename() && path_a.filename() == path_b.filename() &&
         std::filesystem::equivalent(folder_of(path_a), folder_of(path_b), ignored);
}

std::string format_count(double count) {
  if (count < 999.5) return std::to_string(static_cast<int64_t>(std::llround(count)));
  constexpr std::array<const char*, 4> kNames{"k", "M", "G", "T"};
  double value = count / 1e3;
  size_t name = 0;
  while (value >= 999.5 && name + 1 < kNames.size()) {
    value /= 1e3;
    ++name;
  }
  return three_digits(value, kNames[name]);
}

}  // namespace scree::tools
