#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>

#include "format/geometry/index_codec.h"

namespace scree::tests {

/// The range of a list of indices; {0, 0} for an empty list.
inline format::IndexRange index_range(std::span<const uint32_t> indices) {
  if (indices.empty()) return {0, 0};
  uint32_t smallest = indices[0], largest = indices[0];
  for (const uint32_t index : indices) {
    smallest = std::min(smallest, index);
    largest = std::max(largest, index);
  }
  return {smallest, static_cast<uint32_t>(std::bit_width(largest - smallest))};
}

}  // namespace scree::tests
