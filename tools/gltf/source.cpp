#include "tools/gltf/source.h"

#include <algorithm>
#include <array>
#include <exception>
#include <limits>
#include <map>
#include <new>
#include <string_view>
#include <utility>

#include "format/bytes.h"
#include "format/fail.h"
#include "tools/common/process/memory_use.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/cameras.h"
#include "tools/gltf/document/check.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/document/glb.h"
#include "tools/gltf/document/json.h"
#include "tools/gltf/left_out_list.h"
#include "tools/gltf/materials.h"
#include "tools/gltf/nodes.h"

namespace scree::convert {
namespace {

using format::kNone;

std::string counted(uint64_t count, const char* one, const char* many) {
  return std::to_string(count) + " " + (count == 1 ? one : many);
}

// Extensions that a document may require. The first ones are supported. The others only change how a surface is lit, or
// describe the file: without them every triangle keeps its position and its base colour.
constexpr std::string_view kDracoName = "KHR_draco_mesh_compression";
constexpr std::string_view kSupported[] = {"KHR_mesh_quantization",      "KHR_texture_transform",
                                           "KHR_materials_unlit",        "EXT_mesh_gpu_instancing",
                                           "EXT_meshopt_compression",    "KHR_meshopt_compression",
                                           "KHR_texture_basisu",         "MSFT_texture_dds",
                                           "EXT_texture_webp",           "KHR_lights_punctual",
                                           "KHR_materials_ior",          "KHR_materials_pbrSpecularGlossiness",
                                           "KHR_materials_specular",     "KHR_materials_emissive_strength",
                                           "KHR_materials_transmission", kDracoName};
constexpr std::string_view kLookOnly[] = {
    "KHR_materials_anisotropy", "KHR_materials_clearcoat",   "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion", "KHR_materials_iridescence", "KHR_materials_sheen",
    "KHR_materials_variants",   "KHR_materials_volume",      "KHR_xmp_json_ld",
    "EXT_lights_ies",           "EXT_lights_image_based"};

constexpr const char* kWithoutDraco =
    "this scree is built without libdraco: decode it first, for example with gltf-transform";

bool is_supported(std::string_view extension) {
  if (extension == kDracoName && draco_version().empty()) return false;
  return std::find(std::begin(kSupported), std::end(kSupported), extension) != std::end(kSupported);
}

Result<void> check_extensions(const GltfDocument& document, SourceScene& scene) {
  std::string ignored;
  for (const std::string& name : document.extensions_required) {
    if (is_supported(name)) continue;
    if (std::find(std::begin(kLookOnly), std::end(kLookOnly), name) == std::end(kLookOnly)) {
      std::string shown = name.substr(0, 80);
      for (char& c : shown) c = static_cast<unsigned char>(c) < 0x20 ? '?' : c;
      return Error{ErrorCode::kUnsupported, "required extension " + shown + " is not read" +
                                                (name == kDracoName ? std::string(": ") + kWithoutDraco : "")};
    }
    ignored += (ignored.empty() ? "" : ", ") + name;
  }
  if (!ignored.empty())
    scene.warnings.push_back("required extensions that only change shading are left out: " + ignored);
  return {};
}

// The name of a vertex attribute in the list of left-out parts: documents may name thousands of their own.
std::string attribute_kind(const std::string& name) {
  for (const char* known : {"NORMAL", "TANGENT", "POSITION"}) {
    if (name == known) return name;
  }
  for (const std::string_view prefix : {"TEXCOORD_", "COLOR_", "JOINTS_", "WEIGHTS_"}) {
    if (name.size() == prefix.size() + 1 && name.compare(0, prefix.size(), prefix) == 0 && name.back() >= '0' &&
        name.back() <= '9')
      return name;
  }
  return !name.empty() && name[0] == '_' ? "application-specific attributes" : "other attributes";
}

class Importer {
 public:
  Importer(const GltfDocument& document, std::string folder, std::vector<std::shared_ptr<const ByteSource>> chunks,
           const ImportOptions& options, SourceScene& scene)
      : document_(document),
        buffers_(document, std::move(folder), std::move(chunks), options),
        keep_going_(options.keep_going),
        scene_(scene),
        left_out_(document, buffers_) {}

  Result<void> run(const ImportOptions& options) {
    SCREE_TRY(check_extensions(document_, scene_));
    SCREE_TRY(check_document(document_));
    scene_.copyright = document_.copyright;
    for (const DocBuffer& buffer : document_.buffers)
      scene_.buffer_bytes = format::checked_add(scene_.buffer_bytes, buffer.bytes).value_or(scene_.buffer_bytes);

    auto plan = SCREE_TRY(plan_nodes(document_, options));
    if (plan.implied_scene) scene_.warnings.push_back("the document has no scene; its root nodes are taken as one");
    if (!options.exclude.empty() && plan.excluded == 0)
      scene_.warnings.push_back("--exclude \"" + options.exclude + "\" matches no node");
    left_out_.add("excluded nodes", plan.excluded);
    left_out_.add("nodes outside every scene", plan.outside);
    scene_.scenes = plan.scenes;

    SCREE_TRY(make_cameras(document_, scene_));
    SCREE_TRY(make_lights(document_, plan, scene_));
    SCREE_TRY(make_primitives(plan));
    SCREE_TRY(finish_primitives());
    count_left_out();
    scene_.nodes = SCREE_TRY(make_nodes(document_, plan, group_of_mesh_, buffers_));
    note_the_rest(plan);
    left_out_.move_to(scene_);
    scene_.view_memory = buffers_.view_memory();
    return {};
  }

 private:
  // Makes the primitives of every mesh that a kept node names. finish_primitives() adds materials and texture
  // coordinates.
  Result<void> make_primitives(const NodePlan& plan) {
    std::vector<bool> used(document_.meshes.size(), false);
    for (const uint32_t node : plan.order) {
      if (const int32_t mesh = document_.nodes[node].mesh; mesh != kAbsent) used[static_cast<size_t>(mesh)] = true;
    }
    group_of_mesh_.assign(document_.meshes.size(), kNone);
    material_used_.assign(document_.materials.size(), false);
    for (uint32_t m = 0; m < document_.meshes.size(); ++m) {
      if (!used[m]) {
        left_out_.add("unused meshes", 1);
        for (const DocPrimitive& primitive : document_.meshes[m].primitives) dropped_.emplace_back(nullptr, &primitive);
        continue;
      }
      const DocMesh& mesh = document_.meshes[m];
      const size_t before = scene_.primitives.size();
      for (uint32_t p = 0; p < mesh.primitives.size(); ++p) {
        SCREE_TRY_AT("mesh " + std::to_string(m) + " primitive " + std::to_string(p),
                     make_primitive(mesh.primitives[p], m, p));
      }
      if (scene_.primitives.size() == before) continue;
      group_of_mesh_[m] = static_cast<uint32_t>(scene_.groups.size());
      scene_.groups.push_back({mesh.name});
    }
    return {};
  }

  Result<void> make_primitive(const DocPrimitive& from, uint32_t mesh, uint32_t place) {
    const int32_t position = find(from.attributes, "POSITION");
    if (from.mode < 4) {
      dropped_.emplace_back(from.mode == 0 ? "points" : "lines", &from);
      return {};
    }
    if (position == kAbsent) {
      dropped_.emplace_back("primitives without POSITION", &from);
      return {};
    }

    Primitive to{.group = static_cast<uint32_t>(scene_.groups.size()),
                 .place = place,
                 .mesh = mesh,
                 .mode = static_cast<PrimitiveMode>(from.mode)};
    to.positions = SCREE_TRY(attribute("POSITION", position, kNone));
    if (to.positions.count > std::numeric_limits<uint32_t>::max()) {
      return fail(ErrorCode::kUnsupported, "POSITION has ", to.positions.count,
                  " vertices, at most 2^32 - 1 can be indexed");
    }
    if (from.indices != kAbsent) to.indices = SCREE_TRY(index_accessor(from.indices));
    if (to.triangle_count() == 0) {
      dropped_.emplace_back("primitives without triangles", &from);
      return {};
    }
    for (const auto& [name, slot] : {std::pair{"COLOR_0", &to.color}, std::pair{"NORMAL", &to.normal}}) {
      const int32_t index = find(from.attributes, name);
      if (index == kAbsent) continue;
      *slot = SCREE_TRY(attribute(name, index, to.positions.count));
    }
    if (from.material != kAbsent) material_used_[static_cast<size_t>(from.material)] = true;
    note_box(to);
    scene_.primitives.push_back(std::move(to));
    return {};
  }

  // If several primitives share positions, the stated box is not the box of any one of them.
  void note_box(Primitive& primitive) {
    const DocBounds* const bounds = document_.bounds_of(primitive.positions.index);
    if (bounds == nullptr) return;
    const auto [user, is_first] = box_users_.try_emplace(bounds->accessor, scene_.primitives.size());
    if (!is_first) {
      scene_.primitives[user->second].stated_box.reset();
      return;
    }
    primitive.stated_box.emplace();
    for (size_t axis = 0; axis < 3; ++axis) {
      primitive.stated_box->lo[axis] = float_of(primitive.positions, bounds->min[axis]);
      primitive.stated_box->hi[axis] = float_of(primitive.positions, bounds->max[axis]);
    }
  }

  Result<void> finish_primitives() {
    auto materials = SCREE_TRY(make_materials(document_, material_used_, buffers_, keep_going_, scene_));
    uint64_t without_uv = 0;
    for (Primitive& to : scene_.primitives) {
      const DocPrimitive& from = document_.meshes[to.mesh].primitives[to.place];
      std::array<std::string, 2> uv_names;
      if (from.material != kAbsent) {
        const size_t material = static_cast<size_t>(from.material);
        to.material = materials.place[material];
        for (size_t i = 0; i < uv_names.size(); ++i)
          if (const uint32_t set = materials.uv_sets[material][i]; set != kNone)
            uv_names[i] = "TEXCOORD_" + std::to_string(set);
      }
      const auto place = [&] { return "mesh " + std::to_string(to.mesh) + " primitive " + std::to_string(to.place); };
      // Returns whether the primitive has the attribute.
      const auto read = [&](const std::string& name, std::optional<Accessor>& slot) -> Result<bool> {
        const int32_t index = name.empty() ? kAbsent : find(from.attributes, name);
        if (index == kAbsent) return false;
        slot = SCREE_TRY_AT(place(), attribute(name, index, to.positions.count));
        return true;
      };
      const auto has_uv = SCREE_TRY(read(uv_names[0], to.uv));
      SurfaceAttributes surface;
      const auto has_second = SCREE_TRY(has_uv ? read(uv_names[1], surface.second_uv) : Result<bool>(false));
      if ((!has_uv && !uv_names[0].empty()) || (!has_second && !uv_names[1].empty())) ++without_uv;
      if (has_uv && to.normal && has_normal_map(to)) SCREE_TRY(read("TANGENT", surface.tangent));
      SCREE_TRY_AT(place(), take_draco(from, uv_names, to, surface));
      if (surface.second_uv || surface.tangent)
        to.surface = std::make_shared<const SurfaceAttributes>(std::move(surface));
    }
    if (without_uv > 0) {
      scene_.warnings.push_back(counted(without_uv, "primitive has", "primitives have") +
                                " a textured material but not its texture coordinates");
    }
    return {};
  }

  bool has_normal_map(const Primitive& primitive) const {
    if (primitive.material == kNone) return false;
    const auto& surface = scene_.materials[primitive.material].surface;
    return surface && surface->textures[static_cast<size_t>(format::SurfaceUse::kNormalMap)].texture != format::kNone;
  }

  static int32_t find(const std::vector<DocAttribute>& attributes, const std::string& name) {
    const auto found = std::lower_bound(attributes.begin(), attributes.end(), name,
                                        [](const DocAttribute& a, const std::string& b) { return a.first < b; });
    return found == attributes.end() || found->first != name ? kAbsent : found->second;
  }

  // Counts the attributes that kept primitives do not use, and the dropped primitives. Runs after all kept accessors
  // are known, because accessors are shared.
  void count_left_out() {
    for (const Primitive& primitive : scene_.primitives) {
      left_out_.keep(primitive.positions);
      if (primitive.indices) left_out_.keep(*primitive.indices);
      if (primitive.tangent() != nullptr) left_out_.keep(*primitive.tangent());
      visit_attributes(primitive, false, [&](const Accessor& accessor) { left_out_.keep(accessor); });
    }
    for (const Primitive& primitive : scene_.primitives) {
      const DocPrimitive& from = document_.meshes[primitive.mesh].primitives[primitive.place];
      for (const auto& [name, accessor] : from.attributes) left_out_.add_accessor(attribute_kind(name), accessor);
      if (from.targets == 0) continue;
      left_out_.add("morph targets", from.targets);
      ++morphed_;
      for (const int32_t accessor : from.target_accessors) left_out_.add_accessor_bytes("morph targets", accessor);
    }
    for (const auto& [why, from] : dropped_) {
      const char* const what = why != nullptr ? why : "unused meshes";  // these count as meshes, not as primitives
      if (why != nullptr) left_out_.add(what, 1);
      for (const auto& [name, accessor] : from->attributes) left_out_.add_accessor_bytes(what, accessor);
      if (from->indices != kAbsent) left_out_.add_accessor_bytes(what, from->indices);
    }
  }

  // Accessors without data of their own are read from the primitive's Draco stream. An accessor with uncompressed data
  // is read from these: they are exact, and the stream has the vertices in another order.
  Result<void> take_draco(const DocPrimitive& from, const std::array<std::string, 2>& uv_names, Primitive& to,
                          SurfaceAttributes& surface) {
    std::vector<std::pair<const char*, Accessor*>> empty;
    const auto add = [&](const char* name, Accessor& accessor) {
      if (accessor.source == nullptr && !accessor.sparse) empty.emplace_back(name, &accessor);
    };
    add("POSITION", to.positions);
    if (to.color) add("COLOR_0", *to.color);
    if (to.normal) add("NORMAL", *to.normal);
    if (to.uv) add(uv_names[0].c_str(), *to.uv);
    if (surface.second_uv) add(uv_names[1].c_str(), *surface.second_uv);
    if (surface.tangent) add("TANGENT", *surface.tangent);
    const bool has_corners = !to.indices || to.indices->source != nullptr || to.indices->sparse;
    const bool is_packed = from.draco != kAbsent && !empty.empty() && empty[0].second == &to.positions;
    if (!is_packed) {
      if (to.indices) add("indices", *to.indices);
      for (const auto& [name, accessor] : empty) {
        SCREE_TRY_AT(std::string(name) + ": accessor " + std::to_string(accessor->index),
                     from.draco != kAbsent
                         ? Result<void>(Error{ErrorCode::kFormat,
                                              "has only Draco-compressed data, but POSITION has uncompressed data"})
                         : check_zeros(accessor->count));
      }
      return {};
    }
    if (draco_version().empty())
      return Error{ErrorCode::kUnsupported, std::string("has only Draco-compressed data, and ") + kWithoutDraco};
    if (has_corners || to.mode != PrimitiveMode::kTriangles)
      return Error{ErrorCode::kFormat, std::string(kDracoName) + ": expected a primitive of indexed triangles"};
    if (to.indices->count % 3 != 0)
      return fail(ErrorCode::kRange, "indices: accessor ", to.indices->index, " has ", to.indices->count,
                  " elements, expected a multiple of 3 (Draco)");
    const DocDraco& stated = document_.draco[static_cast<size_t>(from.draco)];
    DracoPrimitive packed{.triangles = to.indices->count / 3, .vertices = to.positions.count};
    for (const auto& [name, accessor] : empty) {
      const int32_t id = find(stated.attributes, name);
      if (id == kAbsent)
        return Error{ErrorCode::kFormat, std::string(kDracoName) + ": " + name +
                                             " has neither uncompressed data nor an id in the Draco stream"};
      packed.arrays.push_back({name, static_cast<uint32_t>(id), accessor->type, accessor->components});
    }
    for (const auto& [name, ignored] : stated.attributes) {
      const int32_t index = find(from.attributes, name);
      if (index != kAbsent) packed.other_components += document_.accessors[static_cast<size_t>(index)].components;
    }
    for (const DracoArray& array : packed.arrays) packed.other_components -= array.components;
    if (!packed.offset_of(packed.arrays.size()) || packed.triangles > format::kNone)
      return fail(ErrorCode::kRange, kDracoName, ": ", packed.triangles, " triangles");
    auto source = SCREE_TRY(buffers_.draco(stated.view, packed));
    for (size_t i = 0; i < empty.size(); ++i) {
      Accessor& accessor = *empty[i].second;
      accessor.source = source;
      accessor.offset = *packed.offset_of(i);
    }
    to.indices->source = source;
    to.indices->type = ComponentType::kUint32;
    to.indices->stride = to.indices->element_bytes();
    return {};
  }

  // A vertex attribute with the types that glTF 2.0 (3.7.2.1) and KHR_mesh_quantization allow. `vertices`: of the
  // primitive, or kNone for POSITION itself.
  Result<Accessor> attribute(const std::string& name, int32_t index, uint64_t vertices) {
    auto accessor = SCREE_TRY_AT(name, buffers_.accessor(index));
    const ComponentType type = accessor.type;
    const bool is_float = type == ComponentType::kFloat32;
    const bool is_byte = type == ComponentType::kInt8 || type == ComponentType::kUint8;
    const bool is_short = type == ComponentType::kInt16 || type == ComponentType::kUint16;
    const bool is_signed = type == ComponentType::kInt8 || type == ComponentType::kInt16;
    const uint32_t components = accessor.components;
    bool right = false;
    bool plain = true;  // allowed without KHR_mesh_quantization
    const char* expected = "";
    if (name == "POSITION") {
      right = components == 3 && (is_float || is_byte || is_short);
      plain = is_float;
      expected = "VEC3 of float, byte or short";
    } else if (name == "NORMAL") {
      right = components == 3 && (is_float || (is_signed && accessor.normalized));
      plain = is_float;
      expected = "VEC3 of float or normalised byte or short";
    } else if (name == "TANGENT") {
      right = components == 4 && (is_float || (is_signed && accessor.normalized));
      plain = is_float;
      expected = "VEC4 of float or normalised byte or short";
    } else if (name == "COLOR_0") {
      right = (components == 3 || components == 4) && (is_float || (!is_signed && (is_byte || is_short)));
      expected = "VEC3 or VEC4 of float or normalised unsigned byte or short";
      // Some writers omit the flag. As plain integers the colours would all be far above 1.
      if (right && !is_float && !accessor.normalized) {
        accessor.normalized = true;
        ++unflagged_colors_;
      }
    } else {
      right = components == 2 && (is_float || is_byte || is_short);
      plain = is_float || (!is_signed && accessor.normalized);
      expected = "VEC2 of float, byte or short";
    }
    if (!right) {
      return fail(ErrorCode::kFormat, name, ": accessor ", index, " has componentType ", static_cast<int>(type),
                  " and ", components, " components, expected ", expected);
    }
    if (!plain && !document_.uses("KHR_mesh_quantization")) ++undeclared_quantization_;
    if (vertices != kNone && accessor.count != vertices) {
      return fail(ErrorCode::kRange, name, ": accessor ", index, " has ", accessor.count,
                  " elements, but POSITION has ", vertices);
    }
    return accessor;
  }

  Result<Accessor> index_accessor(int32_t index) {
    auto accessor = SCREE_TRY_AT("indices", buffers_.accessor(index));
    const bool right = accessor.components == 1 &&
                       (accessor.type == ComponentType::kUint8 || accessor.type == ComponentType::kUint16 ||
                        accessor.type == ComponentType::kUint32);
    if (!right) {
      return fail(ErrorCode::kFormat, "indices: accessor ", index, " has componentType ",
                  static_cast<int>(accessor.type), " and ", accessor.components,
                  " components, expected SCALAR of unsigned byte, short or int");
    }
    return accessor;
  }

  void note_the_rest(const NodePlan& plan) {
    const auto warn = [&](const std::string& line) { scene_.warnings.push_back(line); };
    if (document_.skins > 0) {
      left_out_.add("skins", document_.skins);
      for (const int32_t accessor : document_.skin_accessors) left_out_.add_accessor_bytes("skins", accessor);
      uint64_t skinned = 0;
      for (const uint32_t node : plan.order) skinned += document_.nodes[node].skin != kAbsent ? 1 : 0;
      warn(counted(document_.skins, "skin is", "skins are") +
           " left out: " + counted(skinned, "node keeps its bind pose", "nodes keep their bind pose"));
    }
    if (document_.animations > 0) {
      left_out_.add("animations", document_.animations);
      for (const int32_t accessor : document_.animation_accessors) left_out_.add_accessor_bytes("animations", accessor);
      warn(counted(document_.animations, "animation is", "animations are") + " left out");
    }
    if (morphed_ > 0) warn("morph targets of " + counted(morphed_, "primitive are", "primitives are") + " left out");
    if (const uint64_t n = left_out_.count("points"); n > 0)
      warn(counted(n, "primitive of points is", "primitives of points are") + " left out");
    if (const uint64_t n = left_out_.count("lines"); n > 0)
      warn(counted(n, "primitive of lines is", "primitives of lines are") + " left out");
    if (const uint64_t n = left_out_.count("primitives without POSITION"); n > 0)
      warn(counted(n, "primitive has", "primitives have") + " no POSITION and nothing to draw");
    if (const uint64_t n = left_out_.count("primitives without triangles"); n > 0)
      warn(counted(n, "primitive has", "primitives have") + " fewer than 3 vertices to draw");
    if (undeclared_quantization_ > 0) {
      warn(counted(undeclared_quantization_, "attribute has", "attributes have") +
           " integer types that need KHR_mesh_quantization, which the document does not name");
    }
    if (unflagged_colors_ > 0)
      warn(counted(unflagged_colors_, "COLOR_0 of integers is", "COLOR_0 of integers are") +
           " not marked as normalised; taken as normalised");
  }

  const GltfDocument& document_;
  GltfBuffers buffers_;
  bool keep_going_;
  SourceScene& scene_;
  LeftOutList left_out_;
  std::vector<uint32_t> group_of_mesh_;
  std::vector<bool> material_used_;
  std::map<uint32_t, size_t> box_users_;  // first primitive of each accessor whose bounds are kept
  std::vector<std::pair<const char*, const DocPrimitive*>> dropped_;  // reason (null: its mesh is not used), primitive
  uint64_t morphed_ = 0;
  uint64_t undeclared_quantization_ = 0;
  uint64_t unflagged_colors_ = 0;
};

std::string folder_of(const std::string& path) {
  const size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// Removes bytes around the JSON that do not belong to it: a byte order mark, which readers may ignore (RFC 8259 8.1),
// and zeros with which some writers pad a JSON chunk instead of blanks.
Result<void> trim_json(const ByteSource& file, GlbLayout& layout) {
  std::array<std::byte, 3> bytes{};
  if (layout.json_bytes >= bytes.size()) {
    SCREE_TRY(file.read(layout.json_offset, bytes));
    if (bytes == std::array{std::byte{0xef}, std::byte{0xbb}, std::byte{0xbf}}) {
      layout.json_offset += 3;
      layout.json_bytes -= 3;
    }
  }
  for (int i = 0; layout.is_glb && i < 4 && layout.json_bytes > 0; ++i) {
    SCREE_TRY(file.read(layout.json_offset + layout.json_bytes - 1, std::span(bytes).first(1)));
    if (bytes[0] != std::byte{0}) break;
    --layout.json_bytes;
  }
  return {};
}

/// Names the kind of a file that is not glTF at all, which helps more than the first byte that is not JSON.
Result<void> check_kind(const ByteSource& file, const GlbLayout& layout) {
  if (layout.is_glb) return {};
  std::array<std::byte, 64> bytes{};
  const auto head = std::span(bytes).first(std::min<uint64_t>(file.size(), bytes.size()));
  SCREE_TRY(file.read(0, head));
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
  if (text.starts_with(std::string_view(reinterpret_cast<const char*>(format::kMagic), sizeof format::kMagic)))
    return Error{
        ErrorCode::kFormat,
        "is packed already, a .scree file (scree inspect and render read it, scree export decodes it to glTF)"};
  const size_t mark = text.starts_with("\xef\xbb\xbf") ? 3 : 0;
  const size_t first = text.find_first_not_of(" \t\r\n", mark);
  if (first == std::string_view::npos ||
      std::string_view("{[\"-0123456789tfn").find(text[first]) != std::string_view::npos)
    return {};
  return Error{ErrorCode::kFormat, "neither a GLB (no glTF header) nor JSON"};
}

Result<SourceScene> import_checked(const std::string& path, const ImportOptions& options) {
  auto file = open_file_source(path);
  // Its message already begins with the path, like every message of import_gltf().
  if (!file) return Error{file.error().code, file.error().message.substr(path.size() + 2)};
  auto layout = SCREE_TRY(read_glb_layout(**file));
  if (layout.json_bytes == 0) return Error{ErrorCode::kFormat, "the file is empty"};
  SCREE_TRY(check_kind(**file, layout));
  if (layout.json_bytes > options.max_json_bytes) {
    return fail(ErrorCode::kMemory, "JSON of ", layout.json_bytes, " bytes, at most ", options.max_json_bytes,
                " are read");
  }
  const uint64_t least = layout.json_bytes < kLargeDocument ? 0 : tools::memory_use().anonymous + layout.json_bytes;
  if (least > options.memory) return document_too_large(options.memory, layout.json_bytes, "more than", least);
  SCREE_TRY(trim_json(**file, layout));
  auto text = SCREE_TRY(read_json_text(**file, layout.json_offset, layout.json_bytes, options));

  SourceScene scene{.file_name = path.substr(path.rfind('/') == std::string::npos ? 0 : path.rfind('/') + 1),
                    .json_bytes = layout.json_bytes};
  auto document = SCREE_TRY(read_document(std::move(text), options));
  std::vector<std::shared_ptr<const ByteSource>> chunks;
  for (const GlbChunk& chunk : layout.chunks)
    chunks.push_back(chunk.is_binary ? window_source(*file, chunk.offset, chunk.bytes) : nullptr);
  Importer importer(document, folder_of(path), std::move(chunks), options, scene);
  SCREE_TRY(importer.run(options));
  SCREE_TRY(options.check_stop());  // with keep_going, an image that was not opened is a warning
  return scene;
}

}  // namespace

Result<SourceScene> import_gltf(const std::string& path, const ImportOptions& options) {
  Error error{ErrorCode::kFormat, {}};
  try {
    auto scene = import_checked(path, options);
    if (scene) return scene;
    error = scene.error();
  } catch (const std::bad_alloc&) {
    error = {ErrorCode::kMemory, "not enough memory for its document"};
  } catch (const std::exception& exception) {
    error = {ErrorCode::kFormat, exception.what()};
  }
  // Messages quote names and paths of the document, and JSON strings may hold line breaks and terminal codes.
  for (char& c : error.message) c = static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  return at(path, error);
}

}  // namespace scree::convert
