// How the library's functions end: a status, and one line of text for the calling thread.
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

/// Whether a path is given. `name`: of the function and its argument.
inline scree_status check_path(const char* path, const char* name) {
  if (path != nullptr && *path != 0) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT, std::string(name) + (path == nullptr ? " is null" : " is empty"));
}

/// What was asked about when an Error came: a number out of range is the caller's, or the file's.
enum class Subject { kData, kArguments };

scree_status status_of(ErrorCode code, Subject subject);

inline scree_status fail(const Error& error, Subject subject) {
  return fail(status_of(error.code, subject), error.message);
}

/// The body of a function of the library: nothing is thrown past it.
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
