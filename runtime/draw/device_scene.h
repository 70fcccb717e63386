// A scene in GPU memory: one arena, its size known before the first byte is copied. It is also the first of its views.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/frame.h"
#include "runtime/draw/device_view.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/streamer.h"
#include "runtime/stream/upload.h"

namespace scree::runtime {

/// The pictures that will be drawn of a scene. Their memory is counted before the scene takes memory.
struct PictureNeeds {
  uint32_t width = 0;  // in pixels; 0: nothing is counted
  uint32_t height = 0;
  uint32_t samples_per_side = 1;
  const kernels::ShadeOptions* shade = nullptr;  // null: they are not shaded
  bool is_encoded = false;                       // as JPEGs, on the device
  uint32_t shadow_side = 0;                      // of their ShadowMap; 0: none
  bool starts_next = false;                      // by DeviceView::start()
};

class DeviceScene : public DeviceView {
 public:
  /// Copies `scene` to the current device (device_list.h): records, pages, textures. Pages that the scene has are
  /// copied. Other pages are read from the file, are checked as by Scene::load_pages, and stay only on the device
  /// (runtime/stream/upload.h). JPEG levels that the scene has not decoded stay JPEGs. Their groups are decoded when
  /// they are sampled. Pages of textures are read when they are sampled; where chunks are streamed too, both share the
  /// memory.
  /// - `budget_bytes`: for the scene, the first sizes of its frames' queues (which may grow), and `pictures`. 0: the
  ///   free memory less a sixteenth, which is at most 512 MiB for a resident scene. If the budget does not hold the
  ///   scene, its chunks are streamed (runtime/stream/streamer.h); `scene` then outlives this.
  /// - `texture_cache`: bytes for decoded groups of JPEGs. The picture does not depend on it. A streamed scene takes at
  ///   most an eighth of the budget for them, and at least one group.
  /// - `host_memory`: the most pinned memory that uploading and streaming take. The part that batches do not need holds
  ///   chunks, and then pages of textures (DeviceBlockPager::keep_in_host_memory). 0: as much as batches need, and no
  ///   chunks or pages are kept.
  /// - `progress`: gets the number of copied bytes, and may stop the upload (kFile).
  /// - `gpus`: the most GPUs that draw the scene together: the current device and the next usable GPUs; kAllGpus: all.
  ///   Each has this budget. It gets all pages if they fit the budget, otherwise a share of them. Views draw on all
  ///   GPUs. The first GPU draws batches and layers, also from the others' pages. If a share exceeds the budget, one
  ///   GPU streams the scene.
  /// - `comes_later`: uploads no page if the budget of one GPU holds the scene and the memory for streaming. Pictures
  ///   then stream their chunks, and load_rest() loads all others, after which the scene is resident.
  /// - `share`: null, or the pages that the GPU gets, as one of several processes. Such a scene is not streamed, and
  ///   `gpus` is 1. Frames show the chunks of these pages. write_samples() joins them with those of others.
  /// Errors kDevice: no usable device, too few GPUs, GPUs that cannot read each other's memory, a CUDA call that failed
  /// (which and for what), a budget that does not hold the data that cannot be streamed (both sizes named). kMemory: a
  /// `host_memory` that holds no batch (both sizes named). With the file named, the errors of Scene::load_pages.
  static Result<DeviceScene> upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads,
                                    Reading reading = Reading::kAuto, uint64_t texture_cache = kDeviceTextureCache,
                                    uint64_t host_memory = 0, const PictureNeeds& pictures = {},
                                    JobProgress* progress = nullptr, uint32_t gpus = 1, bool comes_later = false,
                                    const PageShare* share = nullptr);
  DeviceScene(DeviceScene&&) noexcept;
  DeviceScene& operator=(DeviceScene&&) noexcept;
  ~DeviceScene();

  /// As runtime::set_texture_memory(), for the current device. Error kDevice.
  static Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, uint64_t budget_bytes,
                                         const PictureNeeds& pictures, SceneOptions& options);

  /// Makes a view of this scene, which outlives the view. The first one is the scene itself. Each other view of a
  /// resident scene takes kernels::CudaFrames::device_bytes() more device memory. `scene`: the uploaded one.
  /// Errors kDevice, kMemory.
  Result<DeviceView> add_view(const Scene& scene);

  /// Device memory of another view, with queues of their first sizes and all of `pictures`.
  static uint64_t view_bytes(const Scene& scene, const PictureNeeds& pictures);

  /// Copies the bits of View::omitted to the device, over the bits of the previous call, which no picture may need any
  /// more. Returns their address, valid as long as this; null if `bits` is empty. Errors kRange (not one bit per
  /// instance), kDevice.
  Result<const uint32_t*> set_omitted(std::span<const uint32_t> bits);

  /// The number of GPUs that draw the scene.
  uint32_t gpu_count() const;

  /// Whether chunks are loaded to the device while frames are drawn.
  bool is_streamed() const;

  /// As Streamer::load_rest(). Returns the bytes that are left, 0 if the scene is resident. When the last chunk is
  /// loaded, the scene becomes resident; a new picture has to be drawn then before one is resolved or read. Errors also
  /// kDevice.
  Result<uint64_t> load_rest(const IsOver& is_over = {});

  const UploadStats& stats() const;

  /// The pages of textures that are read when pixels show them, to one of the GPUs; null if there are none. `gpu`:
  /// below gpu_count().
  BlockPager* block_pager(uint32_t gpu = 0) const;

  /// Counts of the picture that resolve() made last; if several GPUs shaded it, of the rows that the first GPU shaded
  /// last. Nothing if no texture has JPEG levels, or if the scene is streamed and shaded part by part. Errors kDevice.
  Result<std::optional<kernels::TextureCacheCounts>> texture_counts() const;

  /// The scene in device memory.
  const kernels::SceneView& device_view() const;

 private:
  friend class DeviceView;
  struct Impl;
  explicit DeviceScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The pages of textures of each processor that shades pictures, `device` or, if it is null, the CPU. Empty if no
/// texture has pages. Throws std::bad_alloc.
inline std::vector<BlockPager*> block_pagers(const Scene& scene, const DeviceScene* device) {
  if (scene.block_pager() == nullptr) return {};
  if (device == nullptr) return {scene.block_pager()};
  std::vector<BlockPager*> all;
  for (uint32_t gpu = 0; gpu < device->gpu_count(); ++gpu) all.push_back(device->block_pager(gpu));
  return all;
}

/// Decides whether the block images and JPEGs of a scene of `file` are loaded whole or page by page, and sets the room
/// for pages, in host and in device memory, in `options`. `wanted`: the most room in bytes. On the CPU 0 is
/// kHostTextureMemory. On the current GPU images that fit `wanted` are loaded whole. 0: they are loaded whole if
/// everything in the file and `pictures` fit `device_memory` (both as for DeviceScene::upload()); otherwise a quarter of
/// it is for pages at first, and more or less later, as pictures show more pages or more geometry (SharedRoom). Error
/// kDevice.
inline Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, bool on_gpu, uint64_t device_memory,
                                       const PictureNeeds& pictures, SceneOptions& options) {
  if (on_gpu) return DeviceScene::set_texture_memory(file, wanted, device_memory, pictures, options);
  options.texture_memory = wanted != 0 ? wanted : kHostTextureMemory;
  return {};
}

}  // namespace scree::runtime
