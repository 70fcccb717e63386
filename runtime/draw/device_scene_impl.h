// The data of DeviceScene and DeviceView in a program that is built with CUDA.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/frame/view_batch.h"
#include "kernels/cuda/shade/blend.h"
#include "kernels/cuda/shade/picture_jpeg.h"
#include "kernels/cuda/shade/resolve.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/gpu_team.h"
#include "runtime/draw/shared_device_buffer.h"
#include "runtime/draw/stream_cuda.h"

namespace scree::runtime {

using kernels::cuda_check;
using DeviceBuffer = SharedDeviceBuffer;

struct DeviceView::Impl {
  explicit Impl(DeviceScene::Impl& of) : scene(of) {}

  /// Makes `after` wait for the work that is queued on `before`.
  Result<void> order(cudaStream_t before, cudaStream_t after) {
    if (queued == nullptr) SCREE_TRY(queued.make(cudaEventDisableTiming));
    SCREE_TRY(cuda_check(cudaEventRecord(queued, before), "recording an event"));
    return cuda_check(cudaStreamWaitEvent(after, queued), "ordering a stream");
  }

  void set_size(const kernels::View& view) {
    width = view.width;
    height = view.height;
  }

  /// The stream of all work on the picture that was drawn last: from the first start() on, its own.
  cudaStream_t stream() const { return beside; }

  /// Makes later work on pictures and layers wait for the copies of read_later().
  Result<void> order_after_reads() const {
    return reads == nullptr ? Result<void>() : cuda_check(cudaStreamWaitEvent(stream(), was_read), "ordering a stream");
  }

  /// Copies once the queued work is done, and waits for the copy.
  Result<void> copy(void* to, const void* from, uint64_t bytes, cudaMemcpyKind kind, const char* what) const {
    SCREE_TRY(cuda_check(cudaMemcpyAsync(to, from, bytes, kind, stream()), what));
    return cuda_check(cudaStreamSynchronize(stream()), what);
  }

  DeviceScene::Impl& scene;
  std::optional<kernels::CudaFrames> frames;        // none if chunks are streamed and another view has them
  std::optional<kernels::CudaFrames> blend_frames;  // of layers, if the scene has blended surfaces; likewise
  kernels::CudaResolver resolver;
  kernels::CudaBlend blend;
  kernels::BlendCounts blended;  // of the picture that resolve() made last
  DeviceBuffer samples;
  DeviceBuffer pixels;
  DeviceBuffer colors;  // of read_colors()
  DeviceBuffer layers[kBlockCount];
  DeviceBuffer blocks[kBlockCount];
  // For the second picture that start(), or a batch, draws at the same time. They take turns with `frames` and
  // `samples`.
  std::optional<kernels::CudaFrames> second_frames;
  DeviceBuffer second_samples;
  size_t picture = 0;  // 0 or 1: the one that `frames` and `samples` belong to
  bool has_room_for_second = true;
  std::optional<kernels::CudaViewBatch> view_batch;
  bool takes_view_batches = true;  // false once the scene turns out not to suit them, or memory is short
  kernels::CudaJpegCoder jpeg;
  kernels::DeviceEvent queued;
  std::optional<kernels::View> ahead;  // of the picture between start() and finish(), into second_samples
  bool joins_ahead = false;            // with DrawOptions::join
  kernels::DeviceStream beside;
  kernels::DeviceStream reads;    // of read_later(), once it was called
  kernels::DeviceEvent was_read;  // likewise: its copies up to now
  std::optional<StreamStats> streamed;

  uint32_t width = 0;  // of the picture that draw() made last, in samples
  uint32_t height = 0;
  std::optional<kernels::View> drawn_by_team;  // that picture's, if several GPUs drew it

  ~Impl() {
    if (reads != nullptr) (void)cudaStreamSynchronize(reads);
  }
  Result<void> check_drawn(const kernels::View& view);
  Result<kernels::FrameStats> draw_by_team(const kernels::View& view);
  Result<void> draw_if_followed();
  Result<uint64_t*> whole_samples();
  uint64_t* sample_data() const { return reinterpret_cast<uint64_t*>(samples.data()); }

  void use_picture(size_t number) {
    if (picture == number) return;
    std::swap(frames, second_frames);
    std::swap(samples, second_samples);
    picture = number;
  }
  /// The transforms of the picture that draw() made last. Null if they are gone.
  const kernels::Transform* transforms() const;
  bool open_second(const kernels::SceneView& host);
  bool open_view_batch(const kernels::SceneView& host);
  Result<const float*> blended_over(const kernels::View& view, const kernels::ShadeOptions& options);
};

struct DeviceScene::Impl {
  CudaScene scene;
  int device = 0;
  std::shared_ptr<DeviceView::Impl> own = std::make_shared<DeviceView::Impl>(*this);
  std::unique_ptr<CudaStream> stream;           // if not all of the scene's pages were uploaded
  std::unique_ptr<GpuTeam> team;                // if several GPUs have the pages
  const DeviceView::Impl* team_view = nullptr;  // whose picture the team drew last
  DeviceBuffer omitted;                         // the bits of set_omitted()
  UploadStats stats;
  uint64_t fragment_room = 0;  // bytes, of the fragments of blended surfaces of a view

  Result<void> make_frames(DeviceView::Impl& view, const kernels::SceneView& host,
                           const kernels::CudaQueueSizes& queues = {}) const {
    view.blend = kernels::CudaBlend(fragment_room);
    view.frames = SCREE_TRY(kernels::CudaFrames::create(host, scene.view(), queues));
    if (host.blend_masks != nullptr)
      view.blend_frames =
          SCREE_TRY(kernels::CudaFrames::create(kernels::blended_view(host), kernels::blended_view(scene.view())));
    return {};
  }
  /// The stream while it streams; null if all chunks are present.
  CudaStream* streaming() const { return stream != nullptr && !stream->is_complete() ? stream.get() : nullptr; }
  /// Makes the frames of a view that was added while chunks were streamed, once the scene is resident.
  Result<void> make_ready(DeviceView::Impl& view) const {
    return view.frames || streaming() != nullptr ? Result<void>() : make_frames(view, stream->view());
  }
  Result<void> upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                               uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures,
                               JobProgress* progress, uint64_t most_batch);
  Result<void> upload_shared(const Scene& host, std::span<const int> gpus, const GpuTeam::Options& options);
};

}  // namespace scree::runtime
