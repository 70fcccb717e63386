#include "tools/gltf/meshopt/windows.h"

#include <atomic>
#include <functional>
#include <utility>

namespace scree::convert {

size_t KeptWindows::Hash::operator()(const Key& key) const {
  return std::hash<const void*>{}(key.owner) ^ static_cast<size_t>(key.number * 0x9e3779b97f4a7c15);
}

std::shared_ptr<MeshoptWindow> KeptWindows::take(const void* owner, uint64_t number, size_t size, size_t capacity) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Key key{owner, number};
  if (const auto found = places_.find(key); found != places_.end()) {
    entries_.splice(entries_.begin(), entries_, found->second);
    return found->second->window;
  }
  // Reuses the memory of a dropped window: freed memory would stay in the allocator's arena of the thread that made it.
  std::unique_ptr<std::byte[]> bytes;
  while (total_ + capacity + kEntryBytes > most_ && !entries_.empty()) {
    MeshoptWindow& last = *entries_.back().window;
    total_ -= last.capacity + kEntryBytes;
    if (last.capacity == capacity && entries_.back().window.use_count() == 1) {
      std::atomic_thread_fence(std::memory_order_acquire);  // after the last read of the previous holder
      bytes = std::move(last.bytes);
    }
    places_.erase(entries_.back().key);
    entries_.pop_back();
  }
  auto window = std::make_shared<MeshoptWindow>();
  window->bytes =
      bytes ? std::move(bytes) : std::unique_ptr<std::byte[]>(new std::byte[capacity]);  // left uninitialised
  window->capacity = capacity;
  window->size = size;
  entries_.push_front({key, window});
  try {
    places_.emplace(key, entries_.begin());
  } catch (...) {
    entries_.pop_front();
    throw;
  }
  total_ += capacity + kEntryBytes;
  return window;
}

void KeptWindows::forget(const void* owner, uint64_t end) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (uint64_t number = 0; number < end; ++number) {
    const auto found = places_.find({owner, number});
    if (found == places_.end()) continue;
    total_ -= found->second->window->capacity + kEntryBytes;
    entries_.erase(found->second);
    places_.erase(found);
  }
}

}  // namespace scree::convert
