// The results of the library's functions: a status, and one line of text for the calling thread.
#pragma once

#include <exception>
#include <new>
#include <string>
#include <string_view>

#include "format/result.h"
#include "include/scree/scree.h"

namespace scree::library {

/// Keeps `text` for scree_error() and returns `status`. Never throws; a long text is cut.
scree_status fail(scree_status status, std::string_view text) noexcept;

/// Checks that a path is not null and not empty. `name`: the function and its argument, for the message.
inline scree_status check_path(const char* path, const char* name) {
  if (path != nullptr && *path != 0) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT, std::string(name) + (path == nullptr ? " is null" : " is empty"));
}

/// The source of an Error. A number out of range is SCREE_ERROR_DATA in the file's data, and SCREE_ERROR_ARGUMENT in
/// the caller's arguments.
enum class Subject { kData, kArguments };

scree_status status_of(ErrorCode code, Subject subject);

inline scree_status fail(const Error& error, Subject subject) {
  return fail(status_of(error.code, subject), error.message);
}

/// Returns the status of the call from the enclosing function unless it is SCREE_OK.
#define SCREE_CHECK(call)                                \
  do {                                                   \
    const scree_status scree_checked = (call);           \
    if (scree_checked != SCREE_OK) return scree_checked; \
  } while (false)

/// Runs the body of a function of the library. Turns exceptions into a status.
template <class Body>
scree_status guarded(const Body& body) noexcept {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return fail(SCREE_ERROR_MEMORY, "out of memory");
  } catch (const std::exception& error) {
    return fail(SCREE_ERROR_INTERNAL, error.what());
  } catch (...) {
    return fail(SCREE_ERROR_INTERNAL, "an unknown exception");
  }
}

}  // namespace scree::library
