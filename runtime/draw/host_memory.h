// Host memory for pictures that are read back from a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace scree::runtime {

/// Memory with any contents, because clearing it can take longer than drawing.
class HostMemory {
 public:
  HostMemory() = default;

  /// Usual memory. Throws std::bad_alloc.
  static HostMemory plain(uint64_t bytes) {
    return {new std::byte[bytes], bytes, [](std::byte* memory) { delete[] memory; }};
  }
  /// Pinned memory, to which GPUs copy faster than to plain memory, and beside their other work. Plain memory if the
  /// system pins no more, and in a program without CUDA. Uses the current GPU. Throws std::bad_alloc.
  static HostMemory pinned(uint64_t bytes);

  std::span<std::byte> bytes() const { return {memory_.get(), bytes_}; }
  uint64_t size() const { return bytes_; }

 private:
  using Free = void (*)(std::byte*);
  HostMemory(std::byte* memory, uint64_t bytes, Free free) : memory_(memory, free), bytes_(bytes) {}

  std::unique_ptr<std::byte[], Free> memory_{nullptr, nullptr};
  uint64_t bytes_ = 0;
};

}  // namespace scree::runtime
