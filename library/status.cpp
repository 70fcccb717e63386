#include "library/status.h"

#include <algorithm>
#include <cstring>

namespace scree::library {
namespace {

thread_local char last_error[2048] = "";

}  // namespace

scree_status fail(scree_status status, std::string_view text) noexcept {
  const size_t bytes = std::min(text.size(), sizeof last_error - 1);
  std::memmove(last_error, text.data(), bytes);
  last_error[bytes] = 0;
  // Names in the text may have line ends.
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
  switch (status) {
    case SCREE_OK:
      return "SCREE_OK";
    case SCREE_ERROR_ARGUMENT:
      return "SCREE_ERROR_ARGUMENT";
    case SCREE_ERROR_FILE:
      return "SCREE_ERROR_FILE";
    case SCREE_ERROR_DATA:
      return "SCREE_ERROR_DATA";
    case SCREE_ERROR_DEVICE:
      return "SCREE_ERROR_DEVICE";
    case SCREE_ERROR_MEMORY:
      return "SCREE_ERROR_MEMORY";
    case SCREE_ERROR_HANDLE:
      return "SCREE_ERROR_HANDLE";
    case SCREE_ERROR_BUFFER:
      return "SCREE_ERROR_BUFFER";
    case SCREE_ERROR_NO_FRAME:
      return "SCREE_ERROR_NO_FRAME";
    case SCREE_ERROR_CANCELLED:
      return "SCREE_ERROR_CANCELLED";
    case SCREE_ERROR_INTERNAL:
    default:
      break;
  }
  return "SCREE_ERROR_INTERNAL";
}

}  // extern "C"
