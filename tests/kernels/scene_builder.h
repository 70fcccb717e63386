// Small scenes in memory, through the format's own codecs, for the rasteriser's tests.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <vector>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "format/geometry/tangent_codec.h"
#include "kernels/cpu/backend.h"
#include "kernels/shade/material_views.h"
#include "tests/format/geometry/index_range.h"
#include "tests/results.h"
#include "tools/clusters/cluster_builder.h"

namespace scree::tests {

/// Triangles over float positions (3 per vertex). Optional attributes are empty or have one entry per vertex.
struct Soup {
  std::vector<float> positions;
  std::vector<uint32_t> indices;
  std::vector<float> uvs, colors;
  std::vector<float> normals, second_uvs;
  std::vector<float> tangents;  // with normals

  uint32_t add(double x, double y, double z) {
    for (double c : {x, y, z}) positions.push_back(static_cast<float>(c));
    return static_cast<uint32_t>(positions.size() / 3 - 1);
  }
  void triangle(uint32_t a, uint32_t b, uint32_t c) { indices.insert(indices.end(), {a, b, c}); }
};

enum class Clusters {
  kNone,       // indexed chunks in the soup's order
  kClustered,  // clustered chunks
  kUndone,     // indexed chunks with the triangles and vertices of kClustered, in its order
};

struct Encoding {
  bool float32 = false;
  int32_t exponent = -12;  // of the lattice
  uint32_t chunk_triangles = 65536;
  uint32_t material = format::kNone;
  Clusters clusters = Clusters::kNone;
};

inline Encoding float32() {
  return {.float32 = true};
}

class SceneBuilder {
 public:
  SceneBuilder() = default;
  /// One mesh, drawn once, at its own place.
  explicit SceneBuilder(const Soup& soup, const Encoding& encoding = {}) { instance(mesh(soup, encoding), identity()); }

  /// Adds a mesh of the soup's triangles, cut into chunks that keep the soup's vertex order. Returns its number.
  uint32_t mesh(const Soup& soup, const Encoding& encoding) {
    format::MeshRecord mesh{};
    mesh.triangle_count = soup.indices.size() / 3;
    mesh.first_chunk = chunks.size();
    mesh.material = encoding.material;
    mesh.attributes = (soup.uvs.empty() ? 0u : uint32_t{format::kHasUv}) |
                      (soup.colors.empty() ? 0u : uint32_t{format::kHasColor}) |
                      (soup.normals.empty() ? 0u : uint32_t{format::kHasNormal}) |
                      (soup.second_uvs.empty() ? 0u : uint32_t{format::kHasSecondUv}) |
                      (soup.tangents.empty() ? 0u : uint32_t{format::kHasTangent});
    float lo[3] = {INFINITY, INFINITY, INFINITY};
    float hi[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < soup.positions.size(); ++i) {
      lo[i % 3] = std::min(lo[i % 3], soup.positions[i]);
      hi[i % 3] = std::max(hi[i % 3], soup.positions[i]);
    }
    format::MeshLattice lattice;
    if (!encoding.float32) lattice = must(format::lattice_of_exponent(lo, hi, encoding.exponent));
    mesh.position_encoding = encoding.float32 ? format::PositionEncoding::kFloat32 : format::PositionEncoding::kLattice;
    mesh.lattice_exponent = encoding.float32 ? 0 : encoding.exponent;
    for (size_t i = 0; i < 3; ++i) {
      mesh.lattice_min[i] = encoding.float32 ? 0 : lattice.min[i];
      mesh.lattice_bits[i] = encoding.float32 ? uint8_t{0} : lattice.bits[i];
      mesh.bounds_min[i] =
          encoding.float32 ? lo[i] : format::dequantize(format::quantize(lo[i], encoding.exponent), encoding.exponent);
      mesh.bounds_max[i] =
          encoding.float32 ? hi[i] : format::dequantize(format::quantize(hi[i], encoding.exponent), encoding.exponent);
    }
    for (uint64_t first = 0; first < mesh.triangle_count; first += encoding.chunk_triangles) {
      const uint64_t count = std::min<uint64_t>(encoding.chunk_triangles, mesh.triangle_count - first);
      chunk(soup, encoding, lattice, mesh, first, count);
    }
    mesh.chunk_count = chunks.size() - mesh.first_chunk;
    meshes.push_back(mesh);
    return static_cast<uint32_t>(meshes.size() - 1);
  }

  uint32_t matrix(const std::array<double, 12>& rows) {
    format::MatrixRecord record;
    for (size_t i = 0; i < 12; ++i) record.rows[i / 4][i % 4] = rows[i];
    matrices.push_back(record);
    return static_cast<uint32_t>(matrices.size() - 1);
  }
  uint32_t identity() { return matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}); }

  void instance(uint32_t mesh, uint32_t matrix) { instances.push_back({mesh, 0, matrix, 0}); }

  uint32_t material(uint32_t flags) {
    format::MaterialRecord record{.texture = format::kNone};
    for (float& c : record.base_color) c = 1;
    record.uv_scale[0] = record.uv_scale[1] = 1;
    record.flags = flags;
    materials.push_back(record);
    return static_cast<uint32_t>(materials.size() - 1);
  }

  /// A material whose triangles are masked. `levels`: from the finest on, in the form of MaskView.
  uint32_t masked_material(uint32_t flags, kernels::MaskView mask, std::vector<uint8_t> levels) {
    const uint32_t number = material(flags | format::kMaterialAlphaMask);
    mask.complete();
    masks.resize(materials.size());
    alphas.resize(materials.size());
    masks[number] = mask;
    alphas[number] = std::move(levels);
    return number;
  }

  /// A blended material with alpha `alpha`, times the alpha of `levels` if not empty (as for masked_material()).
  uint32_t blended_material(float alpha, kernels::MaskView mask = {}, std::vector<uint8_t> levels = {}) {
    const uint32_t number = material(format::kMaterialAlphaBlend | format::kMaterialDoubleSided);
    materials[number].base_color[3] = alpha;
    blend_masks.resize(materials.size());
    alphas.resize(materials.size());
    mask.complete();
    blend_masks[number] = mask;
    blend_masks[number].threshold = 1;
    alphas[number] = std::move(levels);
    if (alpha < 1 || alphas[number].empty()) return number;
    masks.resize(materials.size());
    masks[number] = mask;
    masks[number].threshold = format::kMaxMaskThreshold;
    return number;
  }

  /// `first_id`: added to all global ids.
  kernels::SceneView view(uint64_t first_id = 0) {
    bases.assign(1, first_id);
    for (const format::InstanceRecord& i : instances) bases.push_back(bases.back() + meshes[i.mesh].triangle_count);
    page_pointers.clear();
    for (const std::vector<std::byte>& page : pages) page_pointers.push_back(page.data());
    kernels::SceneView scene{};
    scene.meshes = meshes.data();
    scene.chunks = chunks.data();
    scene.instances = instances.data();
    scene.instance_base = bases.data();
    scene.matrices = matrices.data();
    scene.materials = materials.data();
    scene.textures = textures.data();
    scene.pages = page_pointers.data();
    scene.mesh_count = meshes.size();
    scene.chunk_count = chunks.size();
    scene.chunk_kinds = kernels::kinds_of(meshes, chunks);
    scene.instance_count = instances.size();
    scene.matrix_count = matrices.size();
    scene.material_count = materials.size();
    scene.texture_count = textures.size();
    masks.resize(masks.empty() ? 0 : materials.size());
    blend_masks.resize(blend_masks.empty() ? 0 : materials.size());
    for (size_t i = 0; i < alphas.size(); ++i) {
      const uint8_t* const alpha = alphas[i].empty() ? nullptr : alphas[i].data();
      if (!masks.empty() && masks[i].threshold != 0) masks[i].alpha = alpha;
      if (!blend_masks.empty() && blend_masks[i].threshold != 0) blend_masks[i].alpha = alpha;
    }
    scene.masks = masks.empty() ? nullptr : masks.data();
    scene.blend_masks = blend_masks.empty() ? nullptr : blend_masks.data();
    material_views.assign(materials.size(), {});
    kernels::bundle_textures(scene, material_views);
    scene.material_views = material_views.data();
    return scene;
  }

  std::vector<format::MeshRecord> meshes;
  std::vector<format::ChunkRecord> chunks;
  std::vector<format::InstanceRecord> instances;
  std::vector<uint64_t> bases;
  std::vector<format::MatrixRecord> matrices;
  std::vector<format::MaterialRecord> materials;
  std::vector<kernels::TextureView> textures;
  std::vector<kernels::MaterialView> material_views;  // by material; without surfaces
  std::vector<kernels::MaskView> masks;               // by material, or none
  std::vector<kernels::MaskView> blend_masks;         // likewise
  std::vector<std::vector<uint8_t>> alphas;           // by material, likewise
  std::deque<std::vector<std::byte>> pages;           // one per chunk; operator new aligns them to 16
  std::vector<const std::byte*> page_pointers;

 private:
  void chunk(const Soup& soup, const Encoding& encoding, const format::MeshLattice& lattice, format::MeshRecord& mesh,
             uint64_t first, uint64_t count) {
    const std::span<const uint32_t> global(soup.indices.data() + 3 * first, 3 * count);
    std::vector<uint32_t> used(global.begin(), global.end());
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    std::vector<uint32_t> indices;
    for (uint32_t i : global)
      indices.push_back(static_cast<uint32_t>(std::lower_bound(used.begin(), used.end(), i) - used.begin()));
    const auto gather = [&](const std::vector<float>& values, size_t width) {
      std::vector<float> out;
      for (uint32_t v : used)
        out.insert(out.end(), values.begin() + static_cast<ptrdiff_t>(width * v),
                   values.begin() + static_cast<ptrdiff_t>(width * (v + 1)));
      return out;
    };
    std::vector<float> positions = gather(soup.positions, 3);
    std::vector<uint32_t> coordinates(positions.size());
    if (!encoding.float32) format::quantize_positions(coordinates, positions, lattice);
    format::ClusterSet clusters;
    if (encoding.clusters != Clusters::kNone) {
      clusters = cut_clusters(indices, coordinates);
      // The codec's own tests check the decoding of clusters.
      std::vector<uint32_t> vertices;
      for (const uint32_t vertex : clusters.vertices) vertices.push_back(used[vertex]);
      used = vertices;
      positions = gather(soup.positions, 3);
      coordinates.resize(positions.size());
      format::quantize_positions(coordinates, positions, lattice);
    }

    format::ChunkRecord record{.first_triangle = first,
                               .page = static_cast<uint32_t>(pages.size()),
                               .mesh = static_cast<uint32_t>(meshes.size()),
                               .triangle_count = static_cast<uint32_t>(count),
                               .vertex_count = static_cast<uint32_t>(used.size())};
    const format::ClusterRun run{0, clusters.clusters.size(), 0};
    std::vector<std::byte> cluster_bytes;
    if (encoding.clusters != Clusters::kNone) {
      format::describe_clusters(clusters, run, record);
      cluster_bytes.resize(format::cluster_stream_bytes(record.cluster_count, record.cluster_words));
      format::write_clusters(cluster_bytes, clusters, run, record);
      REQUIRE(format::decode_clusters(format::cluster_streams_of(mesh, record, cluster_bytes), {indices, {}, {}}));
    }
    format::IndexRange range{};
    format::PositionRange position_range;
    if (encoding.clusters != Clusters::kClustered) {
      record.encoding = format::ChunkEncoding::kIndexed;
      record.cluster_count = record.cluster_words = 0;
      range = scree::tests::index_range(indices);
      record.index_min = range.min;
      record.index_bits = static_cast<uint8_t>(range.bits);
      if (encoding.float32) {
        position_range.bits = {32, 32, 32};
      } else {
        position_range = format::position_range(coordinates);
      }
      for (size_t i = 0; i < 3; ++i) {
        record.position_min[i] = position_range.min[i];
        record.position_bits[i] = position_range.bits[i];
      }
    }
    const std::vector<float> uvs = gather(soup.uvs, soup.uvs.empty() ? 0 : 2);
    const format::UvRange uv_range = format::choose_uv_range(uvs);
    if (!uvs.empty()) {
      record.uv_exponent = uv_range.exponent;
      for (size_t i = 0; i < 2; ++i) {
        record.uv_min[i] = uv_range.min[i];
        record.uv_bits[i] = uv_range.bits[i];
      }
    }
    record.normal_bits = soup.normals.empty() ? 0 : 12;
    const std::vector<float> second_uvs = gather(soup.second_uvs, soup.second_uvs.empty() ? 0 : 2);
    const format::UvRange second_range = format::choose_uv_range(second_uvs);
    if (!second_uvs.empty()) std::copy(second_range.bits.begin(), second_range.bits.end(), record.second_uv_bits);
    record.tangent_bits = soup.tangents.empty() ? 0 : 12;
    const format::ChunkStreams streams = format::chunk_streams(mesh, record);
    record.bytes = streams.bytes;
    std::vector<std::byte>& page = pages.emplace_back(streams.bytes + 16);  // never empty
    const auto at = [&](const format::ChunkStream& s) { return std::span<std::byte>(page.data() + s.offset, s.bytes); };
    if (encoding.clusters == Clusters::kClustered) {
      std::copy(cluster_bytes.begin(), cluster_bytes.end(), page.begin());
    } else {
      format::encode_indices(at(streams.indices), indices, range);
      if (encoding.float32) {
        format::encode_positions_float32(at(streams.positions), positions);
      } else {
        format::encode_positions(at(streams.positions), coordinates, position_range);
      }
    }
    if (!uvs.empty()) format::encode_uvs(at(streams.uvs), uvs, uv_range);
    if (!soup.colors.empty()) format::encode_colors(at(streams.colors), gather(soup.colors, 4));
    if (!soup.normals.empty()) format::encode_normals(at(streams.normals), gather(soup.normals, 3), record.normal_bits);
    if (!second_uvs.empty()) format::encode_second_uvs(at(streams.second_uvs), second_uvs, second_range);
    if (!soup.tangents.empty()) {
      std::vector<float> normals(3 * used.size());
      REQUIRE(format::decode_normals(normals, record.normal_bits, at(streams.normals)));
      format::encode_tangents(at(streams.tangents), gather(soup.tangents, 4), normals, record.tangent_bits);
    }
    mesh.vertex_count += used.size();
    mesh.source_vertex_count = soup.positions.size() / 3;
    chunks.push_back(record);
  }

  static format::ClusterSet cut_clusters(const std::vector<uint32_t>& indices, const std::vector<uint32_t>& offsets) {
    return tools::ClusterBuilder().build(indices, offsets, tools::ClusterEffort::kFast);
  }
};

/// A perspective camera at `eye` looking at `target`.
inline kernels::View look_at(std::array<double, 3> eye, std::array<double, 3> target, uint32_t width, uint32_t height,
                             double z_near = 0.1, double fov = 1.0) {
  kernels::View view{};
  double f[3];
  double length = 0;
  for (size_t i = 0; i < 3; ++i) {
    view.eye[i] = eye[i];
    f[i] = target[i] - eye[i];
    length += f[i] * f[i];
  }
  for (double& c : f) c /= std::sqrt(length);
  const double up[3] = {0, std::fabs(f[1]) > 0.99 ? 0.0 : 1.0, std::fabs(f[1]) > 0.99 ? 1.0 : 0.0};
  double r[3] = {f[1] * up[2] - f[2] * up[1], f[2] * up[0] - f[0] * up[2], f[0] * up[1] - f[1] * up[0]};
  const double r_length = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
  for (double& c : r) c /= r_length;
  for (int i = 0; i < 3; ++i) {
    view.forward[i] = f[i];
    view.right[i] = r[i];
  }
  view.up[0] = r[1] * f[2] - r[2] * f[1];
  view.up[1] = r[2] * f[0] - r[0] * f[2];
  view.up[2] = r[0] * f[1] - r[1] * f[0];
  view.half_height = std::tan(fov / 2);
  view.half_width = view.half_height * width / height;
  view.z_near = z_near;
  view.width = width;
  view.height = height;
  return view;
}

inline std::vector<uint64_t> draw(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads = 1) {
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu(scene, view, samples, threads));
  return samples;
}

inline std::vector<uint64_t> draw_with(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads,
                                       kernels::InstructionSet set, const kernels::QueueSizes& sizes) {
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu_with(scene, view, samples, threads, set, sizes));
  return samples;
}

/// The same camera as an orthographic one: `half` units above and below the axis.
inline kernels::View orthographic(kernels::View view, double half, double z_near, double z_far) {
  view.orthographic = true;
  view.half_width = half * view.width / view.height;
  view.half_height = half;
  view.z_near = z_near;
  view.z_far = z_far;
  return view;
}

inline uint64_t covered(const std::vector<uint64_t>& samples) {
  return static_cast<uint64_t>(
      std::count_if(samples.begin(), samples.end(), [](uint64_t s) { return s != kernels::kBackground; }));
}

/// A height field over [-1, 1]^2 in x and z, of n x n quads with bumps of `amplitude`. Counter-clockwise from above.
inline Soup grid(uint32_t n, double amplitude) {
  Soup soup;
  for (uint32_t j = 0; j <= n; ++j) {
    for (uint32_t i = 0; i <= n; ++i) {
      const double x = 2.0 * i / n - 1.0, z = 2.0 * j / n - 1.0;
      soup.add(x, amplitude * std::sin(7 * x + 1) * std::cos(9 * z), z);
    }
  }
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i;
      soup.triangle(a, a + n + 1, a + n + 2);
      soup.triangle(a, a + n + 2, a + 1);
    }
  }
  return soup;
}

/// An instance at (origin, -origin, origin) that is rotated about z and squashed, and for every seventh `round` also
/// mirrored. `unit`: returns numbers from -1 to 1.
template <class Unit>
void add_turned_instance(SceneBuilder& scene, uint32_t mesh, int round, double origin, Unit&& unit) {
  const double turn = 3 * unit();
  const double mirror = round % 7 == 0 ? -1.0 : 1.0;
  const double height = 1 + 0.5 * unit();
  scene.instance(mesh, scene.matrix({mirror * std::cos(turn), -std::sin(turn), 0, origin, mirror * std::sin(turn),
                                     std::cos(turn), 0, -origin, 0, 0, height, origin}));
}

/// A grid with random heights up to `amplitude` up and down, so that any plane at its height cuts triangles everywhere.
inline Soup rough_field(uint32_t n, double amplitude) {
  Soup soup = grid(n, 0);
  uint32_t state = 1;
  for (size_t i = 1; i < soup.positions.size(); i += 3) {
    state = state * 1664525u + 1013904223u;
    soup.positions[i] = static_cast<float>(amplitude * ((state >> 8) / 8388608.0 - 1.0));
  }
  return soup;
}

/// A closed sphere of radius 1 with `n` rows of quads and bumps of `amplitude`. Counter-clockwise from outside.
inline Soup sphere(uint32_t n, double amplitude) {
  Soup soup;
  const uint32_t columns = 2 * n;
  const double pi = 3.14159265358979323846;
  soup.add(0, 1, 0);
  for (uint32_t j = 1; j < n; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      const double a = pi * j / n;
      const double b = 2 * pi * i / columns;
      const double r = 1 + amplitude * std::sin(5 * b) * std::sin(4 * a);
      soup.add(r * std::sin(a) * std::cos(b), r * std::cos(a), -r * std::sin(a) * std::sin(b));
    }
  }
  const uint32_t south = soup.add(0, -1, 0);
  const auto at = [&](uint32_t row, uint32_t column) { return 1 + (row - 1) * columns + column % columns; };
  for (uint32_t i = 0; i < columns; ++i) {
    soup.triangle(0, at(1, i), at(1, i + 1));
    soup.triangle(south, at(n - 1, i + 1), at(n - 1, i));
  }
  for (uint32_t j = 1; j + 1 < n; ++j) {
    for (uint32_t i = 0; i < columns; ++i) {
      soup.triangle(at(j, i), at(j + 1, i), at(j + 1, i + 1));
      soup.triangle(at(j, i), at(j + 1, i + 1), at(j, i + 1));
    }
  }
  return soup;
}

}  // namespace scree::tests
