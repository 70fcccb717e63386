// Streamed frames on the CPU, for tests of runtime::Streamer: the pool is host memory, and a thread of its own fills
// it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/blend.h"
#include "kernels/frame.h"
#include "runtime/stream/chunk_source.h"
#include "runtime/stream/streamer.h"
#include "runtime/threads/job_thread.h"
#include "tests/runtime/stream/visible_chunks.h"

namespace scree::tests {

using namespace runtime;

class CpuStream final : public StreamTarget {
 public:
  /// `scene`: outlives this; its pages may be loaded or not (ChunkSource). `pool_bytes`: all the memory for chunks. In
  /// addition the pictures take 8 bytes per sample, and 12 more if they are shaded from chunks. Errors as
  /// Streamer::create.
  static Result<std::unique_ptr<CpuStream>> create(const Scene& scene, uint64_t pool_bytes, uint32_t threads);

  /// Draws `view` (its sides in samples) as kernels::draw_cpu() does. `shade`: the options of the later picture(); null
  /// if only the samples are wanted. `is_over`: as for Streamer::draw().
  Result<StreamStats> draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade,
                                 const IsOver& is_over = {});

  /// As Streamer::load_rest(); returns the bytes that are left.
  Result<uint64_t> load_rest(const IsOver& is_over = {});

  /// The layers of blended surfaces in the last frame. Requires that it was drawn with `shade`.
  const kernels::BlendCounts& blended() const { return blended_; }

  /// The samples of the last frame, row by row.
  std::span<const uint64_t> samples() const { return samples_; }
  /// The picture of the last frame with its `shade`, RGBA8, with samples_per_side^2 samples per pixel.
  Result<std::vector<uint8_t>> picture(uint32_t samples_per_side) const;

  const Residency& residency() const { return streamer_.residency(); }

  Result<void> begin(const kernels::View& view, const kernels::ShadeOptions* shade) override;
  Result<std::span<const uint32_t>> list() override;
  Result<void> start_loading(const Residency::Batch& batch) override;
  Result<bool> is_loaded() override { return false; }  // so that no order depends on timing
  Result<double> finish_loading() override;
  Result<void> start_drawing(std::span<const Residency::Place> places, PartOptions options) override;
  Result<Drawn> finish_drawing() override;
  uint32_t nearest_shown(uint32_t chunk) const override {
    return has_depths_ ? visible_.nearest_shown(chunk, depths_) : visible_.nearest(chunk);
  }
  void stop() override;

 private:
  CpuStream(const Scene& scene, Streamer streamer, uint32_t threads);
  void find_depths();
  Result<void> draw_layers(StreamStats& stats, const IsOver& is_over);

  /// The layer that is being drawn instead of the picture.
  struct Layer {
    const kernels::BlendTargets* at;
    const uint64_t* peeled;
  };

  ChunkSource source_;
  Streamer streamer_;
  uint32_t threads_;
  Workers workers_;  // threads that read
  std::vector<std::byte> pool_;
  std::vector<const std::byte*> pages_;  // by chunk; null unless the chunk is being drawn
  kernels::SceneView scene_;
  kernels::View view_{};
  std::optional<kernels::ShadeOptions> shade_;
  std::vector<uint64_t> samples_;
  std::vector<float> colors_;
  std::vector<float> over_;  // BlendTargets::over; empty without layers
  kernels::BlendCounts blended_;
  std::optional<Layer> layer_;
  VisibleChunks visible_;
  bool has_depths_ = false;
  kernels::DepthPyramid depths_{};
  std::vector<uint32_t> codes_;  // of the pyramid
  Drawn drawn_{};
  std::deque<std::future<Result<double>>> loading_;
  JobThread<Result<double>> loader_;  // last member, since it uses the others until it ends
};

}  // namespace scree::tests
