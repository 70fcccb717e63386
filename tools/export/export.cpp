#include "tools/export/export.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <new>
#include <utility>
#include <vector>

#include "format/jpeg/index.h"
#include "runtime/files/mapped_file.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/textures/block_image.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/human.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/progress.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/sigbus.h"
#include "tools/common/process/stop_signal.h"
#include "tools/convert/passes/shard.h"
#include "tools/export/primitives.h"
#include "tools/gltf/write/writer.h"

namespace scree::tools {
namespace {

using format::kNone;

// glTF reserves index 2^32 - 1 for primitive restart.
constexpr uint64_t kMaxPrimitiveVertices = 0xffffffffu;

/// The document's materials. In glTF a primitive needs the texture coordinates that its material's textures use, while
/// a source may use one material for primitives with and without them. Primitives without them get a copy of the
/// material without these textures.
class Materials {
 public:
  Materials(const format::Container& file, GltfWriter& writer) : file_(file), writer_(writer) {
    for (uint32_t i = 0; i < file.surfaces().size(); ++i) surface_of_[file.surfaces()[i].material] = i;
    for (uint32_t i = 0; i < file.materials().size(); ++i) writer.add_material(material(i));
  }

  /// The document's material for a mesh.
  uint32_t of(uint32_t number, bool has_uv, bool has_second_uv) {
    if (number == kNone || has_second_uv) return number;
    GltfMaterial copy = material(number);
    bool is_changed = false;
    const auto remove = [&](uint32_t& texture) {
      is_changed = is_changed || texture != kNone;
      texture = kNone;
    };
    if (!has_uv) {
      remove(copy.texture);
      copy.transform = {};
    }
    for (uint32_t use = 0; copy.surface && use < format::kSurfaceUses; ++use)
      if (!has_uv || (copy.surface->second_uv >> use & 1u) != 0) remove(copy.surface->textures[use].texture);
    if (!is_changed) return number;
    const auto [found, is_new] = untextured_.try_emplace({number, has_uv}, 0);
    if (is_new) found->second = writer_.add_material(std::move(copy));
    return found->second;
  }

 private:
  GltfMaterial material(uint32_t number) const {
    const format::MaterialRecord& record = file_.materials()[number];
    GltfMaterial material{.name = std::string(file_.string(record.name))};
    for (size_t i = 0; i < 4; ++i) material.base_color[i] = static_cast<double>(record.base_color[i]);
    material.texture = record.texture;
    if (record.texture != kNone) {
      for (size_t i = 0; i < 2; ++i) {
        material.transform.offset[i] = static_cast<double>(record.uv_offset[i]);
        material.transform.scale[i] = static_cast<double>(record.uv_scale[i]);
      }
      material.transform.rotation = static_cast<double>(record.uv_rotation);
    }
    if (record.flags & format::kMaterialAlphaMask) {
      material.alpha = GltfAlpha::kMask;
      material.alpha_cutoff = static_cast<double>(record.alpha_cutoff);
    } else if (record.flags & format::kMaterialAlphaBlend) {
      material.alpha = GltfAlpha::kBlend;
    }
    material.double_sided = record.flags & format::kMaterialDoubleSided;
    material.unlit = record.flags & format::kMaterialUnlit;
    if (const auto found = surface_of_.find(number); found != surface_of_.end())
      material.surface = file_.surfaces()[found->second];
    return material;
  }

  const format::Container& file_;
  std::map<uint32_t, uint32_t> surface_of_;  // by material: its surface record
  GltfWriter& writer_;
  std::map<std::pair<uint32_t, bool>, uint32_t> untextured_;  // by number and whether the first set remains
};

/// Converts an indexed JPEG to a JPEG file with the same coefficients.
Result<std::vector<std::byte>> rebuild_jpeg(std::span<const std::byte> bytes) {
  const auto index = SCREE_TRY(format::open_jpeg_index(bytes));
  std::vector<std::byte> file(format::jpeg_file_bound(index));
  const auto size = SCREE_TRY(format::decode_jpeg_index(file, index));
  file.resize(size);
  return file;
}

/// Converts level 0 of a block image to a PNG, decoded and swizzled.
Result<std::vector<std::byte>> make_png(const format::Container& file, uint32_t image) try {
  const auto picture = SCREE_TRY(runtime::decode_block_image(file, image));
  return runtime::encode_png({picture.width, picture.height, 4, picture.rgba}, {.is_small = true});
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory to decode it"};
}

/// By image: the mask with the alpha that an indexed JPEG has lost, or kNone.
std::vector<uint32_t> lost_alphas(const format::Container& file) {
  std::vector<uint32_t> masks(file.images().size(), kNone);
  for (uint32_t i = 0; i < file.masks().size(); ++i) {
    if ((file.masks()[i].flags & format::kMaskOfColors) != 0) continue;
    const uint32_t texture = file.materials()[file.masks()[i].material].texture;
    if (texture == kNone) continue;
    const uint32_t image = file.textures()[texture].image;
    const format::ImageRecord& record = file.images()[image];
    const format::MaskRecord& mask = file.masks()[i];
    if (record.codec == format::ImageCodec::kIndexedJpeg && record.width == mask.width &&
        record.height == mask.height && masks[image] == kNone)
      masks[image] = i;
  }
  return masks;
}

/// Converts an indexed JPEG to a PNG with the alpha of a mask of the same size.
Result<std::vector<std::byte>> add_alpha(const format::Container& file, std::span<const std::byte> jpeg,
                                         const format::MaskRecord& mask) try {
  auto picture = SCREE_TRY(runtime::decode_image(jpeg));
  std::vector<std::byte> scratch;
  const auto alpha = SCREE_TRY(file.load_page(mask.page, scratch));
  if (picture.width != mask.width || picture.height != mask.height)
    return Error{ErrorCode::kFormat, "the image is " + std::to_string(picture.width) + " x " +
                                         std::to_string(picture.height) + ", but its mask " +
                                         std::to_string(mask.width) + " x " + std::to_string(mask.height)};
  for (size_t i = 0; i < picture.rgba.size() / 4; ++i) picture.rgba[4 * i + 3] = std::to_integer<uint8_t>(alpha[i]);
  return runtime::encode_png({picture.width, picture.height, 4, picture.rgba}, {.is_small = true});
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory to decode it"};
}

format::ImageCodec exported_codec(format::ImageCodec codec, bool has_lost_alpha) {
  if (codec == format::ImageCodec::kIndexedJpeg)
    return has_lost_alpha ? format::ImageCodec::kPng : format::ImageCodec::kJpeg;
  return codec == format::ImageCodec::kBlocks ? format::ImageCodec::kPng : codec;
}

/// The images that add_images() will add.
std::vector<GltfWriter::PlannedImage> planned_images(const format::Container& file) {
  std::vector<GltfWriter::PlannedImage> planned;
  const auto images = file.images();
  const std::vector<uint32_t> masks = lost_alphas(file);
  for (uint32_t i = 0; i < images.size(); ++i) {
    planned.push_back({file.string(images[i].name), exported_codec(images[i].codec, masks[i] != kNone)});
  }
  return planned;
}

Result<void> add_images(const format::Container& file, GltfWriter& writer, const ExportOptions& options) {
  std::vector<std::byte> scratch;
  const auto images = file.images();
  const std::vector<uint32_t> masks = lost_alphas(file);
  for (uint32_t i = 0; i < images.size(); ++i) {
    const format::ImageCodec codec = exported_codec(images[i].codec, masks[i] != kNone);
    SCREE_TRY(check_stop(options.stop));
    const std::string place = "image " + std::to_string(i) + ", page " + std::to_string(images[i].page);
    const std::string_view name = file.string(images[i].name);
    if (images[i].codec == format::ImageCodec::kBlocks) {
      const auto png = SCREE_TRY_AT(place, make_png(file, i));
      SCREE_TRY(writer.add_image(name, codec, png));
      continue;
    }
    const auto bytes = SCREE_TRY_AT(place, file.load_page(images[i].page, scratch));
    if (images[i].codec == format::ImageCodec::kIndexedJpeg) {
      auto image = rebuild_jpeg(bytes);
      if (image && masks[i] != kNone) image = add_alpha(file, *image, file.masks()[masks[i]]);
      if (!image) return at(place, image.error());
      SCREE_TRY(writer.add_image(name, codec, *image));
      continue;
    }
    SCREE_TRY(writer.add_image(name, images[i].codec, bytes));
  }
  return {};
}

void add_textures(const format::Container& file, GltfWriter& writer) {
  const auto textures = file.textures();
  for (uint32_t i = 0; i < textures.size(); ++i) {
    writer.add_texture({.name = std::string(file.string(textures[i].name)),
                        .image = textures[i].image,
                        .wrap_s = textures[i].wrap_s,
                        .wrap_t = textures[i].wrap_t,
                        .mag_filter = textures[i].mag_filter,
                        .min_filter = textures[i].min_filter});
  }
}

void add_cameras(const format::Container& file, GltfWriter& writer) {
  const auto cameras = file.cameras();
  for (uint32_t i = 0; i < cameras.size(); ++i) {
    writer.add_camera({.name = std::string(file.string(cameras[i].name)),
                       .kind = cameras[i].kind,
                       .y = cameras[i].y,
                       .x = cameras[i].x,
                       .z_near = cameras[i].z_near,
                       .z_far = cameras[i].z_far});
  }
}

/// Adds one mesh per group. Returns its number per group; kNone for groups without triangles (glTF has no empty
/// meshes). Moves from `primitives`, which are in the order of the meshes.
std::vector<uint32_t> add_meshes(const format::Container& file, GltfWriter& writer, Materials& materials,
                                 std::vector<ExportedPrimitive>& primitives) {
  const auto groups = file.groups();
  std::vector<uint32_t> numbers(groups.size(), kNone);
  for (size_t first = 0, last = 0; first < primitives.size(); first = last) {
    const uint32_t group = file.meshes()[primitives[first].mesh].group;
    GltfMesh mesh{.name = std::string(file.string(groups[group].name))};
    for (; last < primitives.size() && file.meshes()[primitives[last].mesh].group == group; ++last) {
      ExportedPrimitive& exported = primitives[last];
      exported.primitive.material =
          materials.of(file.meshes()[exported.mesh].material, exported.has_uv, exported.has_second_uv);
      mesh.primitives.push_back(std::move(exported.primitive));
    }
    numbers[group] = writer.add_mesh(std::move(mesh));
  }
  return numbers;
}

/// Scales a quaternion to unit length in double precision. A quaternion of length 0 becomes the identity.
void normalize(double* rotation) {
  double length = 0;
  for (int i = 0; i < 4; ++i) length = std::hypot(length, rotation[i]);
  for (int i = 0; i < 4; ++i) rotation[i] = length > 0 ? rotation[i] / length : (i == 3 ? 1.0 : 0.0);
}

/// Adds the three accessors of EXT_mesh_gpu_instancing.
Result<void> add_node_instances(const format::Container& file, GltfWriter& writer, const format::NodeRecord& record,
                                GltfNode& node) {
  const uint64_t count = record.node_instance_count;
  const auto instances = file.node_instances();
  struct Attribute {
    const char* name;
    size_t components;
    GltfType type;
    const float* (*values)(const format::NodeInstanceRecord&);
  };
  const Attribute attributes[] = {
      {"TRANSLATION", 3, GltfType::kVec3, [](const format::NodeInstanceRecord& r) { return +r.translation; }},
      {"ROTATION", 4, GltfType::kVec4, [](const format::NodeInstanceRecord& r) { return +r.rotation; }},
      {"SCALE", 3, GltfType::kVec3, [](const format::NodeInstanceRecord& r) { return +r.scale; }},
  };
  std::vector<float> values;
  for (const Attribute& attribute : attributes) {
    values.clear();
    values.reserve(attribute.components * count);
    for (uint64_t i = 0; i < count; ++i) {
      const float* of_instance = attribute.values(instances[record.first_node_instance + i]);
      values.insert(values.end(), of_instance, of_instance + attribute.components);
    }
    const auto bytes = std::as_bytes(std::span(values));
    const auto offset = SCREE_TRY(writer.append(bytes));
    const GltfBufferView view{.offset = offset, .bytes = bytes.size()};
    node.instancing.emplace_back(
        attribute.name,
        writer.add_accessor({.buffer_view = writer.add_buffer_view(view), .type = attribute.type, .count = count}));
  }
  return {};
}

Result<void> add_nodes(const format::Container& file, GltfWriter& writer, const std::vector<uint32_t>& mesh_of_group) {
  const auto nodes = file.nodes();
  for (uint32_t i = 0; i < nodes.size(); ++i) {
    const format::NodeRecord& record = nodes[i];
    GltfNode node;
    node.name = std::string(file.string(record.name));
    node.camera = record.camera;
    if (record.group != kNone) node.mesh = mesh_of_group[record.group];
    node.has_matrix = record.flags & format::kNodeHasMatrix;
    std::copy(std::begin(record.local), std::end(record.local), node.local.begin());
    if (!node.has_matrix) normalize(node.local.data() + 3);
    if (node.mesh != kNone && record.node_instance_count != 0) {
      SCREE_TRY_AT("node " + std::to_string(i), add_node_instances(file, writer, record, node));
    }
    writer.add_node(std::move(node));
    if (record.parent != kNone) writer.node(record.parent).children.push_back(i);
  }
  return {};
}

/// Adds the lights to their nodes. In glTF a node has one light; a further one gets a child of the node.
void add_lights(const format::Container& file, GltfWriter& writer) {
  const auto lights = file.lights();
  for (uint64_t i = 0; i < lights.size(); ++i) {
    const uint32_t light = writer.add_light({.name = std::string(file.string(lights[i].name)), .record = lights[i]});
    if (GltfNode& node = writer.node(lights[i].node); node.light == kNone) {
      node.light = light;
    } else {
      node.children.push_back(writer.add_node({.light = light}));
    }
  }
}

Result<void> add_scenes(const format::Container& file, GltfWriter& writer) {
  const auto scenes = file.scenes();
  const auto roots = file.scene_roots();
  for (uint32_t i = 0; i < scenes.size(); ++i) {
    GltfScene scene{.name = std::string(file.string(scenes[i].name))};
    for (uint64_t place = 0; place < scenes[i].root_count; ++place) {
      const uint32_t root = roots[scenes[i].first_root + place];
      if (const uint32_t parent = file.nodes()[root].parent; parent != kNone) {
        return Error{ErrorCode::kUnsupported, "scene " + std::to_string(i) + ": its root, node " +
                                                  std::to_string(root) + ", is a child of node " +
                                                  std::to_string(parent) + ", which glTF does not allow"};
      }
      scene.nodes.push_back(root);
    }
    writer.add_scene(std::move(scene));
    if (scenes[i].flags & 1) writer.set_default_scene(i);
  }
  return {};
}

struct Arguments {
  std::string input;
  std::string output;
  uint32_t threads = 0;
  bool force = false;
  bool json = false;
  bool quiet = false;
};

Result<ExportSummary> export_mapped(const Arguments& arguments, const runtime::MappedFile& map) {
  const auto file = SCREE_TRY(format::Container::open(map.bytes()));
  SCREE_TRY(convert::check_no_shard(file));
  uint64_t triangles = 0;
  for (uint64_t i = 0; i < file.meshes().size(); ++i) triangles += file.meshes()[i].triangle_count;
  Progress progress(!arguments.quiet);
  progress.stage("export", triangles);
  ExportOptions options;
  options.source = arguments.input;
  options.threads = arguments.threads;
  options.existing = existing_of(arguments.force);
  options.stop = StopOnSignal::flag();
  options.progress = [&](uint64_t done, uint64_t bytes) { progress.update(done, bytes); };
  // Exported parts of the file are released, since the file may be larger than memory.
  options.is_done_with = [&](uint64_t offset, uint64_t bytes) { map.release(offset, bytes); };
  options.check_source = [&] { return check_unchanged(map); };
  const StopOnSignal handlers;
  return export_gltf(file, arguments.output, options);
}

Result<void> run_export(const Arguments& arguments) {
  const auto start = std::chrono::steady_clock::now();
  SCREE_TRY(check_output_file(arguments.output, existing_of(arguments.force)));
  report_sigbus("export", arguments.input);
  const auto map = SCREE_TRY(runtime::MappedFile::open(arguments.input, runtime::Access::kSequential));
  const auto summary = export_mapped(arguments, map);
  if (!summary) {
    // If the file was cut short, that is the real cause of errors such as a wrong checksum.
    SCREE_TRY(check_unchanged(map));
    const Error& error = summary.error();
    const bool names_output = error.code == ErrorCode::kUsage || error.code == ErrorCode::kFile;
    return names_output ? error : at(arguments.input, error);
  }
  note_written(arguments.output);
  if (summary->is_version_3)
    std::fprintf(stderr, "scree export: warning: %s%s\n", arguments.output.c_str(), kVersion3Note);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (arguments.json) {
    const std::string text = json_object([&](JsonWriter& json) {
      json.member("file", arguments.input);
      json.member("file_bytes", uint64_t{map.size()});
      json.member("output", arguments.output);
      json.member("output_bytes", summary->bytes);
      json.member("triangles", summary->triangles);
      json.member("vertices", summary->vertices);
      json.member("primitives", summary->primitives);
      json.member("images", summary->images);
      json.member("seconds", seconds);
    });
    std::printf("%s\n", text.c_str());
    return finish_output();
  }
  if (arguments.quiet) return {};
  std::printf("%s (%s) -> %s (%s): %s triangles, %s vertices, %s primitives, %s images in %.2f s\n",
              arguments.input.c_str(), format_bytes(map.size()).c_str(), arguments.output.c_str(),
              format_bytes(summary->bytes).c_str(), grouped(summary->triangles).c_str(),
              grouped(summary->vertices).c_str(), grouped(summary->primitives).c_str(),
              grouped(summary->images).c_str(), seconds);
  return finish_output();
}

}  // namespace

Result<ExportSummary> export_gltf(const format::Container& file, const std::string& path,
                                  const ExportOptions& options) {
  auto created = SCREE_TRY(GltfWriter::create(path, file.string(file.source().copyright), options.existing));
  GltfWriter& writer = created;
  SCREE_TRY(writer.check_files(planned_images(file), options.source));

  auto primitives = SCREE_TRY(write_primitives(file, writer, options, kMaxPrimitiveVertices));
  ExportSummary summary{.primitives = primitives.size()};
  for (const ExportedPrimitive& primitive : primitives) {
    summary.vertices += primitive.vertices;
    summary.triangles += primitive.triangles;
  }

  SCREE_TRY(add_images(file, writer, options));
  summary.images = file.images().size();
  add_textures(file, writer);
  Materials materials(file, writer);
  const std::vector<uint32_t> mesh_of_group = add_meshes(file, writer, materials, primitives);
  add_cameras(file, writer);
  SCREE_TRY(add_nodes(file, writer, mesh_of_group));
  add_lights(file, writer);
  SCREE_TRY(add_scenes(file, writer));

  if (options.check_source) SCREE_TRY(options.check_source());
  SCREE_TRY(writer.finish());
  summary.bytes = writer.total_bytes();
  summary.is_version_3 = writer.is_version_3();
  return summary;
}

Command add_export(CLI::App& parent) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* app = parent.add_subcommand("export", "Decodes a .scree file to glTF");
  app->add_option("FILE", arguments->input, "The .scree file")->required();
  add_value(*app, "-o,--output", "FILE", arguments->output, "Output: .glb, or .gltf with .bin and images beside it")
      ->required();
  app->add_flag("-f,--force", arguments->force, kForceHelp);
  app->add_flag("--json", arguments->json, "Print one JSON object instead of the closing line");
  app->add_flag("-q,--quiet", arguments->quiet, "No progress and no closing line");
  add_whole(*app, "--threads", arguments->threads, 0, kMostThreads, "Threads; 0: one per processor");
  return {app, [arguments] { return run_export(*arguments); }};
}

}  // namespace scree::tools
