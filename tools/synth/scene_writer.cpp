// Writes scenes A to D as glTF: threads generate windows of vertices and quads and write each at its offset.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <numbers>
#include <optional>
#include <vector>

#include "runtime/threads/parallel.h"
#include "tools/common/output/progress.h"
#include "tools/gltf/box.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/synth.h"
#include "tools/synth/textures.h"

namespace scree::synth {
namespace {

using namespace tools;

// A window has 1.5 MiB of positions and normals, or of indices: large enough for efficient writes, small enough for
// many threads.
constexpr uint32_t kWindowVertices = 65536;
constexpr uint32_t kWindowQuads = 65536;
constexpr uint64_t kMaxShortVertices = 65535;  // index 65535 would be a primitive restart

/// Offsets of a mesh's streams in the buffer.
struct MeshPlace {
  uint64_t positions = 0, normals = 0, uvs = 0, indices = 0;  // byte offsets
  bool short_indices = false;
};

/// Vertices or quads [first, first + count) of a mesh, which a thread makes at a time.
struct Window {
  uint32_t mesh;
  bool quads;
  uint32_t first;
  uint32_t count;
};

struct Sums {
  uint64_t positions = 0;
  uint64_t indices = 0;
};

uint64_t check_key(uint32_t mesh, uint64_t place) {
  return uint64_t{mesh} << 40 | place;
}

/// The surface's normal at a vertex: the cross product of central differences along the grid. They are one-sided where
/// the grid ends: at the edges of a blob's faces, and at the terrain's outer border, where no neighbouring tile
/// continues the grid.
Float3 vertex_normal(const MeshRecipe& mesh, uint32_t face, int x, int y) {
  const int n = static_cast<int>(mesh.n);
  const bool terrain = mesh.kind == MeshKind::kTerrain;
  const int low_x = terrain ? -static_cast<int>(mesh.tile_x) * n : 0;
  const int low_y = terrain ? -static_cast<int>(mesh.tile_y) * n : 0;
  const int high = terrain ? n + 1 : n;
  const Double3 x0 = surface_position(mesh, face, std::max(x - 1, low_x), y);
  const Double3 x1 = surface_position(mesh, face, std::min(x + 1, high), y);
  const Double3 y0 = surface_position(mesh, face, x, std::max(y - 1, low_y));
  const Double3 y1 = surface_position(mesh, face, x, std::min(y + 1, high));
  const Double3 a{x1.x - x0.x, x1.y - x0.y, x1.z - x0.z}, b{y1.x - y0.x, y1.y - y0.y, y1.z - y0.z};
  const Double3 c{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  const double length = std::sqrt(c.x * c.x + c.y * c.y + c.z * c.z);
  if (!(length > 0)) return {0, 0, 1};
  return {static_cast<float>(c.x / length), static_cast<float>(c.y / length), static_cast<float>(c.z / length)};
}

/// State of one thread: buffers that live as long as it does, and its sums.
class Generator {
 public:
  Generator(const Scene& scene, const SynthOptions& options, const GltfWriter* writer,
            const std::vector<MeshPlace>& places)
      : scene_(scene), options_(options), writer_(writer), places_(places) {}

  /// Runs one window. `box`: receives the box of its vertices.
  Result<void> run(const Window& window, convert::Box& box) {
    return window.quads ? make_quads(window) : make_vertices(window, box);
  }
  const Sums& sums() const { return sums_; }

 private:
  Result<void> make_vertices(const Window& window, convert::Box& box) {
    const MeshRecipe& mesh = scene_.meshes[window.mesh];
    floats_.resize(uint64_t{window.count} * 3);
    for (uint32_t i = 0; i < window.count; ++i) {
      const Float3 p = vertex_position(mesh, window.first + i);
      const float xyz[3] = {p.x, p.y, p.z};
      std::copy(xyz, xyz + 3, &floats_[uint64_t{i} * 3]);
    }
    box = convert::box_of(floats_);
    if (options_.checks) {
      const uint64_t first = check_key(window.mesh, uint64_t{window.first} * 3);
      for (uint64_t i = 0; i < floats_.size(); ++i)
        sums_.positions += check_term(first + i, std::bit_cast<uint32_t>(floats_[i]));
    }
    if (writer_ == nullptr) return {};
    const MeshPlace& place = places_[window.mesh];
    Result<void> written = write(place.positions + uint64_t{window.first} * 12, floats_);
    if (!written || !(options_.normals || options_.uvs)) return written;

    const uint32_t per_face = (mesh.n + 1) * (mesh.n + 1);
    uvs_.resize(options_.uvs ? uint64_t{window.count} * 2 : 0);
    for (uint32_t i = 0; i < window.count; ++i) {
      const uint32_t face = (window.first + i) / per_face;
      uint32_t x, y;
      grid_place(mesh.order, mesh.n, window.first + i - face * per_face, &x, &y);
      if (options_.normals) {
        const Float3 normal = vertex_normal(mesh, face, static_cast<int>(x), static_cast<int>(y));
        const float xyz[3] = {normal.x, normal.y, normal.z};
        std::copy(xyz, xyz + 3, &floats_[uint64_t{i} * 3]);
      }
      if (options_.uvs) {
        uvs_[uint64_t{i} * 2] = static_cast<float>(static_cast<double>(x) / mesh.n);
        uvs_[uint64_t{i} * 2 + 1] = static_cast<float>(1.0 - static_cast<double>(y) / mesh.n);  // v points down
      }
    }
    if (options_.normals) written = write(place.normals + uint64_t{window.first} * 12, floats_);
    if (written && options_.uvs) written = write(place.uvs + uint64_t{window.first} * 8, uvs_);
    return written;
  }

  Result<void> make_quads(const Window& window) {
    const MeshRecipe& mesh = scene_.meshes[window.mesh];
    indices_.resize(uint64_t{window.count} * 6);
    for (uint32_t i = 0; i < window.count; ++i) quad_indices(mesh, window.first + i, &indices_[uint64_t{i} * 6]);
    const uint64_t first = uint64_t{window.first} * 6;
    if (options_.checks) {
      const uint64_t key = check_key(window.mesh, first);
      for (uint64_t i = 0; i < indices_.size(); ++i) sums_.indices += check_term(key + i, indices_[i]);
    }
    if (writer_ == nullptr) return {};
    const MeshPlace& place = places_[window.mesh];
    if (!place.short_indices) return write(place.indices + first * 4, indices_);
    shorts_.resize(indices_.size());
    std::transform(indices_.begin(), indices_.end(), shorts_.begin(),
                   [](uint32_t index) { return static_cast<uint16_t>(index); });
    return write(place.indices + first * 2, shorts_);
  }

  template <class T>
  Result<void> write(uint64_t offset, const std::vector<T>& values) const {
    return writer_->write_at(offset, std::as_bytes(std::span(values)));
  }

  const Scene& scene_;
  const SynthOptions& options_;
  const GltfWriter* writer_;
  const std::vector<MeshPlace>& places_;
  std::vector<float> floats_, uvs_;
  std::vector<uint32_t> indices_;
  std::vector<uint16_t> shorts_;
  Sums sums_;
};

std::vector<Window> make_windows(const Scene& scene) {
  std::vector<Window> windows;
  for (uint32_t m = 0; m < scene.meshes.size(); ++m) {
    const uint32_t vertices = static_cast<uint32_t>(vertex_count(scene.meshes[m]));
    for (uint32_t first = 0; first < vertices; first += kWindowVertices)
      windows.push_back({m, false, first, std::min(kWindowVertices, vertices - first)});
    const uint32_t quads = static_cast<uint32_t>(triangle_count(scene.meshes[m]) / 2);
    for (uint32_t first = 0; first < quads; first += kWindowQuads)
      windows.push_back({m, true, first, std::min(kWindowQuads, quads - first)});
  }
  return windows;
}

/// Makes every window, and fills in the meshes' boxes.
Result<Sums> generate(const Scene& scene, const SynthOptions& options, const GltfWriter* writer,
                      const std::vector<MeshPlace>& places, std::vector<convert::Box>& boxes) {
  const std::vector<Window> windows = make_windows(scene);
  std::vector<convert::Box> window_boxes(windows.size());
  std::atomic<uint64_t> next{0};
  std::mutex mutex;
  std::optional<Error> failed;
  Sums sums;
  Progress progress(options.progress);
  const uint64_t triangles = scene.unique_triangles();
  progress.stage("synth " + options.scene, triangles);
  const auto work = [&](bool reports) {
    Generator generator(scene, options, writer, places);
    for (uint64_t i = next++; i < windows.size(); i = next++) {
      if (reports) {
        const double share = static_cast<double>(i) / static_cast<double>(windows.size());
        const uint64_t bytes = writer == nullptr ? 0 : writer->buffer_bytes();
        progress.update(static_cast<uint64_t>(share * static_cast<double>(triangles)),
                        static_cast<uint64_t>(share * static_cast<double>(bytes)));
      }
      const Result<void> done = generator.run(windows[i], window_boxes[i]);
      if (done) continue;
      next = windows.size();
      const std::lock_guard lock(mutex);
      if (!failed) failed = done.error();
      return;
    }
    const std::lock_guard lock(mutex);
    sums.positions += generator.sums().positions;
    sums.indices += generator.sums().indices;
  };
  runtime::on_threads(thread_count(options.threads, windows.size()), work);
  if (failed) return *failed;
  for (uint64_t i = 0; i < windows.size(); ++i)
    if (!windows[i].quads) convert::grow(boxes[windows[i].mesh], window_boxes[i]);
  return sums;
}

Result<std::vector<MeshPlace>> reserve_streams(GltfWriter& writer, const Scene& scene, const SynthOptions& options) {
  std::vector<MeshPlace> places;
  for (const MeshRecipe& mesh : scene.meshes) {
    const uint64_t vertices = vertex_count(mesh);
    MeshPlace place;
    place.short_indices = vertices <= kMaxShortVertices;
    place.positions = SCREE_TRY(writer.reserve(vertices * 12));
    if (options.normals) place.normals = SCREE_TRY(writer.reserve(vertices * 12));
    if (options.uvs) place.uvs = SCREE_TRY(writer.reserve(vertices * 8));
    place.indices = SCREE_TRY(writer.reserve(triangle_count(mesh) * (place.short_indices ? 6 : 12)));
    places.push_back(place);
  }
  return places;
}

void add_mesh(GltfWriter& writer, uint32_t number, const MeshRecipe& mesh, const MeshPlace& place,
              const convert::Box& box, const SynthOptions& options, uint32_t material) {
  const uint64_t vertices = vertex_count(mesh), indices = triangle_count(mesh) * 3;
  GltfPrimitive primitive{.material = material};
  GltfAccessor accessor{.count = vertices};
  if (options.normals)
    primitive.attributes.emplace_back(
        "NORMAL", add_stream(writer, place.normals, vertices * 12, accessor, GltfTarget::kVertices));
  accessor.min.assign(box.lo.begin(), box.lo.end());
  accessor.max.assign(box.hi.begin(), box.hi.end());
  primitive.attributes.emplace_back(
      "POSITION", add_stream(writer, place.positions, vertices * 12, accessor, GltfTarget::kVertices));
  accessor.min.clear();
  accessor.max.clear();
  accessor.type = GltfType::kVec2;
  if (options.uvs)
    primitive.attributes.emplace_back("TEXCOORD_0",
                                      add_stream(writer, place.uvs, vertices * 8, accessor, GltfTarget::kVertices));
  accessor.type = GltfType::kScalar;
  accessor.component = place.short_indices ? GltfComponent::kUint16 : GltfComponent::kUint32;
  accessor.count = indices;
  primitive.indices =
      add_stream(writer, place.indices, indices * (place.short_indices ? 2 : 4), accessor, GltfTarget::kIndices);
  writer.add_mesh({"mesh" + std::to_string(number), {std::move(primitive)}});
}

/// The scene's instances without their matrices.
std::vector<Placement> placements_of(const Scene& scene) {
  std::vector<Placement> placements;
  for (const SceneInstance& instance : scene.instances) {
    Placement placement{instance.mesh, instance.translation, {}, instance.scale};
    const double half_sine = std::sqrt(std::max(0.0, (1 - instance.cosine) / 2));
    const double half_cosine = std::sqrt(std::max(0.0, (1 + instance.cosine) / 2));
    placement.rotation = {0, 0, instance.sine < 0 ? -half_sine : half_sine, half_cosine};
    placements.push_back(placement);
  }
  return placements;
}

void add_plain_nodes(GltfWriter& writer, const Scene& scene, std::vector<uint32_t>& children) {
  for (uint32_t i = 0; i < scene.instances.size(); ++i) {
    GltfNode node{.name = "instance" + std::to_string(i), .mesh = scene.instances[i].mesh, .has_matrix = true};
    std::copy(scene.instances[i].matrix.begin(), scene.instances[i].matrix.end(), node.local.begin());
    children.push_back(writer.add_node(std::move(node)));
  }
}

void add_cameras(GltfWriter& writer, const Scene& scene, std::vector<uint32_t>& children) {
  for (const SceneCamera& camera : scene.cameras) {
    const GltfCamera lens{.name = camera.name,
                          .y = std::numbers::pi / 3,
                          .x = static_cast<double>(scene.width) / scene.height,
                          .z_near = 0.1};
    children.push_back(writer.add_node({.name = camera.name,
                                        .camera = writer.add_camera(lens),
                                        .has_matrix = true,
                                        .local = camera_to_world(camera)}));
  }
}

}  // namespace

Result<SynthReport> write_scene(const Scene& scene, const SynthOptions& options) {
  SynthReport report{.unique_triangles = scene.unique_triangles(), .drawn_triangles = scene.drawn_triangles()};
  for (const MeshRecipe& mesh : scene.meshes) report.vertices += vertex_count(mesh);
  report.instances = scene.instances.size();

  std::vector<convert::Box> boxes(scene.meshes.size(), convert::empty_box());
  if (options.output.empty()) {
    const Sums sums = SCREE_TRY(generate(scene, options, nullptr, {}, boxes));
    report.position_sum = sums.positions;
    report.index_sum = sums.indices;
    return report;
  }

  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output, {}, options.existing));
  writer.stop_on(options.stop);
  const std::vector<MeshPlace> places = SCREE_TRY(reserve_streams(writer, scene, options));
  const Sums sums = SCREE_TRY(generate(scene, options, &writer, places, boxes));
  report.position_sum = sums.positions;
  report.index_sum = sums.indices;

  uint32_t material = format::kNone;
  if (options.uvs) {
    const uint32_t texture =
        SCREE_TRY(add_texture(writer, {"granite", TextureKind::kGranite, 512}, options.threads, options.stop));
    GltfMaterial granite;
    granite.name = "granite";
    granite.texture = texture;
    material = writer.add_material(granite);
  }
  for (uint32_t m = 0; m < scene.meshes.size(); ++m)
    add_mesh(writer, m, scene.meshes[m], places[m], boxes[m], options, material);

  // The definition has z up, glTF has y up: (x, y, z) -> (x, z, -y), exactly.
  const uint32_t root_node = writer.add_node(
      {.name = scene.name, .has_matrix = true, .local = {1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1}});
  std::vector<uint32_t> children;
  if (options.gpu_instancing) {
    SCREE_TRY(add_instanced_nodes(writer, placements_of(scene), children));
  } else {
    add_plain_nodes(writer, scene, children);
  }
  add_cameras(writer, scene, children);
  writer.node(root_node).children = std::move(children);
  writer.add_scene({scene.name, {root_node}});
  SCREE_TRY(writer.finish());
  report.file_bytes = writer.total_bytes();
  return report;
}

}  // namespace scree::synth
