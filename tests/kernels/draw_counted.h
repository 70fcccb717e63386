// Frames of the CPU with their statistics, for tests of culling.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

inline kernels::QueueSizes nothing_left_out() {
  return {.cluster_bounds = false, .occlusion = false};
}

struct Drawn {
  std::vector<uint64_t> samples;
  kernels::FrameStats stats;
};

inline Drawn draw_counted(const kernels::SceneView& scene, const kernels::View& view, const kernels::QueueSizes& sizes,
                          uint32_t threads = 1) {
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  const auto stats =
      must(kernels::draw_cpu_with(scene, view, samples, threads, kernels::best_instruction_set(), sizes));
  return {std::move(samples), stats};
}

}  // namespace scree::tests
