// One scene of a .scree file, ready to draw: pages loaded and checked, textures decoded.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"
#include "kernels/shade/jpeg_group_cache.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/pages.h"
#include "runtime/textures/block_image.h"
#include "runtime/textures/block_pager.h"
#include "runtime/textures/jpeg_image.h"
#include "runtime/textures/texture.h"
#include "runtime/threads/job_progress.h"
#include "runtime/threads/stopwatch.h"

namespace scree::runtime {

/// A mapped and opened .scree file: its records, without any page. Copies share the map.
class SceneFile {
 public:
  /// Errors as MappedFile::open and Container::open, with the file.
  static Result<SceneFile> open(const std::string& path);

  const MappedFile& map() const { return *map_; }
  const format::Container& container() const { return container_; }
  const std::string& path() const { return map_->path(); }

  /// The scene of that name, else of that number. If the argument is empty: the document's default scene, else its
  /// first. Errors kUsage (no such scene, with a list of the existing ones), kUnsupported (the file has no scene).
  Result<uint32_t> find_scene(const std::string& name_or_index) const;

 private:
  std::shared_ptr<const MappedFile> map_ = std::make_shared<const MappedFile>();
  format::Container container_;
};

/// Default cache sizes for decoded blocks of JPEG textures on a CPU and a GPU, bytes.
inline constexpr uint64_t kHostTextureCache = uint64_t{64} << 20;
inline constexpr uint64_t kDeviceTextureCache = uint64_t{256} << 20;
/// Default of SceneOptions::texture_memory.
inline constexpr uint64_t kHostTextureMemory = uint64_t{2} << 30;

struct SceneOptions {
  bool textures = true;  // false: texture views have no texels
  uint32_t threads = 1;
  // Upper limit of the CPU's cache of decoded JPEG texture blocks, bytes; memory is allocated as the cache fills. Finer
  // levels are then decoded on demand. 0: all levels are decoded when the scene is loaded.
  uint64_t texture_cache = 0;
  // Upper limit of the host memory, in bytes, for pages of block images and JPEGs, which are read when pixels show
  // them. If the JPEGs' levels 0 fit it together, JPEGs stay in the map, unless device_texture_memory is set. 0: all
  // pages are read when the scene is loaded.
  uint64_t texture_memory = 0;
  Reading reading = Reading::kAuto;  // how these pages are read into host memory
  // The same for GPU memory if a GPU draws the scene (set_texture_memory()). Pages may take more, up to
  // device_texture_limit, if geometry leaves room. If chunks are streamed too, pages may get less.
  uint64_t device_texture_memory = 0;
  uint64_t device_texture_limit = 0;                      // a smaller one counts as device_texture_memory
  kernels::Lighting lighting = kernels::Lighting::kAuto;  // light of the pictures; its data are made at loading
  std::string environment{};                              // a Radiance picture for kEnvironment; empty: make_sky()
  bool pages = true;                // false: view().pages are null until load_pages(); for scenes that a GPU draws
  JobProgress* progress = nullptr;  // reports every page and image, and may stop the loading
};

struct LoadStats {
  uint64_t pages = 0;          // geometry pages loaded and checked
  uint64_t stored_bytes = 0;   // of these pages, in the file
  uint64_t decoded_bytes = 0;  // of the compressed pages, unpacked in memory
  uint64_t images = 0;
  uint64_t texture_bytes = 0;  // of their decoded levels
  uint64_t jpeg_bytes = 0;     // of the levels that stay JPEGs, with their tables
  uint64_t masks = 0;          // alpha masks of the drawn meshes
  uint64_t mask_bytes = 0;     // of the masks' levels, each page counted once
  Duration geometry;
  Duration textures;
};

/// Owns the data behind view(). Raw pages are used in the map; only compressed pages have a copy.
class Scene {
 public:
  /// Loads scene number `scene` (below the container's count): assigns triangle ids to its instances, loads its pages
  /// unless SceneOptions::pages is false, and loads each image of its materials once. Errors, with file and place:
  /// errors of load_pages(); for an image kRange, kFormat, kTrailing, kTruncated; kRange (more than 2^36 - 1 drawn
  /// triangles); kMemory.
  static Result<Scene> load(SceneFile file, uint32_t scene, const SceneOptions& options);

  /// Opens `path` and loads its default scene. Errors as SceneFile::open, find_scene and load.
  static Result<Scene> open(const std::string& path, const SceneOptions& options);

  Scene(Scene&&) = default;
  Scene& operator=(Scene&&) = default;

  /// Loads the pages that the scene's instances use and validates all of their chunks. Does nothing if that is done.
  /// Errors, with file and place: errors of runtime::load_pages.
  Result<void> load_pages(uint32_t threads, JobProgress* progress = nullptr);
  /// Whether view().pages has all pages that the scene draws, as the CPU needs them.
  bool has_pages() const { return has_pages_; }
  /// The pages that the scene draws.
  const DrawnPages& drawn_pages() const { return drawn_pages_; }

  /// The raw bytes of a geometry page: of the loaded page, else read from the file into `scratch`. Errors as
  /// Container::load_page, with the file.
  Result<std::span<const std::byte>> page(uint32_t page, std::vector<std::byte>& scratch) const;

  const SceneFile& file() const { return file_; }
  const format::Container& container() const { return file_.container(); }
  uint32_t scene_index() const { return scene_; }
  const kernels::SceneView& view() const { return view_; }
  /// scene_box() of everything that the scene draws, computed once. Thread-safe.
  const WorldBox& box() const;
  const LoadStats& stats() const { return stats_; }
  /// Cache of the JPEG textures' blocks; null if there are none.
  const kernels::JpegGroupCache* jpeg_group_cache() const { return blocks_.get(); }
  /// The pages of block images and JPEGs that stay in the file; null if there are none.
  HostBlockPager* block_pager() const { return pager_.get(); }
  uint64_t device_texture_memory() const { return device_texture_memory_; }  // of SceneOptions
  uint64_t device_texture_limit() const { return device_texture_limit_; }    // at least device_texture_memory()
  /// The images that stay JPEGs, by image. Other entries have no levels.
  std::span<const JpegTexture> jpeg_textures() const { return jpegs_; }
  /// The images that stay blocks, by image. Other entries are empty.
  std::span<const BlockTexture> block_textures() const { return block_images_; }
  /// The pages of the masks in view(), each once; none if nothing is masked.
  std::span<const std::span<const std::byte>> mask_pages() const { return mask_pages_; }
  /// Bytes of the largest group of the JPEGs' levels, decoded; 0 if there are none.
  uint32_t jpeg_slot_bytes() const { return jpeg_slot_bytes_; }
  /// The groups of the JPEGs' levels.
  const kernels::JpegGroups& jpeg_groups() const { return jpeg_groups_; }

  /// Warnings of decoded images, one line each, without the file's name.
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  struct LazyBox {
    std::once_flag once;
    WorldBox box;
  };

  /// The records of a table as a contiguous array: the table itself, or a copy if the table is small or a newer file
  /// has longer records.
  template <class Record>
  static const Record* dense(const format::Table<Record>& table, std::vector<Record>& copy);

  explicit Scene(SceneFile file) : file_(std::move(file)) {}
  Result<void> number_instances();
  Result<void> load_masks();
  Result<void> load_textures(const SceneOptions& options);
  Result<void> load_light(const SceneOptions& options);
  void find_surfaces();
  void place_lights();
  template <class Visit>
  void visit_drawn_textures(const Visit& visit) const;
  kernels::TextureView view_of(const format::TextureRecord& record) const;
  void number_jpeg_levels();
  void number_block_pages(const SceneOptions& options);

  SceneFile file_;
  uint32_t scene_ = 0;
  kernels::SceneView view_{};
  std::vector<format::MeshRecord> meshes_;
  std::vector<format::ChunkRecord> chunks_;
  std::vector<format::InstanceRecord> instances_;
  std::vector<format::MatrixRecord> matrices_;
  std::vector<format::MaterialRecord> materials_;
  std::vector<format::SurfaceRecord> surfaces_;
  std::vector<kernels::MaterialView> material_views_;
  std::vector<kernels::PlacedLight> lights_;
  std::vector<float> environment_;
  std::vector<uint64_t> instance_base_;
  std::vector<bool> mesh_drawn_;
  DrawnPages drawn_pages_;
  PageSet pages_;
  bool has_pages_ = false;
  std::vector<MipChain> mips_;              // by image; empty if no drawn material uses it,
  std::vector<JpegTexture> jpegs_;          // or if the image is here,
  std::vector<BlockTexture> block_images_;  // or here
  uint32_t jpeg_slot_bytes_ = 0;
  kernels::JpegGroups jpeg_groups_;
  std::unique_ptr<kernels::JpegGroupCache> blocks_;
  std::unique_ptr<HostBlockPager> pager_;
  uint64_t device_texture_memory_ = 0;
  uint64_t device_texture_limit_ = 0;
  std::vector<kernels::TextureView> textures_;
  std::vector<kernels::MaskView> masks_;                // one per material; empty if nothing is masked
  std::vector<kernels::MaskView> blend_masks_;          // the same for blended materials
  std::vector<std::span<const std::byte>> mask_pages_;  // in the mapped file or in
  std::vector<std::vector<std::byte>> unpacked_masks_;  // pages that had to be unpacked
  std::vector<std::string> warnings_;
  LoadStats stats_;
  std::unique_ptr<LazyBox> box_ = std::make_unique<LazyBox>();
};

}  // namespace scree::runtime
