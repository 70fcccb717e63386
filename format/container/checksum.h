// The container's checksum: XXH3-64 with seed 0.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace scree::format {

/// XXH3-64 of `bytes`.
uint64_t checksum(std::span<const std::byte> bytes);

/// The checksum of bytes that come in pieces; equal to the checksum of all of them at once.
class Checksum {
 public:
  Checksum();
  void add(std::span<const std::byte> bytes);
  uint64_t value() const;

 private:
  alignas(64) std::byte state_[576];  // an XXH3_state_t
};

}  // namespace scree::format
