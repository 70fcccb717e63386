// Structures of the C API. Each begins with its size in the version of scree.h with which the caller was compiled.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "library/status.h"

namespace scree::library {

constexpr size_t kMostStructBytes = 4096;  // in any version; a larger size comes from an uninitialised field

/// Checks that a T may have this size in some version of scree. `name`: the type, for the message.
template <class T>
scree_status check_size(size_t size, const char* name) {
  static_assert(sizeof(T) >= 2 * sizeof(size_t) && sizeof(T) <= kMostStructBytes && alignof(T) == alignof(size_t));
  if (size >= 2 * sizeof(size_t) && size <= kMostStructBytes && size % alignof(T) == 0) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT, std::string(name) + "::size is " + std::to_string(size) + ", expected sizeof(" +
                                        name + "), " + std::to_string(sizeof(T)));
}

/// Copies `in` to `out`. Fields that the caller's version lacks are 0. If `in` is null, all fields are 0.
template <class T>
scree_status take(const T* in, T& out, const char* name) {
  std::memset(&out, 0, sizeof out);
  out.size = sizeof out;
  if (in == nullptr) return SCREE_OK;
  SCREE_CHECK(check_size<T>(in->size, name));
  const auto* const bytes = reinterpret_cast<const std::byte*>(in);
  if (in->size > sizeof(T)) {
    const bool is_known =
        std::all_of(bytes + sizeof(T), bytes + in->size, [](std::byte byte) { return byte == std::byte{0}; });
    if (!is_known)
      return fail(SCREE_ERROR_ARGUMENT, std::string(name) + " has fields set that this version of scree lacks");
  }
  std::memcpy(&out, in, std::min(in->size, sizeof(T)));
  return SCREE_OK;
}

/// Checks a field of an enum whose values are 0 to `most`. A caller may store any integer in it, so it must not be read
/// as an enum before.
template <class Enum>
scree_status check_value(const Enum& value, Enum most, const char* field) {
  int32_t number;
  std::memcpy(&number, &value, sizeof number);
  if (number >= 0 && number <= static_cast<int32_t>(most)) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT,
              std::string(field) + " is " + std::to_string(number) + ", expected 0 to " + std::to_string(most));
}

/// Checks that `out` is not null and that its size is one of a T.
template <class T>
scree_status check_output(const T* out, const char* name) {
  if (out == nullptr) return fail(SCREE_ERROR_ARGUMENT, std::string("the ") + name + " to fill in is null");
  return check_size<T>(out->size, name);
}

/// Copies `value` to `out`, up to the size of `out`. `out->size` stays the same.
template <class T>
void give(T* out, T value) {
  value.size = out->size;
  std::memcpy(out, &value, std::min(out->size, sizeof(T)));
}

}  // namespace scree::library
