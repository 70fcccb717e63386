#include "runtime/draw/cuda_upload.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "kernels/shade/environment.h"
#include "runtime/draw/page_joins.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::DeviceBuffer;

namespace {

/// The ring in pinned memory, with one event per slot. Copies are queued on two streams, so that one copies while the
/// next is set up. Split pages have slots of their own.
class PinnedRing final : public UploadTarget {
 public:
  PinnedRing() = default;
  PinnedRing(const PinnedRing&) = delete;
  PinnedRing& operator=(const PinnedRing&) = delete;
  ~PinnedRing() {
    for (const kernels::DeviceStream& stream : streams_)
      if (stream != nullptr) (void)cudaStreamSynchronize(stream);
  }

  Result<void> open(const StagingSizes& sizes, const PageJoins::Sizes& joins, std::byte* arena) {
    slot_bytes_ = sizes.slot_bytes;
    arena_ = arena;
    SCREE_TRY(cuda_check(cudaGetDevice(&device_), "asking for the current GPU"));
    SCREE_TRY(memory_.allocate_for_copies(sizes.bytes(), "allocating pinned memory"));
    for (kernels::DeviceStream& stream : streams_) SCREE_TRY(stream.make(cudaStreamNonBlocking));
    copied_.resize(sizes.slots);
    for (kernels::DeviceEvent& event : copied_) SCREE_TRY(event.make(cudaEventDisableTiming | cudaEventBlockingSync));
    if (!joins.any()) return {};
    joins_.emplace();
    SCREE_TRY(joins_->open(joins, device_, arena));
    return joins_->begin(0, nullptr, nullptr);
  }

  std::byte* slot(uint32_t slot) override { return memory_.data() + slot * slot_bytes_; }

  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) override {
    constexpr const char* kWhat = "copying to the device";
    const cudaStream_t stream = streams_[slot % std::size(streams_)];
    SCREE_TRY(cuda_check(cudaSetDevice(device_), "choosing the GPU"));  // each thread has a current device of its own
    SCREE_TRY(cuda_check(cudaMemcpyAsync(arena_ + to, this->slot(slot), bytes, cudaMemcpyHostToDevice, stream), kWhat));
    return cuda_check(cudaEventRecord(copied_[slot], stream), kWhat);
  }

  Result<void> wait(uint32_t slot) override {
    return cuda_check(cudaEventSynchronize(copied_[slot]), "waiting for a copy");
  }

  JoinTarget* joins() override { return joins_ ? &*joins_ : nullptr; }
  Result<bool> finish_joins() override {
    const Result<void> ended = joins_->end(streams_[0]);
    SCREE_TRY(cuda_check(cudaStreamSynchronize(streams_[0]), "joining pages"));
    if (!ended) return ended.error();
    return joins_->has_joined(0);
  }

 private:
  kernels::PinnedBuffer memory_;
  uint64_t slot_bytes_ = 0;
  std::byte* arena_ = nullptr;
  int device_ = 0;
  kernels::DeviceStream streams_[2];
  std::vector<kernels::DeviceEvent> copied_;
  std::optional<PageJoins> joins_;
};

/// The rest of the budget.
Result<uint64_t> check_budget(uint64_t needed, uint64_t budget_bytes) {
  const uint64_t budget = SCREE_TRY(device_budget(budget_bytes));
  if (needed <= budget) return budget - needed;
  return Error{ErrorCode::kDevice, "the scene takes " + std::to_string(needed) + " bytes of device memory, but " +
                                       std::to_string(budget) + " are " +
                                       (budget == budget_bytes ? "allowed" : "free")};
}

uint64_t texel_bytes(const kernels::TextureView& texture) {
  const uint32_t last = texture.level_count - 1;
  return 4 * (texture.level_offset[last] +
              uint64_t{std::max(texture.width >> last, 1u)} * std::max(texture.height >> last, 1u));
}

/// The scene's JPEG levels by number, while they are copied to the device. Paged levels have their bytes in pages.
class UploadedJpegs {
 public:
  void add_to(UploadPlan& plan, const Scene& scene) {
    for (const JpegTexture& jpeg : scene.jpeg_textures()) {
      for (size_t l = 0; l < jpeg.jpeg_levels().size(); ++l) {
        levels_.push_back(jpeg.jpeg_levels()[l]);
        places_.push_back({});
        if (l < jpeg.paged_levels()) continue;
        const std::span<const std::byte> bytes = jpeg.level_bytes(l);
        const std::vector<format::JpegHuffmanTable>& tables = jpeg.index(l).tables;
        places_.back() = {plan.add(bytes.data(), bytes.size()), plan.add_array(tables.data(), tables.size()),
                          plan.add_array(jpeg.factors(l).data(), jpeg.factors(l).size())};
      }
    }
    table_ = plan.add_array(levels_.data(), levels_.size());
  }

  /// Makes the pointers in the levels, and the pointers of `textures` to levels, point into the arena at `base`.
  void move_to(const std::byte* base, std::span<kernels::TextureView> textures) {
    for (kernels::TextureView& texture : textures)
      if (texture.jpeg_level_count != 0) texture.jpeg = table(base) + texture.jpeg[0].number;
    for (size_t i = 0; i < levels_.size(); ++i) {
      if (levels_[i].page != kernels::JpegLevel::kNotPaged) continue;
      format::JpegView& view = levels_[i].picture.view;
      move_jpeg_view(view, base + places_[i].bytes);
      view.tables = reinterpret_cast<const format::JpegHuffmanTable*>(base + places_[i].tables);
      levels_[i].picture.factors = reinterpret_cast<const uint32_t*>(base + places_[i].factors);
    }
  }

  const kernels::JpegLevel* table(const std::byte* base) const {
    return reinterpret_cast<const kernels::JpegLevel*>(base + table_);
  }

 private:
  struct Place {
    uint64_t bytes;
    uint64_t tables;
    uint64_t factors;
  };
  std::vector<kernels::JpegLevel> levels_;
  std::vector<Place> places_;
  uint64_t table_ = 0;
};

/// The layout of a scene in the arena. The tables of pointers are filled once its address is known.
struct ArenaLayout {
  /// `streamed`, `share`: as for CudaScene::upload.
  ArenaLayout(const Scene& scene, const kernels::SceneView* streamed, const PageShare* share) {
    const kernels::SceneView& host = streamed != nullptr ? *streamed : scene.view();
    pages.resize(streamed != nullptr ? host.chunk_count : scene.container().pages().size());
    textures.assign(host.textures, host.textures + host.texture_count);
    for (const kernels::MaskView* const of : {host.masks, host.blend_masks})
      if (of != nullptr) masks.insert(masks.end(), of, of + host.material_count);
    const auto add_table = [&]<class T>(const T* kernels::SceneView::*table, uint64_t count) {
      const uint64_t offset = plan.add_array(host.*table, count);
      tables.push_back([table, offset](kernels::SceneView& view, const std::byte* base) {
        view.*table = reinterpret_cast<const T*>(base + offset);
      });
    };
    using kernels::SceneView;
    add_table(&SceneView::meshes, host.mesh_count);
    add_table(&SceneView::chunks, host.chunk_count);
    add_table(&SceneView::instances, host.instance_count);
    add_table(&SceneView::instance_base, host.instance_count + 1);
    add_table(&SceneView::matrices, host.matrix_count);
    add_table(&SceneView::materials, host.material_count);
    add_table(&SceneView::surfaces, host.surface_count);
    add_table(&SceneView::material_views, host.material_count);
    add_table(&SceneView::lights, host.light_count);
    if (host.environment != nullptr) add_table(&SceneView::environment, kernels::kEnvironmentFloats);
    texture_views = plan.add_array(textures.data(), textures.size());
    page_table = plan.add_array(pages.data(), pages.size());
    for (const kernels::TextureView& texture : textures) {
      if (texture.texels == nullptr || texel_offset.contains(texture.texels)) continue;
      texel_offset[texture.texels] = plan.add(texture.texels, texel_bytes(texture));
    }
    for (const BlockTexture& image : scene.block_textures())
      if (!image.empty())
        block_offset[reinterpret_cast<const uint8_t*>(image.blocks().data())] =
            plan.add(image.blocks().data(), image.blocks().size());
    for (const std::span<const std::byte> page : scene.mask_pages())
      mask_offset[reinterpret_cast<const uint8_t*>(page.data())] = plan.add(page.data(), page.size());
    mask_views = plan.add_array(masks.data(), masks.size());
    levels.add_to(plan, scene);
    if (streamed != nullptr) return;
    if (share != nullptr)
      own_pages = scene.drawn_pages().subset([&](uint64_t i) { return share->owners[i] == share->owner; });
    const DrawnPages& drawn = share != nullptr ? own_pages : scene.drawn_pages();
    drawn_pages = &drawn;
    page_offset.resize(pages.size());
    if (!scene.has_pages()) plan.add_pages(drawn);
    for (uint64_t i = 0; i < drawn.size(); ++i)
      page_offset[drawn.page(i)] =
          scene.has_pages() ? plan.add(host.pages[drawn.page(i)], drawn.record(i).raw_bytes) : plan.page_offset(i);
  }
  ArenaLayout(const ArenaLayout&) = delete;
  ArenaLayout& operator=(const ArenaLayout&) = delete;

  /// The place of the pages in the arena, and their bytes with the gaps between them.
  std::pair<uint64_t, uint64_t> page_range() const {
    uint64_t first = UINT64_MAX, end = 0;
    for (uint64_t i = 0; drawn_pages != nullptr && i < drawn_pages->size(); ++i) {
      const uint64_t offset = page_offset[drawn_pages->page(i)];
      first = std::min(first, offset);
      end = std::max(end, offset + drawn_pages->record(i).raw_bytes);
    }
    return first < end ? std::pair(first, end - first) : std::pair<uint64_t, uint64_t>(0, 0);
  }

  UploadPlan plan;
  DrawnPages own_pages;                     // of a share
  const DrawnPages* drawn_pages = nullptr;  // the pages that go to the device; null if pages are streamed
  std::vector<const std::byte*> pages;
  std::vector<kernels::TextureView> textures;
  std::map<const uint8_t*, uint64_t> texel_offset;  // several textures may show one image
  std::map<const uint8_t*, uint64_t> block_offset;  // likewise
  std::vector<kernels::MaskView> masks;             // SceneView::masks, then blend_masks
  std::map<const uint8_t*, uint64_t> mask_offset;   // several masks may have one page
  std::vector<uint64_t> page_offset;                // empty if pages are streamed
  UploadedJpegs levels;
  /// Make a table of the view point into the arena, whose address is given.
  std::vector<std::function<void(kernels::SceneView&, const std::byte*)>> tables;
  uint64_t texture_views;
  uint64_t mask_views;
  uint64_t page_table;
};

/// The sizes of staging memory: at most `host_memory`, and at least one page. 0: all that an upload can use.
StagingSizes staging_within(uint64_t host_memory) {
  StagingSizes most;
  if (host_memory == 0) return most;
  const uint64_t quarter = host_memory / 4 / format::kPageAlignment * format::kPageAlignment;
  most.slot_bytes = std::clamp<uint64_t>(quarter, format::kPageAlignment, most.slot_bytes);
  most.slots = static_cast<uint32_t>(std::clamp<uint64_t>(host_memory / most.slot_bytes, 1, most.slots));
  return most;
}

/// The memory that an upload goes through.
struct UploadMemory {
  StagingSizes ring;
  PageJoins::Sizes joins;  // none: split pages are joined on the CPU
};

/// For a plan. All pinned memory stays within `most`, and the device's within half of `free_bytes`, because kernels
/// need memory for their code.
UploadMemory memory_for(const UploadPlan& plan, Reading reading, uint32_t threads, const StagingSizes& most,
                        uint64_t free_bytes) {
  const StagingSizes all = staging_for(plan, reading, threads, most);
  if (all.join_jobs == 0) return {all, {}};
  StagingSizes half = most;
  half.slots = std::max(most.slots / 2, 1u);
  const StagingSizes ring = staging_for(plan, reading, threads, half, true);
  const PageJoins::Work work{ring.slot_bytes, ring.join_slot_bytes(), ring.join_jobs, threads_for(reading, threads)};
  const PageJoins::Sizes joins =
      PageJoins::sizes_for(work, free_bytes / 2, most.bytes() - std::min(most.bytes(), ring.bytes()));
  return joins.any() ? UploadMemory{ring, joins} : UploadMemory{all, {}};
}

/// Device memory of the texture cache and the pager, without the room for pages.
uint64_t cache_bytes_of(const Scene& scene, uint64_t texture_cache) {
  const kernels::JpegGroups groups = scene.jpeg_groups();
  const bool has_pages = scene.block_pager() != nullptr;
  if (groups.count == 0 && !has_pages) return 0;
  return kernels::CudaTextureCache::device_bytes(texture_cache, groups) +
         (has_pages ? DeviceBlockPager::table_bytes(scene) : 0);
}

/// The least room for pages of textures beside a resident scene. A streamed one shares memory with chunks.
uint64_t own_room(const Scene& scene, const kernels::SceneView* streamed) {
  return streamed == nullptr ? DeviceBlockPager::usual_room(scene) : 0;
}

}  // namespace

Result<uint64_t> device_budget(uint64_t budget_bytes) {
  size_t free_bytes = 0;
  size_t total_bytes = 0;
  SCREE_TRY(cuda_check(cudaMemGetInfo(&free_bytes, &total_bytes), "asking for free device memory"));
  return budget_bytes == 0 ? uint64_t{free_bytes} : std::min<uint64_t>(budget_bytes, free_bytes);
}

uint64_t CudaScene::device_bytes(const Scene& scene, const kernels::SceneView* streamed, uint64_t texture_cache,
                                 const PageShare* share) {
  return ArenaLayout(scene, streamed, share).plan.bytes() + cache_bytes_of(scene, texture_cache) +
         own_room(scene, streamed);
}

Result<void> CudaScene::keep_textures(const Scene& scene, uint64_t bytes) {
  if (pager_ == nullptr || bytes == 0) return {};
  const Result<void> kept = pager_->keep_in_host_memory(bytes);
  return kept || kept.error().code == ErrorCode::kDevice ? kept : at(scene.file().path(), kept.error());
}

Result<void> CudaScene::add_pages_of(std::span<const CudaScene> others) {
  for (const CudaScene& other : others)
    for (size_t page = 0; page < pages_.size(); ++page)
      if (other.pages_[page] != nullptr) pages_[page] = other.pages_[page];
  return replace_page_table();
}

uint64_t CudaScene::copied_bytes_of(std::span<const CudaScene> all) const {
  uint64_t bytes = 0;
  for (const CudaScene& other : all)
    if (&other != this) bytes += format::align_up(other.page_bytes_, format::kPageAlignment);
  return bytes;
}

Result<void> CudaScene::copy_pages_of(std::span<const CudaScene> all) {
  constexpr const char* kWhat = "copying other GPUs' pages";
  const uint64_t bytes = copied_bytes_of(all);
  SCREE_TRY(copied_pages_.reserve(std::max<uint64_t>(bytes, 1), "allocating other GPUs' pages"));
  std::byte* to = copied_pages_.data();
  for (const CudaScene& other : all) {
    if (&other == this || other.page_bytes_ == 0) continue;
    SCREE_TRY(cuda_check(cudaMemcpyAsync(to, other.first_page_, other.page_bytes_, cudaMemcpyDefault, nullptr), kWhat));
    for (size_t page = 0; page < pages_.size(); ++page)
      if (other.has_copied(other.pages_[page])) pages_[page] = to + (other.pages_[page] - other.first_page_);
    to += format::align_up(other.page_bytes_, format::kPageAlignment);
  }
  SCREE_TRY(cuda_check(cudaStreamSynchronize(nullptr), kWhat));
  stats_.device_bytes += bytes;
  return replace_page_table();
}

/// Makes view().pages a table of pages_.
Result<void> CudaScene::replace_page_table() {
  const uint64_t bytes = pages_.size() * sizeof(pages_[0]);
  SCREE_TRY(shared_pages_.reserve(std::max<uint64_t>(bytes, 1), "allocating the table of pages"));
  view_.pages = reinterpret_cast<const std::byte* const*>(shared_pages_.data());
  return cuda_check(cudaMemcpy(shared_pages_.data(), pages_.data(), bytes, cudaMemcpyHostToDevice),
                    "copying the table of pages");
}

Result<CudaScene> CudaScene::upload(const Scene& scene, uint64_t budget_bytes, uint64_t reserved_bytes,
                                    uint32_t threads, Reading reading, uint64_t texture_cache,
                                    const kernels::SceneView* streamed, uint64_t host_memory, JobProgress* progress,
                                    const PageShare* share, uint64_t more_texture_room) {
  const auto start = std::chrono::steady_clock::now();
  ArenaLayout layout(scene, streamed, share);
  const UploadPlan& plan = layout.plan;
  const kernels::JpegGroups groups = scene.jpeg_groups();
  const uint64_t room = own_room(scene, streamed) + more_texture_room;
  const uint64_t needed = plan.bytes() + cache_bytes_of(scene, texture_cache) + room + reserved_bytes;
  const uint64_t left = SCREE_TRY(check_budget(needed, budget_bytes));
  DeviceBuffer arena = SCREE_TRY(DeviceBuffer::allocate(std::max<uint64_t>(plan.bytes(), 1), "allocating the scene"));
  std::byte* const base = arena.data();
  if (const DrawnPages* const drawn = layout.drawn_pages)
    for (uint64_t i = 0; i < drawn->size(); ++i)
      layout.pages[drawn->page(i)] = base + layout.page_offset[drawn->page(i)];
  const auto [first_page, page_bytes] = layout.page_range();
  for (kernels::TextureView& texture : layout.textures) {
    if (texture.texels != nullptr)
      texture.texels = reinterpret_cast<const uint8_t*>(base + layout.texel_offset[texture.texels]);
    if (texture.blocks != nullptr)
      texture.blocks = reinterpret_cast<const uint8_t*>(base + layout.block_offset[texture.blocks]);
  }
  for (kernels::MaskView& mask : layout.masks)
    if (mask.alpha != nullptr) mask.alpha = reinterpret_cast<const uint8_t*>(base + layout.mask_offset[mask.alpha]);
  layout.levels.move_to(base, layout.textures);

  const MappedFile& map = scene.file().map();
  const Reading chosen = choose_reading(plan, map, reading);
  const UploadMemory memory = memory_for(plan, chosen, threads, staging_within(host_memory), left);
  PinnedRing ring;
  SCREE_TRY(ring.open(memory.ring, memory.joins, base));
  const Result<UploadCounts> counts = run_upload(plan, map, ring, memory.ring, chosen, threads, progress);
  if (!counts && counts.error().code == ErrorCode::kDevice) return counts.error();
  if (!counts) return at(scene.file().path(), counts.error());

  CudaScene copy;
  if (scene.block_pager() != nullptr) {
    copy.pager_ = SCREE_TRY(DeviceBlockPager::create(scene, threads, host_memory, reading, room));
  }
  if (groups.count != 0 || copy.pager_ != nullptr) {
    kernels::CudaTextureCache cache = SCREE_TRY(
        kernels::CudaTextureCache::create(layout.levels.table(base), texture_cache, groups, copy.pager_.get()));
    copy.cache_ = std::make_unique<kernels::CudaTextureCache>(std::move(cache));
    copy.jpeg_levels_ = layout.levels.table(base);
  }
  copy.arena_ = std::move(arena);
  copy.first_page_ = base + first_page;
  copy.page_bytes_ = page_bytes;
  copy.view_ = scene.view();
  copy.view_.blocks = nullptr;
  copy.view_.pager = nullptr;
  for (const auto& move_table : layout.tables) move_table(copy.view_, base);
  copy.view_.textures = reinterpret_cast<const kernels::TextureView*>(base + layout.texture_views);
  copy.view_.texture_count = layout.textures.size();
  const auto* const masks = reinterpret_cast<const kernels::MaskView*>(base + layout.mask_views);
  if (copy.view_.blend_masks != nullptr)
    copy.view_.blend_masks = masks + (copy.view_.masks != nullptr ? copy.view_.material_count : 0);
  if (copy.view_.masks != nullptr) copy.view_.masks = masks;
  copy.view_.pages = reinterpret_cast<const std::byte* const*>(base + layout.page_table);
  copy.pages_ = std::move(layout.pages);
  copy.stats_.counts = *counts;
  copy.stats_.device_bytes = needed;
  copy.stats_.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return Result<CudaScene>(std::move(copy));
}

}  // namespace scree::runtime
