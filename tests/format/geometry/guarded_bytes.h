// Bytes that end at a page without access, so that a read or write of one byte too many ends the test.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <span>

namespace scree::tests {

class GuardedBytes {
 public:
  explicit GuardedBytes(size_t size) : size_(size) {
    const auto page = static_cast<size_t>(sysconf(_SC_PAGESIZE));
    const size_t usable = (size + page - 1) / page * page;
    map_bytes_ = usable + page;
    map_ = mmap(nullptr, map_bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (map_ == MAP_FAILED || mprotect(static_cast<std::byte*>(map_) + usable, page, PROT_NONE) != 0) std::abort();
    first_ = static_cast<std::byte*>(map_) + usable - size;
  }
  explicit GuardedBytes(std::span<const std::byte> copy) : GuardedBytes(copy.size()) {
    if (!copy.empty()) std::memcpy(first_, copy.data(), copy.size());
  }
  GuardedBytes(const GuardedBytes&) = delete;
  GuardedBytes& operator=(const GuardedBytes&) = delete;
  ~GuardedBytes() { munmap(map_, map_bytes_); }

  std::span<std::byte> bytes() { return {first_, size_}; }

 private:
  void* map_ = nullptr;
  size_t map_bytes_ = 0;
  std::byte* first_ = nullptr;
  size_t size_ = 0;
};

/// Address space that reads as zeros and takes memory only where it is written.
class SparseBytes {
 public:
  explicit SparseBytes(size_t size) : size_(size) {
    map_ = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  }
  SparseBytes(const SparseBytes&) = delete;
  SparseBytes& operator=(const SparseBytes&) = delete;
  ~SparseBytes() {
    if (map_ != MAP_FAILED) munmap(map_, size_);
  }

  /// False if the system grants no such address range.
  explicit operator bool() const { return map_ != MAP_FAILED; }
  std::span<std::byte> bytes() { return {static_cast<std::byte*>(map_), size_}; }

 private:
  void* map_ = nullptr;
  size_t size_ = 0;
};

}  // namespace scree::tests
