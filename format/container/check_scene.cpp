// The checks of nodes, instances, scenes, materials, textures, images and cameras.
#include <algorithm>
#include <numbers>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/container/checker.h"
#include "format/container/mip_levels.h"

namespace scree::format {

using enum ErrorCode;

namespace {

constexpr uint64_t kNodesAhead = 32;  // instances

}  // namespace

Result<void> Checker::nodes(Part part) const {
  for (uint64_t n = part.begin(nodes_.size()); n < part.end(nodes_.size()); ++n) {
    announce(TableKind::kNodes, n);
    const NodeRecord& node = nodes_[n];
    if (name_is_bad(node.name)) return fail_name("node", n, node.name);
    if (node.parent >= n && node.parent != kNone) {
      return fail(kRange, "node ", n, ": parent ", node.parent, ", expected a node before it");
    }
    if (node.group >= groups_.size() && node.group != kNone) {
      return fail_index("node", n, "group", node.group, groups_.size(), "groups");
    }
    if (node.camera >= cameras_.size() && node.camera != kNone) {
      return fail_index("node", n, "camera", node.camera, cameras_.size(), "cameras");
    }
    if ((node.flags & ~uint32_t{kNodeHasMatrix}) || node.reserved) {
      return fail(kReserved, "node ", n, ": a reserved field or flag is set");
    }
    if (!range_within(node.first_node_instance, node.node_instance_count, node_instances_.size())) {
      return fail(kRange, "node ", n, ": ", node.node_instance_count, " node instances from ", node.first_node_instance,
                  ", but the file has ", node_instances_.size());
    }
    if (!all_finite(node.local, 16)) return fail(kRange, "node ", n, ": a transform that is not finite");
    if (!(node.flags & kNodeHasMatrix)) {
      uint64_t set = 0;
      for (uint32_t i = 10; i < 16; ++i) set |= std::bit_cast<uint64_t>(node.local[i]) << 1;  // -0 is zero
      if (set != 0) return fail(kReserved, "node ", n, ": more than translation, rotation and scale");
    }
  }
  return {};
}

Result<void> Checker::node_instances() const {
  for (uint64_t i = 0; i < node_instances_.size(); ++i) {
    announce(TableKind::kNodeInstances, i);
    const NodeInstanceRecord& record = node_instances_[i];
    if (!all_finite(record.translation, 3) || !all_finite(record.rotation, 4) || !all_finite(record.scale, 3)) {
      return fail(kRange, "node instance ", i, ": a transform that is not finite");
    }
  }
  return {};
}

Result<void> Checker::matrices(Part part) const {
  for (uint64_t i = part.begin(matrices_.size()); i < part.end(matrices_.size()); ++i) {
    announce(TableKind::kMatrices, i);
    if (!all_finite(&matrices_[i].rows[0][0], 12)) return fail(kRange, "matrix ", i, ": not finite");
  }
  return {};
}

/// Checks the scene's instances from next_instance_ up to `end`.
Result<void> Checker::instances_to(uint64_t end) {
  for (; next_instance_ < end; ++next_instance_) {
    const uint64_t i = next_instance_;
    announce(TableKind::kInstances, i);
    if (i + kNodesAhead < end) {  // nodes come in any order: without this each is a cache miss
      const uint32_t node = instances_[i + kNodesAhead].node;
      if (node < nodes_.size()) __builtin_prefetch(&nodes_[node].group);
    }
    const InstanceRecord& instance = instances_[i];
    if (instance.mesh >= meshes_.size()) {
      return fail_index("instance", i, "mesh", instance.mesh, meshes_.size(), "meshes");
    }
    if (instance.node >= nodes_.size()) return fail_index("instance", i, "node", instance.node, nodes_.size(), "nodes");
    if (instance.matrix >= matrices_.size()) {
      return fail_index("instance", i, "matrix", instance.matrix, matrices_.size(), "matrices");
    }
    const MeshRecord& mesh = meshes_[instance.mesh];
    const NodeRecord& node = nodes_[instance.node];
    if (mesh.group != node.group) {
      return fail(kRange, "instance ", i, ": mesh ", instance.mesh, " of group ", mesh.group, ", but node ",
                  instance.node, " has group ", node.group);
    }
    if (instance.node_instance != 0 && instance.node_instance >= node.node_instance_count) {
      return fail(kRange, "instance ", i, ": node instance ", instance.node_instance, ", but node ", instance.node,
                  " has ", node.node_instance_count);
    }
    if (instance.mesh < previous_mesh_) {
      return fail(kRange, "instance ", i, ": mesh ", instance.mesh, " after mesh ", previous_mesh_,
                  ", expected ascending order");
    }
    previous_mesh_ = instance.mesh;
    if (__builtin_add_overflow(scene_triangles_, mesh.triangle_count, &scene_triangles_)) {
      return fail(kRange, "scene ", scene_, ": more than 2^64 triangles");
    }
  }
  return {};
}

/// The fields of a scene, without its instances.
std::optional<Error> Checker::scene_fields(uint64_t index) const {
  const SceneRecord& scene = scenes_[index];
  if (name_is_bad(scene.name)) return fail_name("scene", index, scene.name);
  if (scene.flags > 1) return fail(kReserved, "scene ", index, ": flags ", scene.flags);
  if (scene.flags == 1 && default_seen_) return fail(kRange, "scene ", index, ": a second default scene");
  if (!range_within(scene.first_root, scene.root_count, scene_roots_.size())) {
    return fail(kRange, "scene ", index, ": ", scene.root_count, " roots from ", scene.first_root,
                ", but the file has ", scene_roots_.size());
  }
  if (scene.first_instance != next_instance_ || scene.instance_count > instances_.size() - next_instance_) {
    return fail(kRange, "scene ", index, ": ", scene.instance_count, " instances from ", scene.first_instance,
                ", expected from ", next_instance_, " to at most ", instances_.size());
  }
  return std::nullopt;
}

/// Checks the scenes of the part's instances.
Result<void> Checker::scenes(Part part) {
  const uint64_t end = part.end(instances_.size());
  for (;;) {
    if (in_scene_) {
      SCREE_TRY(instances_to(std::min(end, instances_end_)));
      if (next_instance_ < instances_end_) return {};
      if (scenes_[scene_].triangle_count != scene_triangles_) {
        return fail(kRange, "scene ", scene_, ": ", scenes_[scene_].triangle_count,
                    " triangles, but its instances have ", scene_triangles_);
      }
      in_scene_ = false;
      ++scene_;
    }
    if (scene_ == scenes_.size() || (next_instance_ == end && !part.is_last())) break;
    if (auto error = scene_fields(scene_)) return *std::move(error);
    default_seen_ |= scenes_[scene_].flags == 1;
    in_scene_ = true;
    instances_end_ = next_instance_ + scenes_[scene_].instance_count;
    scene_triangles_ = 0;
    previous_mesh_ = 0;
  }
  if (part.is_last() && next_instance_ != instances_.size()) {
    return fail(kRange, "instance ", next_instance_, ": belongs to no scene");
  }
  return {};
}

Result<void> Checker::scene_roots() const {
  for (uint64_t i = 0; i < scene_roots_.size(); ++i) {
    announce(TableKind::kSceneRoots, i);
    if (scene_roots_[i] >= nodes_.size()) {
      return fail_index("scene root", i, "node", scene_roots_[i], nodes_.size(), "nodes");
    }
  }
  return {};
}

Result<void> Checker::materials() const {
  constexpr uint32_t kKnownFlags = kMaterialDoubleSided | kMaterialUnlit | kMaterialAlphaMask | kMaterialAlphaBlend;
  for (uint64_t i = 0; i < materials_.size(); ++i) {
    const MaterialRecord& material = materials_[i];
    if (name_is_bad(material.name)) return fail_name("material", i, material.name);
    if (material.texture >= textures_.size() && material.texture != kNone) {
      return fail_index("material", i, "texture", material.texture, textures_.size(), "textures");
    }
    if ((material.flags & ~kKnownFlags) || material.reserved) {
      return fail(kReserved, "material ", i, ": a reserved field or flag is set");
    }
    if (!all_finite(material.base_color, 4) || !all_finite(material.uv_offset, 2) ||
        !all_finite(material.uv_scale, 2) || !all_finite(&material.uv_rotation, 1) ||
        !all_finite(&material.alpha_cutoff, 1)) {
      return fail(kRange, "material ", i, ": a factor that is not finite");
    }
  }
  return {};
}

Result<void> Checker::surfaces() const {
  uint64_t next = 0;  // least material that the next surface may have
  for (uint64_t i = 0; i < surfaces_.size(); ++i) {
    const SurfaceRecord& surface = surfaces_[i];
    if (surface.material >= materials_.size()) {
      return fail_index("surface", i, "material", surface.material, materials_.size(), "materials");
    }
    if (surface.material < next) {
      return fail(kRange, "surface ", i, ": material ", surface.material, ", expected ", next, " or more");
    }
    next = uint64_t{surface.material} + 1;
    if (surface.second_uv & ~(tables_.is_second ? (1u << kSurfaceUses) - 1 : 0u))
      return fail(kReserved, "surface ", i, ": second uv of textures ", surface.second_uv);
    if (!all_finite(&surface.metallic, 12)) return fail(kRange, "surface ", i, ": a factor that is not finite");
    for (const float share : {surface.metallic, surface.roughness, surface.occlusion_strength, surface.specular}) {
      if (!(share >= 0 && share <= 1)) return fail(kRange, "surface ", i, ": a factor of ", share, ", expected 0 to 1");
    }
    for (int c = 0; c < 3; ++c) {
      if (!(surface.emission[c] >= 0 && surface.specular_color[c] >= 0)) {
        return fail(kRange, "surface ", i, ": a colour below 0");
      }
    }
    if (!(surface.ior == 0 || surface.ior >= 1)) {
      return fail(kRange, "surface ", i, ": index of refraction ", surface.ior, ", expected 0, or 1 or more");
    }
    for (const SurfaceTexture& use : surface.textures) {
      if (use.texture >= textures_.size() && use.texture != kNone) {
        return fail_index("surface", i, "texture", use.texture, textures_.size(), "textures");
      }
      if (!all_finite(use.uv_offset, 5)) return fail(kRange, "surface ", i, ": a texture transform that is not finite");
    }
  }
  return {};
}

Result<void> Checker::lights() const {
  for (uint64_t i = 0; i < lights_.size(); ++i) {
    const LightRecord& light = lights_[i];
    if (name_is_bad(light.name)) return fail_name("light", i, light.name);
    if (light.node >= nodes_.size()) return fail_index("light", i, "node", light.node, nodes_.size(), "nodes");
    if (light.kind < LightKind::kDirectional || light.kind > LightKind::kSpot) {
      return fail(kRange, "light ", i, ": kind ", light.kind);
    }
    if (light.reserved || light.reserved2) return fail(kReserved, "light ", i, ": a reserved field is set");
    if (!all_finite(light.color, 7)) return fail(kRange, "light ", i, ": a number that is not finite");
    for (const float value : {light.color[0], light.color[1], light.color[2], light.intensity, light.range}) {
      if (!(value >= 0)) return fail(kRange, "light ", i, ": ", value, ", expected 0 or more");
    }
    const bool is_spot = light.kind == LightKind::kSpot;
    const bool has_cone = light.inner_cone >= 0 && light.outer_cone > light.inner_cone &&
                          light.outer_cone <= static_cast<float>(std::numbers::pi / 2);
    if (is_spot ? !has_cone : light.inner_cone != 0 || light.outer_cone != 0) {
      return fail(kRange, "light ", i, ": a cone from ", light.inner_cone, " to ", light.outer_cone);
    }
  }
  return {};
}

Result<void> Checker::textures() const {
  for (uint64_t i = 0; i < textures_.size(); ++i) {
    const TextureRecord& texture = textures_[i];
    if (name_is_bad(texture.name)) return fail_name("texture", i, texture.name);
    if (texture.image >= images_.size()) {
      return fail_index("texture", i, "image", texture.image, images_.size(), "images");
    }
    if (texture.wrap_s > Wrap::kClamp || texture.wrap_t > Wrap::kClamp) {
      return fail(kRange, "texture ", i, ": wrap ", texture.wrap_s, " and ", texture.wrap_t);
    }
    const uint32_t mag = texture.mag_filter;
    const uint32_t min = texture.min_filter;
    const bool mag_known = mag == 0 || mag == kFilterNearest || mag == kFilterLinear;
    const bool min_known = min == 0 || min == kFilterNearest || min == kFilterLinear ||
                           (min >= kFilterNearestMipmapNearest && min <= kFilterLinearMipmapLinear);
    if (!mag_known || !min_known) return fail(kRange, "texture ", i, ": filters ", mag, " and ", min);
  }
  return {};
}

Result<void> Checker::images() const {
  uint64_t next_level = 0;
  for (uint64_t i = 0; i < images_.size(); ++i) {
    const ImageRecord& image = images_[i];
    if (name_is_bad(image.name)) return fail_name("image", i, image.name);
    if (auto error = page_of("image", i, image.page, PageKind::kImage, "image")) return *std::move(error);
    if (image.codec < ImageCodec::kJpeg || image.codec > ImageCodec::kBlocks) {
      return fail(kRange, "image ", i, ": codec ", image.codec);
    }
    const bool is_indexed = image.codec == ImageCodec::kIndexedJpeg;
    const bool is_blocks = image.codec == ImageCodec::kBlocks;
    const uint32_t most = is_indexed ? kMaxJpegSide : is_blocks ? kMaxBlockImageSide : kMaxImageSide;
    if (image.width == 0 || image.width > most || image.height == 0 || image.height > most) {
      return fail(kRange, "image ", i, ": ", image.width, " x ", image.height, " pixels, expected 1 to ", most);
    }
    if (image.channels < 1 || image.channels > 4 || (is_indexed && image.channels % 2 == 0)) {
      return fail(kRange, "image ", i, ": ", uint32_t{image.channels}, " channels");
    }
    if (auto error = blocks_of(i)) return *std::move(error);
    const uint32_t levels = is_blocks    ? image.level_count
                            : is_indexed ? stored_level_count(image.width, image.height)
                                         : 0;
    if (image.level_count != levels) {
      return fail(kRange, "image ", i, ": ", image.level_count, " mip levels, expected ", levels);
    }
    if (image.first_level != (levels == 0 ? uint64_t{kNone} : next_level)) {
      return fail(kRange, "image ", i, ": mip levels from ", image.first_level, ", expected ",
                  levels == 0 ? uint64_t{kNone} : next_level);
    }
    if (auto error = levels_of(i, next_level)) return *std::move(error);
    next_level += levels;
  }
  if (next_level != mip_levels_.size()) return fail(kRange, "mip level ", next_level, ": belongs to no image");
  return {};
}

/// Checks that a record's page exists and is of the `expected` kind, which holds `content`.
std::optional<Error> Checker::page_of(const char* kind, uint64_t index, uint64_t page, PageKind expected,
                                      const char* content) const {
  if (page >= pages_.size()) return fail_index(kind, index, "page", page, pages_.size(), "pages");
  if (pages_[page].kind == expected) return std::nullopt;
  return fail(kRange, kind, " ", index, ": page ", page, " is of kind ", pages_[page].kind, ", which holds no ",
              content);
}

/// Checks that the fields of a block image agree and its page holds its blocks, and that other images have no such
/// fields.
std::optional<Error> Checker::blocks_of(uint64_t number) const {
  const ImageRecord& image = images_[number];
  const auto format = static_cast<uint32_t>(image.block_format);
  if (image.codec != ImageCodec::kBlocks) {
    if (format == 0 && image.swizzle == 0) return std::nullopt;
    return fail(kReserved, "image ", number, ": block format ", format, " and swizzle ", image.swizzle,
                " of an image that has no blocks");
  }
  if (!is_block_format(image.block_format) || !is_swizzle(image.swizzle)) {
    return fail(kRange, "image ", number, ": block format ", format, ", swizzle ", image.swizzle);
  }
  if (image.channels != block_channels(image.block_format)) {
    return fail(kRange, "image ", number, ": ", uint32_t{image.channels}, " channels, but ",
                block_format_name(image.block_format), " has ", block_channels(image.block_format));
  }
  if (auto error = block_pages_of("image", number, image.page, block_rows(image, 0))) return error;
  if (image.level_count > most_block_levels(image.width, image.height)) {
    return fail(kRange, "image ", number, ": ", image.level_count, " mip levels, expected at most ",
                most_block_levels(image.width, image.height));
  }
  return std::nullopt;
}

/// Checks that the pages from `first` on hold the rows of a level and nothing else.
std::optional<Error> Checker::block_pages_of(const char* what, uint64_t number, uint64_t first,
                                             const BlockRows& rows) const {
  for (uint32_t i = 0; i < rows.pages(); ++i) {
    if (auto error = page_of(what, number, first + i, PageKind::kImage, "image")) return error;
    const PageRecord& page = pages_[first + i];
    if (page.raw_bytes != rows.page_bytes(i)) {
      return fail(kRange, what, " ", number, ": page ", first + i, " has ", page.raw_bytes, " bytes, expected ",
                  rows.page_bytes(i));
    }
  }
  return std::nullopt;
}

/// Checks the image's mip levels from `first` on.
std::optional<Error> Checker::levels_of(uint64_t image, uint64_t first) const {
  for (uint64_t i = first; i < first + images_[image].level_count; ++i) {
    if (i >= mip_levels_.size()) return fail_index("image", image, "mip level", i, mip_levels_.size(), "mip levels");
    const MipLevelRecord& level = mip_levels_[i];
    if (level.image != image) return fail(kRange, "mip level ", i, ": image ", level.image, ", expected ", image);
    if (auto error = page_of("mip level", i, level.page, PageKind::kImage, "image")) return error;
    const PageRecord& page = pages_[level.page];
    const ImageRecord& of = images_[image];
    const auto l = static_cast<uint32_t>(i - first) + 1;
    const bool has_pages = level_page_count(of, l) > 1;
    if (has_pages) {
      if (level.offset != 0) return fail(kRange, "mip level ", i, ": at byte ", level.offset, " of its first page");
      if (auto error = block_pages_of("mip level", i, level.page, block_rows(of, l))) return error;
    } else if (level.offset % kChunkAlignment != 0 || !range_within(level.offset, level.bytes, page.raw_bytes)) {
      return fail(kRange, "mip level ", i, ": ", level.bytes, " bytes at byte ", level.offset, " of page ", level.page,
                  ", which has ", page.raw_bytes);
    }
    if (of.codec != ImageCodec::kBlocks) continue;
    const uint64_t bytes = block_rows(of, l).bytes();
    if (level.bytes != bytes) return fail(kRange, "mip level ", i, ": ", level.bytes, " bytes, expected ", bytes);
  }
  return std::nullopt;
}

Result<void> Checker::masks() const {
  for (uint64_t i = 0; i < masks_.size(); ++i) {
    const MaskRecord& mask = masks_[i];
    if (mask.material >= materials_.size()) {
      return fail_index("mask", i, "material", mask.material, materials_.size(), "materials");
    }
    if (i > 0 && mask.material <= masks_[i - 1].material) {
      return fail(kRange, "mask ", i, ": material ", mask.material, " after material ", masks_[i - 1].material,
                  ", expected ascending order");
    }
    if (auto error = page_of("mask", i, mask.page, PageKind::kMask, "mask")) return *std::move(error);
    const PageRecord& page = pages_[mask.page];
    if (mask.width == 0 || mask.width > kMaxMaskSide || mask.height == 0 || mask.height > kMaxMaskSide) {
      return fail(kRange, "mask ", i, ": ", mask.width, " x ", mask.height, " texels, expected 1 to ", kMaxMaskSide);
    }
    if (mask.level_count == 0 || mask.level_count > max_mask_levels(mask.width, mask.height)) {
      return fail(kRange, "mask ", i, ": ", mask.level_count, " levels, expected 1 to ",
                  max_mask_levels(mask.width, mask.height));
    }
    const uint64_t bytes = mask_bytes(mask.width, mask.height, mask.level_count);
    if (page.raw_bytes != bytes) {
      return fail(kRange, "mask ", i, ": page ", mask.page, " has ", page.raw_bytes, " bytes, expected ", bytes);
    }
    if (mask.threshold == 0 || mask.threshold > kMaxMaskThreshold) {
      return fail(kRange, "mask ", i, ": threshold ", mask.threshold, ", expected 1 to ", kMaxMaskThreshold);
    }
    if (mask.wrap_s > Wrap::kClamp || mask.wrap_t > Wrap::kClamp) {
      return fail(kRange, "mask ", i, ": wrap ", mask.wrap_s, " and ", mask.wrap_t);
    }
    if ((mask.flags & ~uint32_t{kMaskNearest | kMaskOfColors}) != 0)
      return fail(kReserved, "mask ", i, ": flags ", mask.flags);
    if (!all_finite(&mask.place[0][0], 6)) return fail(kRange, "mask ", i, ": a transform that is not finite");
  }
  return {};
}

Result<void> Checker::cameras() const {
  for (uint64_t i = 0; i < cameras_.size(); ++i) {
    const CameraRecord& camera = cameras_[i];
    if (name_is_bad(camera.name)) return fail_name("camera", i, camera.name);
    if (!all_finite(&camera.y, 4)) return fail(kRange, "camera ", i, ": a number that is not finite");
    if (camera.kind == CameraKind::kPerspective) {
      if (!(camera.y > 0 && camera.y < std::numbers::pi)) return fail(kRange, "camera ", i, ": angle ", camera.y);
      if (camera.x < 0) return fail(kRange, "camera ", i, ": aspect ratio ", camera.x);
      if (!(camera.z_near > 0) || !(camera.z_far == 0 || camera.z_far > camera.z_near)) {
        return fail(kRange, "camera ", i, ": depths from ", camera.z_near, " to ", camera.z_far);
      }
    } else if (camera.kind == CameraKind::kOrthographic) {
      if (camera.x == 0 || camera.y == 0) return fail(kRange, "camera ", i, ": size ", camera.x, " by ", camera.y);
      if (!(camera.z_near >= 0) || !(camera.z_far > camera.z_near)) {
        return fail(kRange, "camera ", i, ": depths from ", camera.z_near, " to ", camera.z_far);
      }
    } else {
      return fail(kRange, "camera ", i, ": kind ", camera.kind);
    }
  }
  return {};
}

Result<void> Checker::source() const {
  const Table<SourceRecord> sources = tables_.table<SourceRecord>(TableKind::kSource);
  if (sources.size() != 1) return fail(kFormat, "source table: ", sources.size(), " records, expected 1");
  for (const uint32_t offset : {sources[0].name, sources[0].options, sources[0].generator, sources[0].copyright}) {
    if (name_is_bad(offset)) return fail_name("source", 0, offset);
  }
  const Table<LeftOutRecord> left_out = tables_.table<LeftOutRecord>(TableKind::kLeftOut);
  for (uint64_t i = 0; i < left_out.size(); ++i) {
    if (name_is_bad(left_out[i].what)) return fail_name("left-out", i, left_out[i].what);
    if (left_out[i].reserved) return fail(kReserved, "left-out ", i, ": a reserved field is set");
  }
  const uint64_t costs = tables_.table<uint64_t>(TableKind::kLeftOutCosts).size();
  if (costs != 0 && costs != left_out.size())
    return fail(kRange, "left-out costs: ", costs, " records, expected ", left_out.size(), " or none");
  return {};
}

}  // namespace scree::format
