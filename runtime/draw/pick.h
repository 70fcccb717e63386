// The triangle under a pixel of a frame.
#pragma once

#include <cstdint>
#include <optional>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"

namespace scree::runtime {

/// The triangle that a pixel shows.
struct Pick {
  kernels::Hit hit;
  uint32_t mesh;
  uint32_t node;
  uint32_t node_instance;
  uint64_t mesh_triangle;                   // in the mesh as stored
  std::optional<uint64_t> source_triangle;  // in the source primitive, if the file has source ids
  uint64_t id;                              // global triangle id
  double depth;                             // from the eye's plane, world units
};

/// The index of the sample that picking a pixel reads: the one at its centre, or below and to the right of the centre
/// if the number of samples per side is even. `view`: in samples.
uint64_t sample_index(const kernels::View& view, uint32_t samples_per_side, uint32_t x, uint32_t y);

/// The triangle that a sample of a frame of `view` shows; nullopt on the background. If the scene does not have the
/// triangle's page, it is read from the file: errors as Scene::page.
Result<std::optional<Pick>> pick_sample(const Scene& scene, const kernels::View& view, uint64_t sample);

}  // namespace scree::runtime
