#include "kernels/cuda/shade/blend.h"

#include <cuda_runtime.h>

#include <algorithm>

#include "kernels/cuda/common/device_array.h"
#include "kernels/cuda/shade/pixels.cuh"
#include "kernels/shade/blend.h"

namespace scree::kernels {
namespace {

/// The warp that shades pixels, with the counting of layers.
struct BlendTeam : PixelTeam {
  __device__ static void add(uint64_t* counter, uint64_t value) {
    atomicAdd(reinterpret_cast<unsigned long long*>(counter), static_cast<unsigned long long>(value));
  }
};

template <class Pass>
__global__ void __launch_bounds__(kPixelThreads) run_blend(const __grid_constant__ Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, BlendTeam{});
}

template <class Pass>
Result<void> start(const Pass& pass, uint32_t count, cudaStream_t stream) {
  return start_items(run_blend<Pass>, pass, count, stream, "starting a pass of blending");
}

/// Sorts the fragments of every sample by their words, removes repeated ones, and puts kBackground behind the last if a
/// slot is left. A sample with more fragments than slots gets no layers here and sets counts->overfull. Initialises
/// `over`.
struct SortFragments {
  static constexpr uint32_t kMost = SlotCounts::kMostSlots;

  FragmentSlots slots;
  uint32_t most;  // layers that are drawn
  float* over;
  SlotCounts* counts;

  __device__ static void order(uint64_t words[kMost], uint32_t alphas[kMost], uint32_t i, uint32_t j) {
    const bool swaps = words[j] < words[i];
    const uint64_t word = swaps ? words[j] : words[i];
    const uint32_t alpha = swaps ? alphas[j] : alphas[i];
    words[j] = swaps ? words[i] : words[j];
    alphas[j] = swaps ? alphas[i] : alphas[j];
    words[i] = word;
    alphas[i] = alpha;
  }

  /// Batcher's odd-even merge sort.
  __device__ static void sort(uint64_t words[kMost], uint32_t alphas[kMost]) {
#pragma unroll
    for (uint32_t p = 1; p < kMost; p *= 2) {
#pragma unroll
      for (uint32_t k = p; k >= 1; k /= 2) {
#pragma unroll
        for (uint32_t j = k % p; j + k < kMost; j += 2 * k) {
#pragma unroll
          for (uint32_t i = 0; i < k; ++i) {
            if (i + j + k < kMost && (i + j) / (2 * p) == (i + j + k) / (2 * p)) order(words, alphas, i + j, i + j + k);
          }
        }
      }
    }
  }

  __device__ void operator()(uint32_t item, BlendTeam team) const {
    uint64_t shown = 0;
    uint32_t overfull = 0;
    uint32_t deepest = 0;
    for_each_sample(item, static_cast<uint32_t>(slots.sample_count), team, [&](uint32_t sample) {
      reinterpret_cast<float4*>(over)[sample] = {0, 0, 0, 1};
      const uint32_t found = slots.counts[sample];
      const bool fits = found <= slots.slot_count;
      overfull += fits ? 0 : 1;
      shown += fits && found != 0 ? 1 : 0;
      uint32_t count = 0;
      if (fits && found != 0) count = sort_sample(sample, found);
      deepest = max_of(deepest, count);
      if (count < slots.slot_count) slots.words[count * slots.sample_count + sample] = kBackground;
    });
    if (most == 0 && shown != 0) team.add(&counts->shown[0], shown);
    if (overfull != 0 && counts->overfull == 0) counts->overfull = 1;
    if (deepest > counts->deepest) team.atomic_max(&counts->deepest, deepest);
  }

  /// Sorts the `found` fragments of a sample. Returns their number without repeats.
  __device__ uint32_t sort_sample(uint32_t sample, uint32_t found) const {
    uint64_t words[kMost];
    uint32_t alphas[kMost];
#pragma unroll
    for (uint32_t i = 0; i < kMost; ++i) {
      const uint64_t at = i * slots.sample_count + sample;
      words[i] = i < found ? slots.words[at] : kBackground;
      alphas[i] = i < found ? slots.alphas[at] : 0;
    }
    if (found == 1) return 1;
    sort(words, alphas);
    uint32_t count = 0;
#pragma unroll
    for (uint32_t i = 0; i < kMost; ++i) {
      if (words[i] == kBackground || (i != 0 && words[i] == words[i - 1])) continue;
      const uint64_t at = count * slots.sample_count + sample;
      slots.words[at] = words[i];
      slots.alphas[at] = alphas[i];
      ++count;
    }
    return count;
  }
};

}  // namespace

struct CudaBlend::Impl {
  DeviceArray<uint64_t> samples;  // BlendTargets::drawn, layer, and the count of EndLayer
  DeviceArray<float> floats;      // BlendTargets::colors, alphas, over
  DeviceArray<uint64_t> words;    // FragmentSlots::words, SlotCounts
  DeviceArray<uint32_t> numbers;  // FragmentSlots::alphas, counts
  BlendTargets at{};
  uint64_t fragment_room = 0;

  Result<void> fit(const View& view, const uint64_t* opaque) {
    const uint64_t count = uint64_t{view.width} * view.height;
    SCREE_TRY(samples.grow(2 * count + 1, "allocating the layers of blended surfaces"));
    SCREE_TRY(floats.grow(8 * count, "allocating the layers of blended surfaces"));
    at = {static_cast<uint32_t>(count),
          opaque,
          samples.data() + 1,
          samples.data() + 1 + count,
          floats.data() + 4 * count,
          floats.data() + 7 * count,
          floats.data()};
    return {};
  }

  /// The slots that fit fragment_room, or none; then the layers are drawn one by one.
  FragmentSlots fit_slots() {
    const uint64_t count = at.sample_count;
    const char* const what = "allocating the fragments of blended surfaces";
    constexpr uint64_t kSlotBytes = sizeof(uint64_t) + sizeof(uint32_t);
    const uint64_t fixed = count * sizeof(uint32_t) + sizeof(SlotCounts);
    if (fragment_room < fixed + count * kSlotBytes) return {};
    const auto slot_count = static_cast<uint32_t>(
        std::min<uint64_t>((fragment_room - fixed) / (count * kSlotBytes), SlotCounts::kMostSlots));
    if (!words.grow(kCountWords + slot_count * count, what) || !numbers.grow((slot_count + uint64_t{1}) * count, what))
      return {};
    return {words.data() + kCountWords, numbers.data() + count, numbers.data(), count, slot_count};
  }

  Result<uint64_t> end_layer() {
    uint64_t* const count = samples.data();
    uint64_t shown = 0;
    SCREE_TRY(cuda_check(cudaMemsetAsync(count, 0, sizeof shown, nullptr), "clearing a layer's count"));
    SCREE_TRY(start(EndLayer{at, count}, blend_items(at.sample_count), nullptr));
    SCREE_TRY(cuda_check(cudaMemcpy(&shown, count, sizeof shown, cudaMemcpyDeviceToHost), "drawing a layer"));
    return shown;
  }

  /// Draws the layers of all samples whose fragments fit their slots. Returns whether there are other samples.
  Result<bool> draw_slots(const View& view, const FragmentSlots& slots, uint32_t most, const FragmentSource& source,
                          BlendCounts& counts) {
    auto* const device_counts = reinterpret_cast<SlotCounts*>(words.data());
    SCREE_TRY(cuda_check(cudaMemsetAsync(device_counts, 0, sizeof(SlotCounts), nullptr), "clearing counts"));
    SCREE_TRY(cuda_check(cudaMemsetAsync(slots.counts, 0, slots.sample_count * sizeof(uint32_t), nullptr),
                         "clearing the counts of fragments"));
    SCREE_TRY(source.draw(slots));
    SCREE_TRY(start(SortFragments{slots, most, at.over, device_counts}, blend_items(at.sample_count), nullptr));
    SlotCounts found;
    const auto read_counts = [&] {
      return cuda_check(cudaMemcpy(&found, device_counts, sizeof found, cudaMemcpyDeviceToHost), "drawing the layers");
    };
    SCREE_TRY(read_counts());
    const uint32_t layers = std::min(most, found.deepest);
    for (uint32_t slot = 0; slot < layers; ++slot) {
      SCREE_TRY(source.shade(slots.words + slot * slots.sample_count, at.colors));
      SCREE_TRY(lay_slot(view, slots, slot, most, source, device_counts));
    }
    SCREE_TRY(read_counts());
    if (layers != 0) counts.layers = 1;
    while (counts.layers < layers && found.shown[counts.layers] != 0) ++counts.layers;
    if (most < slots.slot_count) counts.samples_left_out = found.shown[most];
    return found.overfull != 0;
  }

  Result<void> lay_slot(const View& view, const FragmentSlots& slots, uint32_t slot, uint32_t most,
                        const FragmentSource& source, SlotCounts* device_counts) const {
    const ShadeInputs in = make_shade_inputs(source.scene, view, ShadeOptions{}, source.transforms(), nullptr, nullptr);
    const PixelTiles tiles{view.width, 0, view.height};
    return view.orthographic
               ? start(LaySlotUnder<true>{in, tiles, slots, slot, most, at.colors, at.over, device_counts},
                       tiles.count(), nullptr)
               : start(LaySlotUnder<false>{in, tiles, slots, slot, most, at.colors, at.over, device_counts},
                       tiles.count(), nullptr);
  }

  static constexpr uint64_t kCountWords = sizeof(SlotCounts) / sizeof(uint64_t);
};

CudaBlend::CudaBlend(uint64_t fragment_room) : impl_(std::make_unique<Impl>()) {
  impl_->fragment_room = fragment_room;
}
CudaBlend::CudaBlend(CudaBlend&&) noexcept = default;
CudaBlend& CudaBlend::operator=(CudaBlend&&) noexcept = default;
CudaBlend::~CudaBlend() = default;

float* CudaBlend::colors() const {
  return impl_->at.colors;
}

Result<const float*> CudaBlend::blend(const View& view, const uint64_t* samples, uint32_t most,
                                      const LayerSource& source, BlendCounts& counts, const FragmentSource* fragments) {
  counts = {};
  SCREE_TRY(check_frame(view, 0));
  SCREE_TRY(impl_->fit(view, samples));
  const BlendTargets& at = impl_->at;
  const uint32_t items = blend_items(at.sample_count);
  const FragmentSlots slots = fragments != nullptr ? impl_->fit_slots() : FragmentSlots{};
  if (slots.counts != nullptr) {
    const bool has_more = SCREE_TRY(impl_->draw_slots(view, slots, most, *fragments, counts));
    if (!has_more) return static_cast<const float*>(at.over);
  }
  BlendCounts others;
  SCREE_TRY(draw_layers(
      at, most, source, others,
      [&](bool is_first) {
        return start(BeginLayer{at, is_first, slots}, items, nullptr);
      },
      [&] { return impl_->end_layer(); }, [&] { return start(LayUnder{at}, items, nullptr); }));
  counts.layers = std::max(counts.layers, others.layers);
  counts.samples_left_out += others.samples_left_out;
  return static_cast<const float*>(at.over);
}

Result<void> start_finding_alphas(const SceneView& scene, const View& view, const uint64_t* samples,
                                  const Transform* transforms, float* alphas, cudaStream_t stream) {
  const PixelTiles tiles{view.width, 0, view.height};
  const ShadeInputs in = make_shade_inputs(scene, view, ShadeOptions{}, transforms, nullptr, nullptr);
  return view.orthographic ? start(FindAlphas<true>{in, tiles, samples, alphas}, tiles.count(), stream)
                           : start(FindAlphas<false>{in, tiles, samples, alphas}, tiles.count(), stream);
}

}  // namespace scree::kernels
