// The parts of the list of GPUs that need no CUDA.
#include "runtime/draw/device_list.h"

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdio>

#include "format/text.h"

namespace scree::runtime {
namespace {

bool is_index(std::string_view word) {
  return !word.empty() && std::all_of(word.begin(), word.end(), [](char c) { return c >= '0' && c <= '9'; });
}

std::string list_of(std::span<const Gpu> gpus) {
  std::string text;
  for (const Gpu& gpu : gpus)
    text += (text.empty() ? "" : ", ") + std::to_string(gpu.index) + " " + gpu.uuid + " (" + gpu.name + ")";
  return text;
}

}  // namespace

std::string uuid_name(std::span<const std::byte, 16> uuid) {
  std::string text = "GPU-";
  for (size_t i = 0; i < uuid.size(); ++i) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x", std::to_integer<unsigned>(uuid[i]));
    text += digits;
    if (i == 3 || i == 5 || i == 7 || i == 9) text += '-';
  }
  return text;
}

bool seems_to_have_gpu() {
  return access("/dev/nvidiactl", F_OK) == 0 || access("/proc/driver/nvidia", F_OK) == 0;
}

bool names_gpu(std::string_view word) {
  if (is_index(word)) return true;
  const std::string lower = format::lower_case(word);
  return lower.starts_with("gpu-") && lower.size() > 4 &&
         std::all_of(lower.begin() + 4, lower.end(), [](unsigned char c) { return std::isxdigit(c) != 0 || c == '-'; });
}

Result<Gpu> find_gpu(std::span<const Gpu> gpus, std::string_view which) {
  if (is_index(which)) {
    int index = 0;
    const auto [end, status] = std::from_chars(which.data(), which.data() + which.size(), index);
    if (status == std::errc{} && end == which.data() + which.size())
      for (const Gpu& gpu : gpus)
        if (gpu.index == index) return gpu;
    return Error{ErrorCode::kDevice, "no GPU " + std::string(which) + "; there is " + list_of(gpus)};
  }
  const std::string begin = format::lower_case(which);
  const Gpu* found = nullptr;
  for (const Gpu& gpu : gpus) {
    if (!format::lower_case(gpu.uuid).starts_with(begin)) continue;
    if (found != nullptr)
      return Error{ErrorCode::kDevice,
                   std::string(which) + " is the beginning of several GPUs' UUIDs; there is " + list_of(gpus)};
    found = &gpu;
  }
  if (found == nullptr)
    return Error{ErrorCode::kDevice, "no GPU " + std::string(which) + "; there is " + list_of(gpus)};
  return *found;
}

std::string architecture_names(std::string_view cmake_names) {
  std::string native;
  std::string portable;
  while (!cmake_names.empty()) {
    const size_t end = cmake_names.find(',');
    const std::string_view item = cmake_names.substr(0, end);
    cmake_names.remove_prefix(end == std::string_view::npos ? cmake_names.size() : end + 1);
    const size_t dash = item.find('-');
    const std::string_view number = item.substr(0, dash);
    const std::string_view kind = dash == std::string_view::npos ? "" : item.substr(dash + 1);
    size_t digits = 0;
    while (digits < number.size() && std::isdigit(static_cast<unsigned char>(number[digits])) != 0) ++digits;
    std::string name(number);
    if (digits >= 2) name.insert(digits - 1, ".");
    if (kind != "virtual") native += (native.empty() ? "" : ", ") + name;
    if (kind != "real") portable += (portable.empty() ? "PTX " : ", PTX ") + name;
  }
  return native + (native.empty() || portable.empty() ? "" : ", ") + portable;
}

std::string cuda_version_name(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

}  // namespace scree::runtime
