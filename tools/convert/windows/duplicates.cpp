#include "tools/convert/windows/duplicates.h"

#include <array>
#include <map>
#include <numeric>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>

#include "tools/common/content_hash.h"

namespace scree::convert {
namespace {

using format::kNone;

template <class T>
void add_value(ContentHasher& hasher, const T& value) {
  hasher.add(std::as_bytes(std::span(&value, 1)));
}

/// Without padding, which may have any bytes.
std::array<uint32_t, 7> values_of(const PlannedMask& mask) {
  return {static_cast<uint32_t>(mask.plain),
          static_cast<uint32_t>(mask.textured),
          mask.blends,
          mask.of_colors,
          mask.threshold,
          mask.width,
          mask.height};
}

template <class Record>
std::string key_of(const std::string& name, const Record& record) {
  return name + std::string(1, '\0') + std::string(reinterpret_cast<const char*>(&record), sizeof record);
}

}  // namespace

std::vector<bool> may_repeat(const SourceScene& scene, const std::vector<bool>& wanted) {
  std::vector<ContentHash> hashes;
  for (size_t i = 0; hashes.size() < scene.groups.size();) {
    ContentHasher hasher;
    for (; i < scene.primitives.size() && scene.primitives[i].group == hashes.size(); ++i) {
      const Primitive& primitive = scene.primitives[i];
      add_value(hasher, primitive.triangle_count());
      const uint32_t attributes =
          (primitive.uv ? 1u : 0u) | (primitive.color ? 2u : 0u) | (primitive.second_uv() != nullptr ? 4u : 0u);
      add_value(hasher, attributes);
    }
    hashes.push_back(hasher.value());
  }
  std::map<ContentHash, uint32_t> groups;  // number of groups per hash of their counts
  uint32_t last = kNone;
  for (size_t i = 0; i < wanted.size(); ++i) {
    const uint32_t group = scene.primitives[i].group;
    if (wanted[i] && group != last) ++groups[hashes[group]];
    last = group;
  }
  std::vector<bool> repeats(wanted.size());
  for (size_t i = 0; i < wanted.size(); ++i) repeats[i] = wanted[i] && groups[hashes[scene.primitives[i].group]] > 1;
  return repeats;
}

MergedMaterials merge_materials(SourceScene& scene, const std::vector<bool>& materials_used,
                                const std::vector<uint32_t>& image_places, const MaskPlan& masks) {
  MergedMaterials merged;
  std::vector<bool> textures_used(scene.textures.size());
  for (size_t i = 0; i < scene.materials.size(); ++i) {
    if (!materials_used[i]) continue;
    visit_textures(scene.materials[i], [&](const uint32_t& used) { textures_used[used] = true; });
  }

  std::unordered_map<std::string, uint32_t> known;
  std::vector<uint32_t> texture(scene.textures.size());
  std::iota(texture.begin(), texture.end(), 0u);
  for (uint32_t i = 0; i < texture.size(); ++i) {
    if (!textures_used[i]) continue;
    format::TextureRecord record = scene.textures[i].record;
    record.image = image_places[record.image];
    texture[i] = known.try_emplace(key_of(scene.textures[i].name, record), i).first->second;
    merged.textures += texture[i] != i ? 1 : 0;
  }

  known.clear();
  std::vector<uint32_t> material(scene.materials.size());
  std::iota(material.begin(), material.end(), 0u);
  for (uint32_t i = 0; i < material.size(); ++i) {
    if (!materials_used[i]) continue;
    NamedMaterial& named = scene.materials[i];
    visit_textures(named, [&](uint32_t& used) { used = texture[used]; });
    std::string key = key_of(named.name, named.record);
    if (named.surface) key += key_of("", *named.surface);
    key += key_of("", values_of(masks.materials[i]));
    material[i] = known.try_emplace(std::move(key), i).first->second;
    merged.materials += material[i] != i ? 1 : 0;
  }
  for (Primitive& primitive : scene.primitives)
    if (primitive.material != kNone) primitive.material = material[primitive.material];
  return merged;
}

uint32_t EqualGroups::find_first(const SourceScene& scene, const std::vector<Measured>& measured, uint32_t group,
                                 size_t first_primitive) {
  bool is_hashed = false;
  ContentHasher hasher;
  for (size_t i = first_primitive; i < scene.primitives.size() && scene.primitives[i].group == group; ++i) {
    // Either all or none of a group are hashed (may_repeat()).
    if (measured[i].triangles == 0 || !measured[i].content) continue;
    is_hashed = true;
    add_value(hasher, measured[i].triangles);
    add_value(hasher, scene.primitives[i].material);
    hasher.add(std::as_bytes(std::span(*measured[i].content)));
    if (measured[i].shows_normals) hasher.add(std::as_bytes(std::span(measured[i].normals)));
    if (measured[i].shows_tangents) hasher.add(std::as_bytes(std::span(measured[i].tangents)));
  }
  return is_hashed ? known_.try_emplace(hasher.value(), group).first->second : group;
}

std::vector<uint32_t> find_equal_groups(const SourceScene& scene, const Measurement& measurement) {
  EqualGroups equal;
  std::vector<uint32_t> first(scene.groups.size());
  size_t primitive = 0;
  for (uint32_t group = 0; group < first.size(); ++group) {
    first[group] = equal.find_first(scene, measurement.primitives, group, primitive);
    while (primitive < scene.primitives.size() && scene.primitives[primitive].group == group) ++primitive;
  }
  return first;
}

}  // namespace scree::convert
