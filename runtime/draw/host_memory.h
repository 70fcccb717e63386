// Host memory for pictures that are read back from a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

namespace scree::runtime {

/// Memory with any contents, because clearing it can take longer than drawing.
class HostMemory {
 public:
  HostMemory() = default;

  /// Usual memory. Throws std::bad_alloc.
  static HostMemory plain(uint64_t bytes) {
    std::shared_ptr<std::byte[]> memory(new std::byte[bytes]);
    std::byte* const data = memory.get();
    return {std::move(memory), data, bytes};
  }
  /// Pinned memory, to which GPUs copy faster than to plain memory, and beside their other work. Plain memory if the
  /// system pins no more, and in a program without CUDA. Uses the current GPU. Throws std::bad_alloc.
  static HostMemory pinned(uint64_t bytes);

  std::span<std::byte> bytes() const { return bytes_; }
  uint64_t size() const { return bytes_.size(); }

 private:
  HostMemory(std::shared_ptr<void> owner, std::byte* data, uint64_t bytes)
      : owner_(std::move(owner)), bytes_(data, bytes) {}

  std::shared_ptr<void> owner_;
  std::span<std::byte> bytes_;
};

}  // namespace scree::runtime
