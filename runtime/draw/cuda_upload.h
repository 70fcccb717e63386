// A scene in CUDA device memory: one arena, filled through a ring of pinned memory. Only in programs that are built
// with CUDA.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/shade/texture_cache.h"
#include "kernels/scene_view.h"
#include "runtime/draw/device_block_pager.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/upload.h"

namespace scree::runtime {

/// The device memory that a scene may take: `budget_bytes` (0: unlimited), but at most the free memory. Errors kDevice.
Result<uint64_t> device_budget(uint64_t budget_bytes);

class CudaScene {
 public:
  CudaScene() = default;

  /// Copies records, pages and textures of `scene` to the current device. `scene` may be destroyed afterwards, unless
  /// its textures have a pager, which reads their pages later. JPEG levels without pages are copied as they are.
  /// - `budget_bytes`: for all of that and `reserved_bytes` together. 0: the free memory.
  /// - `texture_cache`: bytes for decoded groups of JPEG levels.
  /// - `host_memory`: the most pinned memory that the copies go through. 0: 128 MiB.
  /// - `streamed`: null, or Streamer::view() of the scene. Then no page is copied, and all view().pages are null,
  ///   chunk_count of them.
  /// - `more_texture_room`: for pages of textures, beside DeviceBlockPager::usual_room(). If chunks are streamed, the
  ///   pager has no room before DeviceBlockPager::use_room().
  /// - `share`: null, or the pages that are copied; view().pages are null for the others.
  /// Errors kDevice (a CUDA call that failed, which and for what; a scene that does not fit, both sizes named) and,
  /// with the file named, the errors of run_upload.
  static Result<CudaScene> upload(const Scene& scene, uint64_t budget_bytes, uint64_t reserved_bytes, uint32_t threads,
                                  Reading reading = Reading::kAuto, uint64_t texture_cache = kDeviceTextureCache,
                                  const kernels::SceneView* streamed = nullptr, uint64_t host_memory = 0,
                                  JobProgress* progress = nullptr, const PageShare* share = nullptr,
                                  uint64_t more_texture_room = 0);

  /// The device memory that upload() takes, without `reserved_bytes` and `more_texture_room`.
  static uint64_t device_bytes(const Scene& scene, const kernels::SceneView* streamed, uint64_t texture_cache,
                               const PageShare* share = nullptr);

  /// Adds the pages of other devices to view(). The current device, which has this scene, reads their memory. Errors
  /// kDevice.
  Result<void> add_pages_of(std::span<const CudaScene> others);
  /// Copies the pages of other devices to the current one, which has this scene, and adds them to view(). Waits. `all`:
  /// this scene and the others. Errors kDevice.
  Result<void> copy_pages_of(std::span<const CudaScene> all);
  /// The device memory that copy_pages_of() takes.
  uint64_t copied_bytes_of(std::span<const CudaScene> all) const;

  /// The view of the uploaded scene; all its pointers are to device memory.
  const kernels::SceneView& view() const { return view_; }
  /// The cache of the textures' JPEG and paged levels; null if there are none. Stays at its place if this is moved.
  kernels::CudaTextureCache* texture_cache() const { return cache_.get(); }
  /// The pages of block images that are read when pixels show them; null if there are none. Likewise.
  DeviceBlockPager* block_pager() const { return pager_.get(); }
  /// DeviceBlockPager::keep_in_host_memory(), if there are pages and `bytes` is not 0. Errors as there, with the file.
  Result<void> keep_textures(const Scene& scene, uint64_t bytes);
  /// A JPEG level by number, in device memory. Requires that the scene has JPEG levels.
  const kernels::JpegLevel* jpeg_level(uint32_t number) const { return jpeg_levels_ + number; }
  /// device_bytes: the arena, the texture cache, the pages of textures and `reserved_bytes`; and copied pages.
  const UploadStats& stats() const { return stats_; }
  uint64_t arena_bytes() const { return arena_.bytes(); }

 private:
  bool has_copied(const std::byte* page) const { return page >= first_page_ && page < first_page_ + page_bytes_; }
  Result<void> replace_page_table();

  kernels::DeviceBuffer arena_;
  const std::byte* first_page_ = nullptr;  // that upload() has copied
  uint64_t page_bytes_ = 0;
  kernels::DeviceBuffer copied_pages_;  // of other devices
  std::unique_ptr<DeviceBlockPager> pager_;
  std::unique_ptr<kernels::CudaTextureCache> cache_;
  const kernels::JpegLevel* jpeg_levels_ = nullptr;
  kernels::SceneView view_{};
  std::vector<const std::byte*> pages_;  // as view_.pages, in host memory
  kernels::DeviceBuffer shared_pages_;   // view_.pages after add_pages_of() or copy_pages_of()
  UploadStats stats_;
};

}  // namespace scree::runtime
