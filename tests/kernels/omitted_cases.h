// Instances that views leave out, for the tests of the CPU and the GPU.
#pragma once

#include <random>
#include <span>
#include <vector>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// A bit per instance; a third of them are set.
inline std::vector<uint32_t> random_omitted(uint64_t instance_count, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<uint32_t> bits((instance_count + 31) / 32, 0);
  for (uint64_t i = 0; i < instance_count; ++i)
    if (random() % 3 == 0) bits[i / 32] |= 1u << (i % 32);
  return bits;
}

inline kernels::View omitting(kernels::View view, const uint32_t* bits) {
  view.omitted = bits;
  return view;
}

/// The scene of the instances whose bit is not set. It has its own ids. `whole` must outlive it.
class RemainingScene {
 public:
  RemainingScene(const kernels::SceneView& whole, std::span<const uint32_t> omitted)
      : whole_(whole), view_(whole), bases_{whole.instance_base[0]} {
    for (uint64_t i = 0; i < whole.instance_count; ++i) {
      if ((omitted[i / 32] >> (i % 32) & 1) != 0) continue;
      instances_.push_back(whole.instances[i]);
      numbers_.push_back(i);
      bases_.push_back(bases_.back() + whole.meshes[whole.instances[i].mesh].triangle_count);
    }
    view_.instances = instances_.data();
    view_.instance_base = bases_.data();
    view_.instance_count = instances_.size();
  }
  RemainingScene(const RemainingScene&) = delete;
  RemainingScene& operator=(const RemainingScene&) = delete;

  const kernels::SceneView& view() const { return view_; }

  /// Samples of this scene, with the ids of the whole one.
  std::vector<uint64_t> in_whole(std::vector<uint64_t> samples) const {
    for (uint64_t& sample : samples) {
      if (sample == kernels::kBackground) continue;
      const uint64_t id = kernels::sample_id(sample);
      const uint64_t instance = kernels::find_triangle(view_, id).instance;
      sample = kernels::pack_sample(kernels::sample_depth_code(sample),
                                    id - bases_[instance] + whole_.instance_base[numbers_[instance]]);
    }
    return samples;
  }

 private:
  kernels::SceneView whole_, view_;
  std::vector<format::InstanceRecord> instances_;
  std::vector<uint64_t> numbers_;  // of these, in the whole scene
  std::vector<uint64_t> bases_;
};

}  // namespace scree::tests
