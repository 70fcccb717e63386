#include "library/status.h"

#include <algorithm>
#include <cstring>
#include <iterator>

namespace scree::library {
namespace {

thread_local char last_error[2048] = "";

}  // namespace

scree_status fail(scree_status status, std::string_view text) noexcept {
  size_t bytes = std::min(text.size(), sizeof last_error - 1);
  // A cut text ends with a whole character of UTF-8.
  for (int i = 0; i < 3 && bytes > 0 && bytes < text.size() && (text[bytes] & 0xc0) == 0x80; ++i) --bytes;
  std::memmove(last_error, text.data(), bytes);
  last_error[bytes] = 0;
  // Names in the text may contain line ends.
  std::replace_if(
      last_error, last_error + bytes, [](char c) { return (c >= 0 && c < ' ') || c == 0x7f; }, ' ');
  return status;
}

scree_status status_of(ErrorCode code, Subject subject) {
  switch (code) {
    case ErrorCode::kUsage:
      return SCREE_ERROR_ARGUMENT;
    case ErrorCode::kFile:
      return SCREE_ERROR_FILE;
    case ErrorCode::kDevice:
      return SCREE_ERROR_DEVICE;
    case ErrorCode::kMemory:
      return SCREE_ERROR_MEMORY;
    case ErrorCode::kRange:
    case ErrorCode::kUnsupported:
      return subject == Subject::kArguments ? SCREE_ERROR_ARGUMENT : SCREE_ERROR_DATA;
    default:
      return SCREE_ERROR_DATA;
  }
}

}  // namespace scree::library

extern "C" {

const char* scree_version(void) {
  return SCREE_LIBRARY_VERSION;
}

uint32_t scree_api_version(void) {
  return SCREE_API_VERSION;
}

const char* scree_error(void) {
  return scree::library::last_error;
}

const char* scree_status_name(scree_status status) {
  constexpr const char* kNames[] = {"SCREE_OK",
                                    "SCREE_ERROR_ARGUMENT",
                                    "SCREE_ERROR_FILE",
                                    "SCREE_ERROR_DATA",
                                    "SCREE_ERROR_DEVICE",
                                    "SCREE_ERROR_MEMORY",
                                    "SCREE_ERROR_HANDLE",
                                    "SCREE_ERROR_BUFFER",
                                    "SCREE_ERROR_NO_FRAME",
                                    "SCREE_ERROR_CANCELLED",
                                    "SCREE_ERROR_INTERNAL"};
  static_assert(std::size(kNames) == SCREE_ERROR_INTERNAL + 1);
  return kNames[std::min<size_t>(static_cast<size_t>(status), SCREE_ERROR_INTERNAL)];
}

}  // extern "C"
