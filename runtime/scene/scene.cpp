#include "runtime/scene/scene.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <new>
#include <span>
#include <utility>

#include "format/bytes.h"
#include "format/text.h"
#include "kernels/shade/material_views.h"
#include "kernels/visbuffer.h"
#include "runtime/images/image.h"
#include "runtime/light/environment.h"
#include "runtime/textures/jpeg_image.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

std::string quoted_list(const format::Container& container) {
  std::string text;
  const auto scenes = container.scenes();
  for (uint64_t i = 0; i < scenes.size() && i < 20; ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(i);
    text += format::in_brackets(container.string(scenes[i].name));
  }
  return scenes.size() > 20 ? text + ", ..." : text;
}

/// Decodes an image page and checks it against its record.
Result<MipChain> load_image(const format::Container& container, uint32_t index, TexelCoding coding,
                            std::string& warning) {
  const format::ImageRecord& record = container.images()[index];
  if (record.codec == format::ImageCodec::kIndexedJpeg) {
    const JpegImage image = SCREE_TRY(JpegImage::open(container, index));
    return image.decode(coding);
  }
  std::vector<std::byte> scratch;
  const std::span<const std::byte> file = SCREE_TRY(container.load_page(record.page, scratch));
  const ImageInfo info = SCREE_TRY(probe_image(file));
  if (info.codec != record.codec || info.is_webp)
    return Error{ErrorCode::kFormat, "the image's codec differs from its record's codec"};
  Image image = SCREE_TRY(decode_image(file));
  if (image.width != record.width || image.height != record.height)
    return Error{ErrorCode::kFormat, "the image is " + std::to_string(image.width) + " x " +
                                         std::to_string(image.height) + ", but its record gives " +
                                         std::to_string(record.width) + " x " + std::to_string(record.height)};
  warning = std::move(image.warning);
  return make_mips(std::move(image), coding);
}

std::string image_place(const format::Container& container, uint32_t index) {
  std::string place = "image " + std::to_string(index);
  const std::string_view name = container.string(container.images()[index].name);
  if (!name.empty()) place.append(" (").append(name).append(")");
  return place;
}

/// If the file is truncated while mapped, the rest of its last page reads as zeros (MappedFile). Record fields bound
/// loops, so tables of up to this many bytes are copied before they are used.
constexpr uint64_t kMostCopiedBytes = uint64_t{16} << 20;

}  // namespace

Result<SceneFile> SceneFile::open(const std::string& path) {
  SceneFile file;
  MappedFile map = SCREE_TRY(MappedFile::open(path));
  file.map_ = std::make_shared<const MappedFile>(std::move(map));
  file.container_ = SCREE_TRY_AT(path, format::Container::open(file.map().bytes()));
  return file;
}

Result<uint32_t> SceneFile::find_scene(const std::string& name_or_index) const {
  const auto scenes = container_.scenes();
  if (scenes.empty())
    return Error{ErrorCode::kUnsupported,
                 path() + ": has no scene to draw; if it is a shard of a conversion, scree merge joins all shards"};
  if (name_or_index.empty()) {
    for (uint64_t i = 0; i < scenes.size(); ++i)
      if (scenes[i].flags & 1) return static_cast<uint32_t>(i);
    return 0u;
  }
  for (uint64_t i = 0; i < scenes.size(); ++i)
    if (container_.string_is(scenes[i].name, name_or_index)) return static_cast<uint32_t>(i);
  uint32_t index = 0;
  const char* const end = name_or_index.data() + name_or_index.size();
  const auto [rest, status] = std::from_chars(name_or_index.data(), end, index);
  if (status == std::errc{} && rest == end && index < scenes.size()) return index;
  return Error{ErrorCode::kUsage,
               path() + ": no scene '" + name_or_index + "', expected one of " + quoted_list(container_)};
}

template <class Record>
const Record* Scene::dense(const format::Table<Record>& table, std::vector<Record>& copy) {
  if (table.empty()) return nullptr;
  const bool is_dense = table.size() == 1 || &table[0] + 1 == &table[1];
  if (is_dense && table.size() > kMostCopiedBytes / sizeof(Record)) return &table[0];
  copy.reserve(table.size());
  for (uint64_t i = 0; i < table.size(); ++i) copy.push_back(table[i]);
  return copy.data();
}

Result<Scene> Scene::open(const std::string& path, const SceneOptions& options) {
  SceneFile file = SCREE_TRY(SceneFile::open(path));
  const uint32_t number = SCREE_TRY(file.find_scene(""));
  return load(std::move(file), number, options);
}

Result<Scene> Scene::load(SceneFile file, uint32_t scene_index, const SceneOptions& options) {
  Scene scene(std::move(file));
  const std::string& path = scene.file_.path();
  const format::Container& container = scene.container();
  scene.scene_ = scene_index;
  try {
    kernels::SceneView& view = scene.view_;
    view.meshes = dense(container.meshes(), scene.meshes_);
    view.mesh_count = container.meshes().size();
    view.chunks = dense(container.chunks(), scene.chunks_);
    view.chunk_count = container.chunks().size();
    view.chunk_kinds = kernels::kinds_of({view.meshes, view.mesh_count}, {view.chunks, view.chunk_count});
    view.matrices = dense(container.matrices(), scene.matrices_);
    view.matrix_count = container.matrices().size();
    view.materials = dense(container.materials(), scene.materials_);
    view.material_count = container.materials().size();
    view.surfaces = dense(container.surfaces(), scene.surfaces_);
    const format::SceneRecord& record = container.scenes()[scene_index];
    const format::InstanceRecord* const instances = dense(container.instances(), scene.instances_);
    view.instances = record.instance_count == 0 ? nullptr : instances + record.first_instance;
    view.instance_count = record.instance_count;

    SCREE_TRY_AT(path, scene.number_instances());
    scene.drawn_pages_ = DrawnPages(container, scene.mesh_drawn_);
    scene.pages_.raw.assign(container.pages().size(), nullptr);
    view.pages = scene.pages_.raw.data();
    if (options.pages) SCREE_TRY(scene.load_pages(options.threads, options.progress));
    scene.find_surfaces();
    scene.place_lights();
    const Stopwatch texture_watch;
    SCREE_TRY_AT(path, scene.load_masks());
    SCREE_TRY_AT(path, scene.load_textures(options));
    kernels::bundle_textures(view, scene.material_views_);
    scene.stats_.textures = texture_watch.elapsed();
    SCREE_TRY(scene.load_light(options));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to load it"};
  }
  return scene;
}

Result<void> Scene::number_instances() {
  instance_base_.assign(view_.instance_count + 1, 0);
  mesh_drawn_.assign(view_.mesh_count, false);
  for (uint64_t i = 0; i < view_.instance_count; ++i) {
    const uint32_t mesh = view_.instances[i].mesh;
    mesh_drawn_[mesh] = true;
    const auto sum = format::checked_add(instance_base_[i], view_.meshes[mesh].triangle_count);
    // The last id stands for the background, so a scene may have at most 2^36 - 1 triangles.
    if (!sum || *sum > kernels::kIdMask)
      return Error{ErrorCode::kRange, "scene " + std::to_string(scene_) + " draws more than " +
                                          std::to_string(kernels::kIdMask) +
                                          " triangles (2^36 - 1), the most that ids can distinguish"};
    instance_base_[i + 1] = *sum;
  }
  view_.instance_base = instance_base_.data();
  return {};
}

Result<void> Scene::load_pages(uint32_t threads, JobProgress* progress) {
  if (has_pages_) return {};
  const Stopwatch watch;
  pages_ = SCREE_TRY_AT(file_.path(), runtime::load_pages(drawn_pages_, file_.map(), threads, progress));
  view_.pages = pages_.raw.data();
  has_pages_ = true;
  stats_.pages = pages_.page_count;
  stats_.stored_bytes = pages_.stored_bytes;
  stats_.decoded_bytes = pages_.decoded_bytes;
  stats_.geometry = watch.elapsed();
  return {};
}

const WorldBox& Scene::box() const {
  std::call_once(box_->once, [&] { box_->box = scene_box(view_); });
  return box_->box;
}

Result<std::span<const std::byte>> Scene::page(uint32_t page, std::vector<std::byte>& scratch) const {
  if (view_.pages[page] != nullptr)
    return std::span<const std::byte>(view_.pages[page], container().pages()[page].raw_bytes);
  const std::span<const std::byte> read = SCREE_TRY_AT(file_.path(), container().load_page(page, scratch));
  return read;
}

/// Loads the masks of all drawn meshes' materials, and the alpha of blended ones. Masks decide which samples are
/// covered, so no option leaves them out.
Result<void> Scene::load_masks() {
  std::vector<uint32_t> drawn_attributes(view_.material_count, 0);  // of the meshes of each material
  for (uint64_t m = 0; m < view_.mesh_count; ++m)
    if (mesh_drawn_[m] && view_.meshes[m].material != format::kNone)
      drawn_attributes[view_.meshes[m].material] |= view_.meshes[m].attributes;
  const auto records = container().masks();
  std::map<uint32_t, std::span<const std::byte>> pages;
  for (uint64_t i = 0; i < records.size(); ++i) {
    const format::MaskRecord& record = records[i];
    const uint32_t needs = (record.flags & format::kMaskOfColors) != 0 ? format::kHasColor : format::kHasUv;
    if ((drawn_attributes[record.material] & needs) == 0) continue;
    auto [entry, is_new] = pages.try_emplace(record.page);
    if (is_new) {
      std::vector<std::byte> unpacked;
      const std::span<const std::byte> page =
          SCREE_TRY_AT("mask " + std::to_string(i), container().load_page(record.page, unpacked));
      entry->second = page;
      if (!unpacked.empty()) unpacked_masks_.push_back(std::move(unpacked));  // a move keeps the bytes' address
      mask_pages_.push_back(page);
      stats_.mask_bytes += page.size();
    }
    const format::MaterialRecord& material = view_.materials[record.material];
    const bool blends = (material.flags & format::kMaterialAlphaBlend) != 0;
    std::vector<kernels::MaskView>& masks = blends ? blend_masks_ : masks_;
    masks.resize(view_.material_count);
    kernels::MaskView& mask = masks[record.material];
    mask.alpha = reinterpret_cast<const uint8_t*>(entry->second.data());
    mask.width = record.width;
    mask.height = record.height;
    mask.level_count = record.level_count;
    mask.threshold = blends ? 1 : record.threshold;  // fully transparent samples make no layer
    std::copy(&record.place[0][0], &record.place[0][0] + 6, &mask.place[0][0]);
    mask.complete();
    mask.wrap_s = record.wrap_s;
    mask.wrap_t = record.wrap_t;
    mask.magnified_nearest = (record.flags & format::kMaskNearest) != 0;
    if (material.texture != format::kNone) {
      const uint16_t min_filter = container().textures()[material.texture].min_filter;
      mask.minified_nearest = format::takes_nearest_texel(min_filter);
      if (format::takes_finest_level(min_filter)) mask.level_count = 1;
    }
    mask.needs = needs;
    ++stats_.masks;
    if (!blends || material.base_color[3] < 1.0f) continue;
    // Where its alpha is 1, the surface belongs to the opaque picture.
    masks_.resize(view_.material_count);
    masks_[record.material] = mask;
    masks_[record.material].threshold = format::kMaxMaskThreshold;
  }
  view_.masks = masks_.empty() ? nullptr : masks_.data();
  blend_masks_.resize(view_.material_count);
  view_.blend_masks = blend_masks_.data();
  for (uint64_t m = 0; m < view_.mesh_count; ++m)
    if (mesh_drawn_[m] && kernels::may_blend(view_, view_.meshes[m])) return {};
  view_.blend_masks = nullptr;
  return {};
}

Result<void> Scene::load_textures(const SceneOptions& options) {
  const auto textures = container().textures();
  const auto images = container().images();
  textures_.resize(textures.size());
  view_.textures = textures_.data();
  view_.texture_count = textures_.size();
  if (!options.textures) return {};

  std::vector<bool> texture_drawn(textures.size(), false);
  std::vector<bool> image_drawn(images.size(), false);
  std::vector<bool> is_color(images.size(), false);  // false for numbers: normals, roughness...
  visit_drawn_textures([&](uint32_t texture, bool shows_color) {
    texture_drawn[texture] = true;
    image_drawn[textures[texture].image] = true;
    if (shows_color) is_color[textures[texture].image] = true;
  });
  std::vector<uint32_t> wanted;
  for (uint32_t i = 0; i < images.size(); ++i)
    if (image_drawn[i]) wanted.push_back(i);

  mips_.resize(images.size());
  jpegs_.resize(images.size());
  block_images_.resize(images.size());
  std::vector<Result<void>> results(wanted.size());
  std::vector<std::string> warnings(wanted.size());
  // JPEGs in the map need no rounds of shading, and the system may drop them as it drops pages.
  uint64_t jpeg_bytes = 0;
  for (const uint32_t image : wanted)
    if (images[image].codec == format::ImageCodec::kIndexedJpeg)
      jpeg_bytes += container().pages()[images[image].page].raw_bytes;
  const bool has_jpeg_pages = options.texture_memory != 0 && options.texture_cache != 0 &&
                              (options.device_texture_memory != 0 || jpeg_bytes > options.texture_memory);
  ReadAhead ahead(file_.map());
  for (const uint32_t image : wanted) {
    if (images[image].codec == format::ImageCodec::kBlocks) {
      BlockTexture::add_ranges(container(), image, options.texture_memory != 0, ahead);
    } else if (images[image].codec == format::ImageCodec::kIndexedJpeg) {
      JpegTexture::add_ranges(container(), image, has_jpeg_pages, ahead);
    } else {
      const format::PageRecord& page = container().pages()[images[image].page];
      ahead.add(page.offset, page.stored_bytes);
    }
    ahead.end_item();
  }
  if (options.progress != nullptr) options.progress->begin("textures", wanted.size());
  parallel_for(wanted.size(), options.threads, [&](uint64_t i) {
    const uint32_t image = wanted[i];
    ahead.begin(i);
    const TexelCoding coding = is_color[image] ? TexelCoding::kColor : TexelCoding::kNumbers;
    if (const Result<void> going = JobProgress::advance(options.progress, 1); !going) {
      results[i] = going;
      return;
    }
    if (options.texture_cache != 0 && images[image].codec == format::ImageCodec::kIndexedJpeg) {
      Result<JpegTexture> jpeg = JpegTexture::load(container(), image, coding, has_jpeg_pages);
      if (jpeg) {
        jpegs_[image] = std::move(*jpeg);
      } else {
        results[i] = jpeg.error();
      }
      return;
    }
    if (images[image].codec == format::ImageCodec::kBlocks) {
      Result<BlockTexture> blocks = BlockTexture::load(container(), image, coding, options.texture_memory != 0);
      if (blocks) {
        block_images_[image] = std::move(*blocks);
      } else {
        results[i] = blocks.error();
      }
      return;
    }
    Result<MipChain> mips = load_image(container(), image, coding, warnings[i]);
    if (mips) {
      mips_[wanted[i]] = std::move(*mips);
    } else {
      results[i] = mips.error();
    }
  });
  for (size_t i = 0; i < wanted.size(); ++i) {
    const std::string place = image_place(container(), wanted[i]);
    if (!results[i]) return at(place, results[i].error());
    if (!warnings[i].empty()) warnings_.push_back(place + ": " + warnings[i]);
    stats_.texture_bytes += mips_[wanted[i]].texels.size() + jpegs_[wanted[i]].decoded_bytes();
    stats_.texture_bytes += block_images_[wanted[i]].bytes();
    stats_.jpeg_bytes += jpegs_[wanted[i]].jpeg_bytes();
  }
  number_jpeg_levels();
  if (jpeg_slot_bytes_ != 0) {
    // Twice the memory that all groups take, so that no set of the cache has to drop a group.
    const uint64_t most = 2 * uint64_t{jpeg_groups_.count} * jpeg_slot_bytes_;
    blocks_ = std::make_unique<kernels::JpegGroupCache>(std::min(options.texture_cache, most), jpeg_slot_bytes_);
  }
  view_.blocks = blocks_.get();
  number_block_pages(options);
  stats_.images = wanted.size();
  for (uint64_t t = 0; t < textures.size(); ++t)
    if (texture_drawn[t]) textures_[t] = view_of(textures[t]);
  return {};
}

/// Calls visit(texture, is_color) for every texture of the materials of drawn meshes.
template <class Visit>
void Scene::visit_drawn_textures(const Visit& visit) const {
  for (uint64_t m = 0; m < view_.mesh_count; ++m) {
    const uint32_t material = view_.meshes[m].material;
    if (!mesh_drawn_[m] || material == format::kNone || !(view_.meshes[m].attributes & format::kHasUv)) continue;
    if (const uint32_t texture = view_.materials[material].texture; texture != format::kNone) visit(texture, true);
    if (material_views_[material].surface == format::kNone) continue;
    const format::SurfaceRecord& surface = view_.surfaces[material_views_[material].surface];
    for (uint32_t use = 0; use < format::kSurfaceUses; ++use)
      if (const uint32_t texture = surface.textures[use].texture; texture != format::kNone)
        visit(texture, format::is_color(static_cast<format::SurfaceUse>(use)));
  }
}

/// Finds the surface of each material. If no drawn mesh has one, the view gets none, and is shaded with base colours
/// only.
void Scene::find_surfaces() {
  material_views_.resize(view_.material_count);
  view_.material_views = material_views_.data();
  const auto surfaces = container().surfaces();
  std::vector<bool> is_drawn(view_.material_count, false);
  for (uint64_t m = 0; m < view_.mesh_count; ++m)
    if (mesh_drawn_[m] && view_.meshes[m].material != format::kNone) is_drawn[view_.meshes[m].material] = true;
  bool any = false;
  for (uint32_t i = 0; i < surfaces.size() && !any; ++i) any = is_drawn[surfaces[i].material];
  if (!any) return;
  for (uint32_t i = 0; i < surfaces.size(); ++i) material_views_[surfaces[i].material].surface = i;
  view_.surface_count = surfaces.size();
}

void Scene::place_lights() {
  constexpr size_t kMost = 1024;
  const auto lights = container().lights();
  if (lights.empty()) return;
  const auto world = world_matrices(container(), scene_);
  uint64_t aimless = 0;
  for (uint64_t i = 0; i < lights.size(); ++i) {
    const format::LightRecord& record = lights[i];
    const std::optional<Rows>& rows = world[record.node];
    if (!rows) continue;
    if (lights_.size() == kMost) {
      warnings_.push_back("more than " + std::to_string(kMost) + " lights: the first are drawn");
      break;
    }
    kernels::PlacedLight light{};
    double length = 0;
    for (size_t axis = 0; axis < 3; ++axis) length = std::hypot(length, (*rows)[axis][2]);
    if (record.kind != format::LightKind::kPoint && !(length > 0)) {
      ++aimless;
      continue;
    }
    for (size_t axis = 0; axis < 3; ++axis) {
      light.position[axis] = (*rows)[axis][3];
      light.direction[axis] = length > 0 ? static_cast<float>(-(*rows)[axis][2] / length) : 0.0f;
      light.color[axis] = record.color[axis] * record.intensity;
    }
    light.range = record.range;
    if (record.kind == format::LightKind::kSpot) {
      const float outer = std::cos(record.outer_cone);
      light.cone_scale = 1.0f / std::max(0.001f, std::cos(record.inner_cone) - outer);
      light.cone_offset = -outer * light.cone_scale;
    }
    light.kind = record.kind;
    lights_.push_back(light);
  }
  if (aimless != 0)
    warnings_.push_back("directional and spot lights without a direction, because of a scale of 0: " +
                        std::to_string(aimless) + " left out");
  view_.lights = lights_.data();
  view_.light_count = static_cast<uint32_t>(lights_.size());
}

Result<void> Scene::load_light(const SceneOptions& options) {
  const bool is_wanted = options.lighting == kernels::Lighting::kEnvironment ||
                         (options.lighting == kernels::Lighting::kAuto && options.textures && view_.surface_count != 0);
  if (!is_wanted) return {};
  if (options.environment.empty()) {
    view_.environment = sky(options.threads).data();
  } else {
    environment_ = SCREE_TRY(load_environment(options.environment, options.threads));
    view_.environment = environment_.data();
  }
  return {};
}

kernels::TextureView Scene::view_of(const format::TextureRecord& record) const {
  const MipChain& mips = mips_[record.image];
  if (mips.level_count != 0) return texture_view(mips, record);
  const BlockTexture& blocks = block_images_[record.image];
  return blocks.empty() ? jpegs_[record.image].view(record) : blocks.view(record);
}

void Scene::number_block_pages(const SceneOptions& options) {
  device_texture_memory_ = options.device_texture_memory;
  device_texture_limit_ = std::max(options.device_texture_memory, options.device_texture_limit);
  auto pager = std::make_unique<HostBlockPager>(file_.map(), container(), options.texture_memory, options.threads,
                                                options.reading);
  for (uint32_t i = 0; i < block_images_.size(); ++i)
    if (!block_images_[i].empty()) block_images_[i].add_pages(container(), i, *pager);
  for (uint32_t i = 0; i < jpegs_.size(); ++i) jpegs_[i].add_pages(container(), i, *pager);
  if (pager->size() == 0) return;
  pager_ = std::move(pager);
  view_.pager = pager_.get();
}

void Scene::number_jpeg_levels() {
  uint32_t number = 0;
  for (JpegTexture& jpeg : jpegs_) {
    jpeg.number_levels(number, jpeg_groups_);
    jpeg_slot_bytes_ = std::max(jpeg_slot_bytes_, jpeg.group_bytes());
  }
}

}  // namespace scree::runtime
