// Unpacked windows of buffer views that are kept for the next read: the most recently used ones.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>

namespace scree::convert {

/// A part of a view. Its bytes are set once, under `mutex`, and are only read afterwards.
struct MeshoptWindow {
  std::mutex mutex;
  bool is_unpacked = false;            // and its filter undone
  std::unique_ptr<std::byte[]> bytes;  // `capacity` bytes
  size_t capacity = 0;
  size_t size = 0;

  std::span<std::byte> all() { return {bytes.get(), size}; }
};

/// Keeps windows of up to `most` bytes, including the overhead of each, but at least one window. A reader keeps its
/// window alive after the cache drops it. Thread-safe.
class KeptWindows {
 public:
  /// Overhead of a window: itself, its lock, its entries in the list and in the table.
  static constexpr uint64_t kEntryBytes = 256;

  explicit KeptWindows(uint64_t most) : most_(most) {}

  uint64_t most() const { return most_; }

  /// Window `number` of an owner, of `size` bytes in memory of `capacity`: the kept one, or an empty one, which is kept
  /// from now on. Throws std::bad_alloc.
  std::shared_ptr<MeshoptWindow> take(const void* owner, uint64_t number, size_t size, size_t capacity);

  /// Drops an owner's windows before number `end`.
  void forget(const void* owner, uint64_t end);

 private:
  struct Key {
    const void* owner;
    uint64_t number;
    bool operator==(const Key&) const = default;
  };
  struct Hash {
    size_t operator()(const Key& key) const;
  };
  struct Entry {
    Key key;
    std::shared_ptr<MeshoptWindow> window;
  };

  std::mutex mutex_;
  const uint64_t most_;
  uint64_t total_ = 0;
  std::list<Entry> entries_;  // most recently used first
  std::unordered_map<Key, std::list<Entry>::iterator, Hash> places_;
};

}  // namespace scree::convert
