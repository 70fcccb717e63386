// A vector whose new elements are left uninitialised, for large arrays that are filled at once.
#pragma once

#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace scree::convert {

template <class T>
struct RawAllocator : std::allocator<T> {
  template <class U>
  struct rebind {
    using other = RawAllocator<U>;
  };
  template <class U, class... Values>
  void construct(U* at, Values&&... values) {
    if constexpr (sizeof...(Values) == 0) {
      ::new (static_cast<void*>(at)) U;
    } else {
      ::new (static_cast<void*>(at)) U(std::forward<Values>(values)...);
    }
  }
};

template <class T>
using RawVector = std::vector<T, RawAllocator<T>>;

}  // namespace scree::convert
