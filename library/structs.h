// Structures that cross the border: each begins with its caller's idea of its size.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <string>

#include "library/status.h"

namespace scree::library {

/// What `in` has of a T; fields that its caller does not know are 0. Null is all zeros. `name`: of the type.
template <class T>
scree_status take(const T* in, T& out, const char* name) {
  std::memset(&out, 0, sizeof out);
  out.size = sizeof out;
  if (in == nullptr) return SCREE_OK;
  if (in->size < 2 * sizeof(size_t))
    return fail(SCREE_ERROR_ARGUMENT, std::string(name) + "::size is " + std::to_string(in->size) +
                                          ", expected sizeof(" + name + "), " + std::to_string(sizeof(T)));
  const auto* const bytes = reinterpret_cast<const std::byte*>(in);
  if (in->size > sizeof(T)) {
    const bool is_known =
        std::all_of(bytes + sizeof(T), bytes + in->size, [](std::byte byte) { return byte == std::byte{0}; });
    if (!is_known)
      return fail(SCREE_ERROR_ARGUMENT, std::string(name) + " has fields that this version of scree does not know");
  }
  std::memcpy(&out, in, std::min(in->size, sizeof(T)));
  return SCREE_OK;
}

/// Whether `out` can be given a T.
template <class T>
scree_status check_output(const T* out, const char* name) {
  if (out == nullptr) return fail(SCREE_ERROR_ARGUMENT, std::string("the ") + name + " to fill in is null");
  if (out->size >= 2 * sizeof(size_t)) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT, std::string(name) + "::size is " + std::to_string(out->size) +
                                        ", expected sizeof(" + name + "), " + std::to_string(sizeof(T)));
}

/// Fills in what `out` has room for; its size stays.
template <class T>
void give(T* out, T value) {
  value.size = out->size;
  std::memcpy(out, &value, std::min(out->size, sizeof(T)));
}

}  // namespace scree::library
