// Divides device memory between chunks of geometry and pages of textures, by the bytes that the last picture showed.
#pragma once

#include <algorithm>
#include <cstdint>

namespace scree::runtime {

/// Memory of `bytes`: pages have `room`, chunks the rest. Limits: least_room <= most_room, least_pool + least_room <=
/// bytes.
struct SharedRoom {
  /// A smaller change is not worth the chunks or pages that are dropped for it.
  static constexpr uint64_t kLeastChange = 16;  // a part of `bytes`: 1/16

  uint64_t bytes = 0;
  uint64_t room = 0;
  uint64_t least_room = 0;
  uint64_t most_room = 0;
  uint64_t least_pool = 0;

  uint64_t pool() const { return bytes - room; }
  /// The nearest room within the limits, in whole `unit`s.
  uint64_t within(uint64_t wanted, uint64_t unit) const {
    return std::clamp(wanted, least_room, std::max(least_room, std::min(most_room, bytes - least_pool))) / unit * unit;
  }

  /// The room for pages after a picture that showed `chunk_bytes` of chunks and `page_bytes` of pages. It stays as it
  /// is if neither lacks any. If both fit, they share the rest; if not, each gets memory in proportion to its bytes.
  uint64_t balanced(uint64_t chunk_bytes, uint64_t page_bytes, uint64_t unit) const {
    if (chunk_bytes <= pool() && page_bytes <= room) return room;
    const uint64_t sum = chunk_bytes + page_bytes;
    const uint64_t wanted = sum <= bytes
                                ? page_bytes + (bytes - sum) / 2
                                : static_cast<uint64_t>(static_cast<double>(bytes) *
                                                        (static_cast<double>(page_bytes) / static_cast<double>(sum)));
    const uint64_t next = within(wanted, unit);
    return (next > room ? next - room : room - next) < bytes / kLeastChange ? room : next;
  }
};

}  // namespace scree::runtime
