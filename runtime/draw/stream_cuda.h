// Streamed frames on a GPU: chunks go through pinned memory, or come from it, into a pool of device memory while others
// are drawn. Where the program is built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/blend.h"
#include "kernels/cuda/check.h"
#include "kernels/cuda/device_copies.h"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/page_table.h"
#include "kernels/cuda/resolve.h"
#include "kernels/cuda/visible_chunks.h"
#include "runtime/stream/chunk_source.h"
#include "runtime/stream/streamer.h"
#include "runtime/threads/job_thread.h"

namespace scree::runtime {

/// Called by one thread; of the device that was current when it was made.
class CudaStream final : public StreamTarget {
 public:
  /// `scene` outlives this; `streamer` is one of it. `bounce_bytes`: bounce_bytes(). Throws std::bad_alloc.
  CudaStream(const Scene& scene, Streamer streamer, uint64_t bounce_bytes, uint32_t threads);
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;
  ~CudaStream();

  /// What moving chunks takes of the device memory, `room`, that the pool and it have together.
  static uint64_t bounce_bytes(uint64_t largest_chunk, uint64_t room);

  /// What beside the pool, and that, goes to device memory with open().
  static uint64_t device_bytes(const kernels::SceneView& scene) {
    return kernels::CudaVisibleChunks::device_bytes(scene);
  }

  /// Pinned memory for a batch: one is read into, and the copies of two are under way.
  static constexpr uint32_t kStagings = 3;

  /// Pinned memory that keeps all chunks of these sizes.
  static uint64_t kept_bytes(std::span<const uint64_t> chunk_bytes);

  /// Pinned memory of the lists that pages and visible chunks go through, and of the counters of a frame.
  static uint64_t pinned_list_bytes(const kernels::SceneView& scene) {
    constexpr uint64_t kCounters = 16384;
    return scene.chunk_count * (sizeof(kernels::CudaPageTable::Entry) + 2 * sizeof(uint32_t)) + kCounters;
  }

  /// As the target has to see it: for CudaScene::upload.
  const kernels::SceneView& view() const { return streamer_.view(); }

  /// `device`: that scene on the device; with `frames` of it, `blend_frames` of its layers (null where nothing blends),
  /// and what resolves its pictures, it outlives this.
  /// `cache`: of the scene's JPEG levels; null where it has none. `host_bytes`: chunks, in the order of the file, are
  /// brought to so much pinned host memory once and copied from there; the others come through pinned batches from
  /// where ChunkSource has them. Errors kDevice (no memory), those of ChunkSource::read.
  Result<void> open(const kernels::SceneView& device, kernels::CudaFrames& frames, kernels::CudaFrames* blend_frames,
                    kernels::CudaResolver& resolver, kernels::CudaTextureCache* cache, uint64_t host_bytes);

  /// Draws into `samples` (device memory, view.width * view.height); colors() are then those of `shade`. `is_over`: as
  /// Streamer::draw().
  Result<StreamStats> draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade, uint64_t* samples,
                                 const IsOver& is_over = {});

  /// As Streamer::load_rest(); returns the bytes that are left. After the last all chunks are in the scene's page
  /// table, and nothing is streamed any more.
  Result<uint64_t> load_rest(const IsOver& is_over);
  bool is_complete() const { return is_complete_; }

  /// Of the last frame, 3 floats a sample, in device memory; null where it was not shaded from chunks.
  const float* colors() const { return shades_ ? reinterpret_cast<const float*>(colors_.data()) : nullptr; }

  /// BlendTargets::over of the last frame, in device memory; null where it has no layers.
  const float* over() const { return over_; }
  const kernels::BlendCounts& blended() const { return blended_; }

  Result<void> begin(const kernels::View& view, const kernels::ShadeOptions* shade) override;
  Result<std::span<const uint32_t>> list() override;
  Result<void> start_loading(const Residency::Batch& batch) override;
  Result<bool> is_loaded() override;
  Result<double> finish_loading() override;
  Result<void> start_drawing(std::span<const Residency::Place> places, PartOptions options) override;
  Result<Drawn> finish_drawing() override;
  uint32_t nearest_shown(uint32_t chunk) const override { return shown_[chunk]; }
  void stop() override;

 private:
  static constexpr uint64_t kNotPinned = ~uint64_t{0};
  static constexpr uint64_t kPieceBytes = uint64_t{256} << 20;  // read on all threads before their copies start

  /// Of a load: the copies from the first on.
  struct Events {
    cudaEvent_t moved = nullptr;
    cudaEvent_t begun = nullptr;
    cudaEvent_t loaded = nullptr;
  };
  struct Load {
    std::future<Result<void>> issued;  // all its copies
    uint32_t number;                   // of its events
  };

  /// Of a chunk that is loaded.
  struct Piece {
    const std::byte* from;
    uint64_t to;  // in the pool
    uint64_t bytes;
  };
  struct Copies {
    std::vector<void*> to;
    std::vector<const void*> from;
    std::vector<size_t> bytes;

    void add(void* target, const void* source, size_t count) {
      to.push_back(target);
      from.push_back(source);
      bytes.push_back(count);
    }
    void clear() {
      to.clear();
      from.clear();
      bytes.clear();
    }
  };

  Result<void> move(std::span<const Residency::Move> moves);
  Result<void> copy(Copies& copies);
  Result<void> keep_in_host_memory(uint64_t host_bytes);
  Result<void> load(const Residency::Batch& batch, const Events& events);
  Result<void> use_drawn();
  Result<void> draw_layers(StreamStats& stats, const IsOver& is_over);
  void list_pages(std::span<const Residency::Place> places);
  kernels::CudaFrames& frames() { return layer_ ? *blend_frames_ : *frames_; }

  /// A layer that is drawn, in place of the picture.
  struct Layer {
    const kernels::BlendTargets* at;
    const uint64_t* peeled;
  };
  Result<void> draw_nothing();

  ChunkSource source_;
  Streamer streamer_;
  Workers workers_;  // that read
  int device_ = 0;
  kernels::SceneView scene_{};
  kernels::SceneView blended_scene_{};
  kernels::CudaFrames* frames_ = nullptr;
  kernels::CudaFrames* blend_frames_ = nullptr;
  kernels::CudaBlend blend_;
  kernels::CudaResolver* resolver_ = nullptr;
  kernels::CudaTextureCache* cache_ = nullptr;
  bool is_complete_ = false;
  kernels::DeviceBuffer pool_;
  uint64_t bounce_bytes_;
  kernels::DeviceBuffer bounce_;  // for moves onto themselves
  kernels::CudaPageTable pages_;
  std::vector<kernels::CudaPageTable::Entry> entries_;  // of the part
  kernels::PinnedBuffer kept_;
  std::vector<uint64_t> kept_at_;  // by chunk, in kept_
  kernels::PinnedBuffer staging_[kStagings];
  cudaEvent_t staged_[kStagings] = {};  // when what was read into one was copied
  uint32_t stagings_ = 0;
  cudaStream_t copies_ = nullptr;
  cudaStream_t moves_ = nullptr;
  Events events_[kMostLoads];
  uint32_t loads_ = 0;
  std::deque<Load> loading_;
  // Of the frame:
  kernels::View view_{};
  uint64_t* samples_ = nullptr;
  bool shades_ = false;
  kernels::ShadeOptions shade_;
  kernels::DeviceBuffer colors_;
  const float* over_ = nullptr;
  kernels::BlendCounts blended_;
  std::optional<Layer> layer_;
  kernels::CudaVisibleChunks visible_;
  std::vector<uint32_t> near_to_far_;
  std::vector<uint32_t> shown_;  // nearest_shown(), by chunk
  // Of the part that is drawn:
  PartOptions part_{};
  cudaEvent_t drawing_begun_ = nullptr;
  cudaEvent_t drawing_ended_ = nullptr;
  JobThread<Result<void>> loader_;  // the last member: it uses others until it ends
};

}  // namespace scree::runtime
