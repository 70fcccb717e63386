// Host memory of a view that others may hold beyond the view's next draw.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

namespace scree::runtime {

/// A vector whose elements others may hold. If they are held, resize() takes new memory, and the held memory stays at
/// its place.
template <class T>
class SharedBuffer {
 public:
  size_t size() const { return values_ ? values_->size() : 0; }
  T* data() { return values_ ? values_->data() : nullptr; }
  const T* data() const { return values_ ? values_->data() : nullptr; }
  T* begin() { return data(); }
  T* end() { return data() + size(); }
  const T* begin() const { return data(); }
  const T* end() const { return data() + size(); }
  T& operator[](size_t index) { return (*values_)[index]; }
  const T& operator[](size_t index) const { return (*values_)[index]; }

  /// New elements are 0. If the memory is held, all elements are. Throws std::bad_alloc.
  void resize(size_t count) {
    if (values_ && values_.use_count() == 1)
      values_->resize(count);
    else
      values_ = std::make_shared<std::vector<T>>(count);
  }

  std::shared_ptr<const void> hold() const { return values_; }

 private:
  std::shared_ptr<std::vector<T>> values_;
};

}  // namespace scree::runtime
