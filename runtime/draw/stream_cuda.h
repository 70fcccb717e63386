// Streamed frames on a GPU: chunks are copied from or through pinned memory into a pool of device memory, while others
// are drawn. Only in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/common/device_copies.h"
#include "kernels/cuda/cull/visible_chunks.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/frame/page_table.h"
#include "kernels/cuda/shade/blend.h"
#include "kernels/cuda/shade/resolve.h"
#include "runtime/draw/device_block_pager.h"
#include "runtime/draw/page_joins.h"
#include "runtime/stream/chunk_source.h"
#include "runtime/stream/shared_room.h"
#include "runtime/stream/streamer.h"
#include "runtime/threads/job_thread.h"

namespace scree::runtime {

/// Belongs to the device that was current when it was made. One thread at a time calls it.
class CudaStream final : public StreamTarget {
 public:
  /// `scene` outlives this. `streamer`: of this scene. `bounce_bytes`: from bounce_bytes(). `joins`: memory for joining
  /// split pages on the GPU; without it they are joined on `threads` threads. Throws std::bad_alloc.
  CudaStream(const Scene& scene, Streamer streamer, uint64_t bounce_bytes, const PageJoins::Sizes& joins,
             uint32_t threads);
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;
  ~CudaStream();

  /// The device memory for moving chunks. `room`: the memory that it and the pool have together.
  static uint64_t bounce_bytes(uint64_t largest_chunk, uint64_t room);

  /// The other device memory of open(), beside the pool, bounce_bytes() and the memory for joining pages.
  static uint64_t device_bytes(const kernels::SceneView& scene) {
    return kernels::CudaVisibleChunks::device_bytes(scene);
  }

  /// Buffers of pinned memory for a batch each. One is read into while the other two are copied.
  static constexpr uint32_t kStagings = 3;

  /// Pinned memory that keeps all chunks of these sizes.
  static uint64_t kept_bytes(std::span<const uint64_t> chunk_bytes);

  /// Pinned memory of the lists that pages and visible chunks go through, and of the counters of a frame.
  static uint64_t pinned_list_bytes(const kernels::SceneView& scene) {
    constexpr uint64_t kCounters = 16384;
    return scene.chunk_count * (sizeof(kernels::CudaPageTable::Entry) + 2 * sizeof(uint32_t)) + kCounters;
  }

  /// Streamer::view(), for CudaScene::upload.
  const kernels::SceneView& view() const { return streamer_.view(); }

  /// `device`: the scene on the device. `frames`: of this scene. `blend_frames`: of its layers; null if nothing blends.
  /// `resolver`: resolves its pictures. `cache`: of its JPEG and paged levels; null if it has none. All of these
  /// outlive this. `pager`: of its paged levels; null if there are none. `room`: how their pages share memory with the
  /// streamer's pool, beside which room.room bytes are allocated. `host_bytes`: pinned host memory that chunks, in the
  /// order of the file, are read into once and copied from. The other chunks come from the ChunkSource through pinned
  /// batches. Errors kDevice (no memory), and the errors of ChunkSource::read.
  Result<void> open(const kernels::SceneView& device, kernels::CudaFrames& frames, kernels::CudaFrames* blend_frames,
                    kernels::CudaResolver& resolver, kernels::CudaTextureCache* cache, DeviceBlockPager* pager,
                    const SharedRoom& room, uint64_t host_bytes);

  /// Draws into `samples` (device memory, view.width * view.height). `shade`: null, or the options of colors().
  /// `is_over`: as for Streamer::draw().
  Result<StreamStats> draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade, uint64_t* samples,
                                 const IsOver& is_over = {});

  /// As Streamer::load_rest(). Returns the bytes that are left. If none is left, all chunks are in the scene's page
  /// table, and the scene is no longer streamed.
  Result<uint64_t> load_rest(const IsOver& is_over);
  bool is_complete() const { return is_complete_; }

  /// The colours of the last frame, 3 floats per sample, in device memory; null if it was not shaded from chunks.
  float* colors() const { return shades_ ? reinterpret_cast<float*>(colors_.data()) : nullptr; }

  /// BlendTargets::over of the last frame, in device memory; null if it has no layers.
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

  /// The events of a load: moves done, copies begun, copies done.
  struct Events {
    kernels::DeviceEvent moved;
    kernels::DeviceEvent begun;
    kernels::DeviceEvent loaded;
  };
  struct Load {
    std::future<Result<void>> issued;  // all its copies are queued
    uint32_t number;                   // index of its events
    std::vector<Residency::Place> places;
  };

  /// A piece of a chunk that is loaded.
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
  Result<void> keep(std::span<const Residency::Place> places, PageJoins& joins);
  bool is_joined(uint32_t chunk) const;
  bool needs_staging() const;
  Result<void> open_staging();
  Result<void> load(const Residency::Batch& batch, uint32_t number);
  Result<void> copy_in(std::span<const Residency::Place> places, const Events& events, bool has_begun);
  Result<void> copy_refused(std::span<const Residency::Place> places, uint32_t number);
  Result<void> use_drawn();
  Result<StreamStats> draw_all(const kernels::View& view, const kernels::ShadeOptions* shade, const IsOver& is_over);
  Result<void> divide_memory();
  Result<void> set_room(uint64_t bytes);
  std::byte* room_end() const { return pool_.data() + room_.bytes + Residency::kAlignment; }
  Result<void> draw_layers(StreamStats& stats, const IsOver& is_over);
  void list_pages(std::span<const Residency::Place> places);
  kernels::CudaFrames& frames() { return layer_ ? *blend_frames_ : *frames_; }

  /// The layer that is being drawn instead of the picture.
  struct Layer {
    const kernels::BlendTargets* at;
    const uint64_t* peeled;
  };
  Result<void> draw_nothing();

  ChunkSource source_;
  Streamer streamer_;
  Workers workers_;  // threads that read
  int device_ = 0;
  kernels::SceneView scene_{};
  kernels::SceneView blended_scene_{};
  kernels::CudaFrames* frames_ = nullptr;
  kernels::CudaFrames* blend_frames_ = nullptr;
  kernels::CudaBlend blend_;
  kernels::CudaResolver* resolver_ = nullptr;
  kernels::CudaTextureCache* cache_ = nullptr;
  bool is_complete_ = false;
  kernels::DeviceBuffer pool_;  // and behind it the room for pages of textures
  DeviceBlockPager* pager_ = nullptr;
  SharedRoom room_;
  StreamStats last_;          // of the last frame
  uint64_t first_round_ = 0;  // of its shading
  bool lacked_ = false;       // whether it loaded chunks or pages
  uint64_t bounce_bytes_;
  kernels::DeviceBuffer bounce_;  // chunks are moved through it
  kernels::CudaPageTable pages_;
  std::vector<kernels::CudaPageTable::Entry> entries_;  // of the part
  kernels::PinnedBuffer kept_;
  std::vector<uint64_t> kept_at_;  // by chunk, in kept_
  PageJoins::Sizes join_sizes_;
  std::optional<PageJoins> joins_;
  uint64_t joined_[kMostLoads] = {};          // bytes of a load that the GPU joins
  uint64_t joined_bytes_ = 0;                 // of all loads so far
  kernels::PinnedBuffer staging_[kStagings];  // if the GPU joins all chunks, made when it refuses one
  kernels::DeviceEvent staged_[kStagings];    // the copies from a staging buffer are done
  uint32_t stagings_ = 0;
  kernels::DeviceStream copies_;
  kernels::DeviceStream moves_;
  Events events_[kMostLoads];
  uint32_t loads_ = 0;
  std::deque<Load> loading_;
  // The current frame:
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
  // The part that is being drawn:
  PartOptions part_{};
  kernels::DeviceEvent drawing_begun_;
  kernels::DeviceEvent drawing_ended_;
  JobThread<Result<void>> loader_;  // the last member: it uses others until it ends
};

}  // namespace scree::runtime
