// The types and shapes of a view's layers, for libscree and for the Python package. These share no other code.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "include/scree/scree.h"

namespace scree::library {

struct LayerKind {
  scree_type type;
  uint32_t channels;  // 0: the array has no dimension for channels
};

/// Indexed by scree_layer.
inline constexpr std::array<LayerKind, 8> kLayerKinds{{{SCREE_UINT8, 4},
                                                       {SCREE_FLOAT32, 0},
                                                       {SCREE_INT64, 0},
                                                       {SCREE_INT32, 0},
                                                       {SCREE_UINT64, 0},
                                                       {SCREE_FLOAT32, 3},
                                                       {SCREE_FLOAT32, 2},
                                                       {SCREE_FLOAT32, 4}}};

/// An array with the type and shape of a layer of a frame, without data. `cameras`: of a batch; 0: no batch.
/// `samples`: per side of a pixel.
inline scree_array array_of(scree_layer layer, uint32_t cameras, uint32_t height, uint32_t width, uint32_t samples) {
  const uint32_t side = layer == SCREE_SAMPLES ? samples : 1;
  const LayerKind kind = kLayerKinds[static_cast<size_t>(layer)];
  scree_array array{};
  array.type = kind.type;
  int64_t* shape = array.shape;
  if (cameras != 0) *shape++ = cameras;
  *shape++ = int64_t{height} * side;
  *shape++ = int64_t{width} * side;
  if (kind.channels != 0) *shape++ = kind.channels;
  array.dimensions = static_cast<uint32_t>(shape - array.shape);
  return array;
}

}  // namespace scree::library
