// Parses values on the command line: sizes in bytes, lengths in model units, numbers and picture sizes.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "format/result.h"

namespace scree::tools {

/// Moves the value of `from`, or returns its error. Between whole numbers the value must fit `to`.
template <class T, class U>
Result<void> assign(T& to, Result<U> from) {
  if (!from) return from.error();
  to = static_cast<T>(std::move(*from));
  return {};
}

/// Bytes from "1234", "64KiB", "1.5 GiB", "2GB". KiB, MiB, GiB, TiB are powers of 1024; kB, MB, GB, TB powers of 1000.
/// Case does not matter. Errors kUsage: not a number, an unknown unit, negative, past 2^63.
Result<uint64_t> parse_size(std::string_view text);
/// The same for `option`, which the message names. `otherwise`: the value of an empty text.
Result<uint64_t> parse_size(std::string_view text, std::string_view option, uint64_t otherwise);

/// Model units from "1e-3", "0.5mm", "2 cm"; a glTF unit is one metre (um, mm, cm, m, km, in, ft). Positive and finite.
/// Errors kUsage.
Result<double> parse_length(std::string_view text);

/// An integer in [lowest, highest]. Errors kUsage; `what`: the option, for the message.
Result<uint64_t> parse_whole(std::string_view text, uint64_t lowest, uint64_t highest, std::string_view what);

/// Sets `out` to the value that `choices` name `text`. Errors kUsage: "--grid: 'cell' is not one of mesh, scene".
template <class Value>
Result<void> parse_choice(std::string_view text, std::string_view option, Value& out,
                          std::initializer_list<std::pair<std::string_view, std::type_identity_t<Value>>> choices) {
  std::string names;
  for (const auto& [name, value] : choices) {
    if (name == text) {
      out = value;
      return {};
    }
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return Error{ErrorCode::kUsage, std::string(option) + ": '" + std::string(text) + "' is not one of " + names};
}

/// The largest value of options without a limit of their own.
inline constexpr uint64_t kMostWhole = std::numeric_limits<uint32_t>::max();

inline constexpr uint64_t kMostThreads = 4096;

/// A number of threads up to kMostThreads. 0 means one per processor. Errors kUsage.
Result<uint32_t> parse_threads(std::string_view text);

/// "812 bytes", "1.46 MiB": three significant digits from a KiB on.
std::string format_bytes(uint64_t bytes);

/// Whether two paths refer to the same file, existing or not.
bool is_same_file(const std::string& a, const std::string& b);

/// A picture's size in pixels.
struct ImageSize {
  uint32_t width;
  uint32_t height;
};

/// "1920x1080" or "1920X1080", each side 1 to kernels::kMaxImageSide. Errors kUsage; `what`: the option that the
/// message names.
Result<ImageSize> parse_image_size(std::string_view text, std::string_view what);

/// "950", "12.4 k", "8.31 M", "1.64 G": three significant digits from a thousand on.
std::string format_count(double count);

}  // namespace scree::tools
