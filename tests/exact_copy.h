// A copy of bytes for readers whose every access past the end must be found.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <new>
#include <span>

namespace scree::tests {

/// A copy in a heap block of exactly its size, aligned like a map, so that ASan detects every read past its end.
class ExactCopy {
 public:
  // Not inlined: at -O1, g++ 12 assumes that the size may be negative, and warns.
  [[gnu::noinline]] explicit ExactCopy(std::span<const std::byte> bytes, size_t size)
      : data_(static_cast<std::byte*>(::operator new(size, kAlignment))), size_(size) {
    const size_t copied = std::min(size, bytes.size());
    if (copied > 0) std::memcpy(data_, bytes.data(), copied);
    if (size > copied) std::memset(data_ + copied, 0, size - copied);
  }
  explicit ExactCopy(std::span<const std::byte> bytes) : ExactCopy(bytes, bytes.size()) {}
  ~ExactCopy() { ::operator delete(data_, kAlignment); }
  ExactCopy(const ExactCopy&) = delete;
  ExactCopy& operator=(const ExactCopy&) = delete;
  std::span<const std::byte> bytes() const { return {data_, size_}; }
  std::byte& operator[](size_t index) { return data_[index]; }

 private:
  static constexpr std::align_val_t kAlignment{64};
  std::byte* data_;
  size_t size_;
};

}  // namespace scree::tests
