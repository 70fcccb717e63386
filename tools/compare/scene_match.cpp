#include "tools/compare/scene_match.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "kernels/frame.h"
#include "tools/common/chunk_decode.h"

namespace scree::compare {
namespace {

using format::ChunkRecord;
using format::InstanceRecord;
using format::MeshRecord;
using runtime::Scene;

const MeshRecord& mesh_of(const Scene& scene, uint64_t instance) {
  return scene.view().meshes[scene.view().instances[instance].mesh];
}

/// Identifies an instance in every file of its source. The order of instances differs between files that share equal
/// meshes and files that do not.
struct InstanceKey {
  uint32_t node, node_instance;
  uint64_t primitive;  // number among the glTF mesh's primitives that keep a triangle
  auto operator<=>(const InstanceKey&) const = default;
};

InstanceKey key_of(const Scene& scene, uint64_t instance) {
  const InstanceRecord& record = scene.view().instances[instance];
  const uint32_t group = scene.view().meshes[record.mesh].group;
  return {record.node, record.node_instance, uint64_t{record.mesh} - scene.container().groups()[group].first_mesh};
}

std::vector<uint64_t> sorted_instances(const Scene& scene) {
  std::vector<uint64_t> order(scene.view().instance_count);
  std::iota(order.begin(), order.end(), uint64_t{0});
  std::sort(order.begin(), order.end(), [&](uint64_t i, uint64_t j) { return key_of(scene, i) < key_of(scene, j); });
  return order;
}

/// The largest allowed distance between the same coordinate in two files, including the rounding of this sum.
double allowed_distance(const MeshRecord& a, const MeshRecord& b) {
  return (a.max_position_error + b.max_position_error) * (1 + 1e-9);
}

bool is_near(float a, float b, double allowed) {
  return std::abs(static_cast<double>(a) - static_cast<double>(b)) <= allowed;
}

bool equal_matrices(const Scene& a, const InstanceRecord& in_a, const Scene& b, const InstanceRecord& in_b) {
  const auto &rows_a = a.container().matrices()[in_a.matrix].rows, &rows_b = b.container().matrices()[in_b.matrix].rows;
  return std::equal(&rows_a[0][0], &rows_a[0][0] + 12, &rows_b[0][0]);
}

/// The reason why an instance of one file cannot be that of the other; empty if it can.
std::string difference(const Scene& a, uint64_t instance_a, const Scene& b, uint64_t instance_b) {
  const InstanceRecord &in_a = a.view().instances[instance_a], &in_b = b.view().instances[instance_b];
  const MeshRecord &mesh_a = a.view().meshes[in_a.mesh], &mesh_b = b.view().meshes[in_b.mesh];
  const std::string node = "node " + std::to_string(in_a.node);
  if (key_of(a, instance_a) != key_of(b, instance_b)) return node + " draws other meshes";
  if (mesh_a.triangle_count != mesh_b.triangle_count)
    return node + " draws " + std::to_string(mesh_a.triangle_count) + " triangles, but " +
           std::to_string(mesh_b.triangle_count);
  if (!equal_matrices(a, in_a, b, in_b)) return node + " has another transform";
  const double allowed = allowed_distance(mesh_a, mesh_b);
  for (size_t axis = 0; axis < 3; ++axis)
    if (!is_near(mesh_a.bounds_min[axis], mesh_b.bounds_min[axis], allowed) ||
        !is_near(mesh_a.bounds_max[axis], mesh_b.bounds_max[axis], allowed))
      return node + " draws meshes of other sizes";
  return {};
}

std::vector<StoredTriangle> stored_triangles(const Scene& scene, std::span<const uint64_t> ids,
                                             std::vector<uint64_t>& instances) {
  std::vector<StoredTriangle> out;
  out.reserve(ids.size());
  instances.reserve(ids.size());
  for (const uint64_t id : ids) {
    const kernels::Hit hit = kernels::find_triangle(scene.view(), id);
    out.push_back({hit.chunk, hit.triangle});
    instances.push_back(hit.instance);
  }
  return out;
}

/// The source numbers of triangles. Decodes each chunk once.
Result<std::vector<uint64_t>> source_numbers(const Scene& scene, std::span<const StoredTriangle> triangles) {
  std::vector<uint64_t> out(triangles.size());
  tools::ChunkReader reader(scene.container());
  const tools::DecodedChunk* chunk = nullptr;
  uint64_t number = UINT64_MAX;
  for (const uint64_t i : by_chunk(triangles)) {
    if (triangles[i].chunk != number) {
      number = triangles[i].chunk;
      chunk = SCREE_TRY_AT(scene.file().path(), reader.read(number, tools::kPartSourceIds));
    }
    out[i] = chunk->source_ids[triangles[i].place];
  }
  return out;
}

std::vector<uint64_t> stored_numbers(const Scene& scene, std::span<const StoredTriangle> triangles) {
  std::vector<uint64_t> out;
  out.reserve(triangles.size());
  for (const StoredTriangle& triangle : triangles)
    out.push_back(scene.view().chunks[triangle.chunk].first_triangle + triangle.place);
  return out;
}

/// A chunk and its counterpart in the other file.
struct ChunkPair {
  uint64_t a, b;
  auto operator<=>(const ChunkPair&) const = default;
};
constexpr uint64_t kNoChunk = UINT64_MAX;

/// The chunk of `other_mesh` with the same number in its mesh as `chunk`.
uint64_t same_place(const Scene& scene, uint64_t chunk, const MeshRecord& other_mesh) {
  const MeshRecord& mesh = scene.view().meshes[scene.view().chunks[chunk].mesh];
  const uint64_t place = chunk - mesh.first_chunk;
  return place < other_mesh.chunk_count ? other_mesh.first_chunk + place : kNoChunk;
}

/// Whether two chunks have the same triangles in the same order.
Result<bool> is_same_chunk(const Scene& a, tools::ChunkReader& reader_a, const Scene& b, tools::ChunkReader& reader_b,
                           const ChunkPair& pair) {
  if (pair.a == kNoChunk || pair.b == kNoChunk) return false;
  const ChunkRecord &record_a = a.view().chunks[pair.a], &record_b = b.view().chunks[pair.b];
  if (record_a.first_triangle != record_b.first_triangle || record_a.triangle_count != record_b.triangle_count ||
      record_a.vertex_count != record_b.vertex_count)
    return false;
  const auto chunk_a =
      SCREE_TRY_AT(a.file().path(), reader_a.read(pair.a, tools::kPartIndices | tools::kPartPositions));
  const auto chunk_b =
      SCREE_TRY_AT(b.file().path(), reader_b.read(pair.b, tools::kPartIndices | tools::kPartPositions));
  const double allowed = allowed_distance(a.view().meshes[record_a.mesh], b.view().meshes[record_b.mesh]);
  return chunk_a->indices == chunk_b->indices &&
         std::equal(chunk_a->positions.begin(), chunk_a->positions.end(), chunk_b->positions.begin(),
                    chunk_b->positions.end(), [&](float p, float q) { return is_near(p, q, allowed); });
}

/// Checks that the chunks of every pair are the same. Error kUnsupported if not, because ids then stand for different
/// triangles.
Result<void> check_chunks(const Scene& a, const Scene& b, std::vector<ChunkPair> pairs) {
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  tools::ChunkReader reader_a(a.container()), reader_b(b.container());
  for (const ChunkPair& pair : pairs) {
    const bool same = SCREE_TRY(is_same_chunk(a, reader_a, b, reader_b, pair));
    if (!same)
      return Error{ErrorCode::kUnsupported,
                   a.file().path() + " and " + b.file().path() +
                       " store their triangles differently; convert both with --source-ids to match them"};
  }
  return {};
}

/// A triangle of a mesh to be found, and its index in the request.
struct Wanted {
  uint32_t mesh;
  uint64_t number;
  uint64_t asked;
};

/// Finds the chunks of `wanted`, which all belong to one mesh and are sorted by source number. `out`: indexed by
/// Wanted::asked.
Result<void> find_in_mesh(const Scene& scene, tools::ChunkReader& reader, std::span<const Wanted> wanted,
                          std::vector<StoredTriangle>& out) {
  const auto first_from = [&](uint64_t number) {
    return std::lower_bound(wanted.begin(), wanted.end(), number,
                            [](const Wanted& w, uint64_t n) { return w.number < n; });
  };
  const MeshRecord& mesh = scene.view().meshes[wanted.front().mesh];
  for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
    const ChunkRecord& record = scene.view().chunks[c];
    const auto first = first_from(record.source_min);
    if (first == wanted.end() || ((first->number - record.source_min) >> record.source_bits) != 0) continue;
    const auto read = SCREE_TRY_AT(scene.file().path(), reader.read(c, tools::kPartSourceIds));
    for (uint32_t t = 0; t < record.triangle_count; ++t)
      for (auto w = first_from(read->source_ids[t]); w != wanted.end() && w->number == read->source_ids[t]; ++w)
        out[w->asked] = {c, t};
  }
  return {};
}

}  // namespace

std::vector<uint64_t> by_chunk(std::span<const StoredTriangle> triangles) {
  std::vector<uint64_t> order(triangles.size());
  std::iota(order.begin(), order.end(), uint64_t{0});
  std::sort(order.begin(), order.end(), [&](uint64_t i, uint64_t j) { return triangles[i] < triangles[j]; });
  return order;
}

std::string SceneMatch::names() const {
  return a_->file().path() + " and " + b_->file().path();
}

Result<void> SceneMatch::match_instances() {
  const auto other_source = [&](const std::string& what) {
    return Error{ErrorCode::kFormat, names() + " are not made from one source: " + what};
  };
  const uint64_t count = a_->view().instance_count;
  if (count != b_->view().instance_count)
    return other_source(std::to_string(count) + " instances, but " + std::to_string(b_->view().instance_count));
  const std::vector<uint64_t> order_a = sorted_instances(*a_), order_b = sorted_instances(*b_);
  a_of_b_.resize(count);
  b_of_a_.resize(count);
  by_source_ = true;
  for (uint64_t i = 0; i < count; ++i) {
    if (const std::string what = difference(*a_, order_a[i], *b_, order_b[i]); !what.empty()) return other_source(what);
    b_of_a_[order_a[i]] = order_b[i];
    a_of_b_[order_b[i]] = order_a[i];
    by_source_ = by_source_ && (mesh_of(*a_, order_a[i]).attributes & format::kHasSourceIds) != 0 &&
                 (mesh_of(*b_, order_b[i]).attributes & format::kHasSourceIds) != 0;
  }
  return {};
}

Result<SceneMatch> SceneMatch::match(const Scene& a, const Scene& b) {
  SceneMatch match(a, b);
  SCREE_TRY(match.match_instances());
  return match;
}

Result<SceneMatch::Resolved> SceneMatch::resolve(std::span<const uint64_t> ids_a,
                                                 std::span<const uint64_t> ids_b) const {
  std::vector<uint64_t> instances_a, instances_b;
  const std::vector<StoredTriangle> in_a = stored_triangles(*a_, ids_a, instances_a);
  const std::vector<StoredTriangle> in_b = stored_triangles(*b_, ids_b, instances_b);
  std::vector<uint64_t> numbers_a, numbers_b;
  if (by_source_) {
    Result<std::vector<uint64_t>> read = source_numbers(*a_, in_a);
    if (!read) return read.error();
    numbers_a = std::move(*read);
    read = source_numbers(*b_, in_b);
    if (!read) return read.error();
    numbers_b = std::move(*read);
  } else {
    numbers_a = stored_numbers(*a_, in_a);
    numbers_b = stored_numbers(*b_, in_b);
  }
  const bool two_scenes = a_ != b_;
  if (two_scenes && !by_source_) {
    std::vector<ChunkPair> pairs;
    for (size_t i = 0; i < in_a.size(); ++i)
      pairs.push_back({in_a[i].chunk, same_place(*a_, in_a[i].chunk, mesh_of(*b_, b_of_a_[instances_a[i]]))});
    for (size_t i = 0; i < in_b.size(); ++i)
      pairs.push_back({same_place(*b_, in_b[i].chunk, mesh_of(*a_, a_of_b_[instances_b[i]])), in_b[i].chunk});
    SCREE_TRY(check_chunks(*a_, *b_, std::move(pairs)));
  }
  Resolved out;
  for (size_t i = 0; i < in_a.size(); ++i)
    out.a.push_back({two_scenes ? b_of_a_[instances_a[i]] : instances_a[i], numbers_a[i]});
  for (size_t i = 0; i < in_b.size(); ++i) out.b.push_back({instances_b[i], numbers_b[i]});
  return out;
}

Result<std::vector<StoredTriangle>> SceneMatch::find(std::span<const CommonTriangle> triangles) const {
  std::vector<StoredTriangle> out(triangles.size(), StoredTriangle{kNoChunk, 0});
  if (!by_source_) {
    for (size_t i = 0; i < triangles.size(); ++i) {
      const uint64_t first_id = b_->view().instance_base[triangles[i].instance];
      const kernels::Hit hit = kernels::find_triangle(b_->view(), first_id + triangles[i].number);
      out[i] = {hit.chunk, hit.triangle};
    }
    return out;
  }
  std::vector<Wanted> wanted;
  wanted.reserve(triangles.size());
  for (size_t i = 0; i < triangles.size(); ++i)
    wanted.push_back({b_->view().instances[triangles[i].instance].mesh, triangles[i].number, i});
  std::sort(wanted.begin(), wanted.end(),
            [](const Wanted& p, const Wanted& q) { return p.mesh != q.mesh ? p.mesh < q.mesh : p.number < q.number; });
  tools::ChunkReader reader(b_->container());
  for (auto first = wanted.begin(); first != wanted.end();) {
    const auto end = std::find_if(first, wanted.end(), [&](const Wanted& w) { return w.mesh != first->mesh; });
    SCREE_TRY(find_in_mesh(*b_, reader, {first, end}, out));
    for (; first != end; ++first)
      if (out[first->asked].chunk == kNoChunk)
        return Error{ErrorCode::kFormat, names() + " are not made from one source: mesh " +
                                             std::to_string(first->mesh) + " has no source triangle " +
                                             std::to_string(first->number) + " in the second"};
  }
  return out;
}

}  // namespace scree::compare
