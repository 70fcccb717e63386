// The container's checksum: XXH3-64 with seed 0.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace scree::format {

uint64_t checksum(std::span<const std::byte> bytes);

/// The checksum of bytes that come in parts: that of all of them in a row.
class Checksum {
 public:
  Checksum();
  void add(std::span<const std::byte> bytes);
  uint64_t value() const;

 private:
  alignas(64) std::byte state_[576];  // an XXH3_state_t
};

}  // namespace scree::format
