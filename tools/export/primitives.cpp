#include "tools/export/primitives.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <mutex>
#include <new>
#include <thread>
#include <utility>

#include "format/bytes.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"
#include "tools/common/chunk_decode.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/gltf/box.h"

namespace scree::tools {
namespace {

// Small meshes share buffer views, so that a million meshes do not make a million views. The views of large meshes keep
// a size that a viewer can upload at once.
constexpr uint64_t kBatchBytes = uint64_t{16} << 20;

// The most vertices for 16-bit indices. glTF reserves the largest index for primitive restart.
constexpr uint64_t kMaxShortVertices = 65535;

enum Stream : size_t {
  kPositions,
  kNormals,
  kTangents,
  kUvs,
  kSecondUvs,
  kColors,
  kShortIndices,
  kIndices,
  kStreamCount
};

struct StreamFormat {
  const char* attribute;  // null: indices
  uint32_t flag;          // format::AttributeFlags; 0: always there
  uint32_t element_bytes;
  GltfComponent component;
  GltfType type;
  bool normalized;
};

constexpr StreamFormat kStreams[kStreamCount] = {
    {"POSITION", 0, 12, GltfComponent::kFloat32, GltfType::kVec3, false},
    {"NORMAL", format::kHasNormal, 12, GltfComponent::kFloat32, GltfType::kVec3, false},
    {"TANGENT", format::kHasTangent, 16, GltfComponent::kFloat32, GltfType::kVec4, false},
    {"TEXCOORD_0", format::kHasUv, 8, GltfComponent::kFloat32, GltfType::kVec2, false},
    {"TEXCOORD_1", format::kHasSecondUv, 8, GltfComponent::kFloat32, GltfType::kVec2, false},
    {"COLOR_0", format::kHasColor, 4, GltfComponent::kUint8, GltfType::kVec4, true},
    {nullptr, 0, 2, GltfComponent::kUint16, GltfType::kScalar, false},
    {nullptr, 0, 4, GltfComponent::kUint32, GltfType::kScalar, false},
};

/// Consecutive chunks of one mesh that become one primitive.
struct Part {
  uint32_t mesh = 0;
  uint64_t first_chunk = 0;
  uint64_t chunk_count = 0;
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  std::array<uint64_t, kStreamCount> offset{};  // in the buffer
  std::array<uint32_t, kStreamCount> view{};
  std::array<uint64_t, kStreamCount> view_offset{};
  convert::Box box = convert::empty_box();

  bool has_short_indices() const { return vertices <= kMaxShortVertices; }

  /// Number of elements of a stream; 0 if the part lacks it.
  uint64_t elements(size_t stream, uint32_t attributes) const {
    if (stream == kShortIndices) return has_short_indices() ? 3 * triangles : 0;
    if (stream == kIndices) return has_short_indices() ? 0 : 3 * triangles;
    return (attributes & kStreams[stream].flag) == kStreams[stream].flag ? vertices : 0;
  }
};

/// The chunks of one part on one page, which a thread processes at a time.
struct Job {
  uint64_t first_chunk;
  uint64_t chunk_count;
  uint64_t first_vertex;  // within the part
  uint64_t first_triangle;
  uint64_t triangles;
  size_t part;
};

struct Plan {
  std::vector<Part> parts;
  std::vector<Job> jobs;
};

Plan make_plan(const format::Container& file, uint64_t max_vertices) {
  Plan plan;
  const auto meshes = file.meshes();
  const auto chunks = file.chunks();
  for (uint32_t mesh = 0; mesh < meshes.size(); ++mesh) {
    const format::MeshRecord& record = meshes[mesh];
    bool open = false;
    for (uint64_t chunk = record.first_chunk; chunk < record.first_chunk + record.chunk_count; ++chunk) {
      const format::ChunkRecord& piece = chunks[chunk];
      if (piece.triangle_count == 0 || piece.vertex_count == 0) {
        open = false;  // nothing to draw; the chunks of a part stay consecutive
        continue;
      }
      if (!open || plan.parts.back().vertices + piece.vertex_count > max_vertices) {
        plan.parts.push_back({.mesh = mesh, .first_chunk = chunk});
        open = true;
      }
      Part& part = plan.parts.back();
      if (part.chunk_count == 0 || plan.jobs.back().part + 1 != plan.parts.size() ||
          chunks[plan.jobs.back().first_chunk].page != piece.page) {
        plan.jobs.push_back({chunk, 0, part.vertices, part.triangles, 0, plan.parts.size() - 1});
      }
      ++plan.jobs.back().chunk_count;
      plan.jobs.back().triangles += piece.triangle_count;
      ++part.chunk_count;
      part.vertices += piece.vertex_count;
      part.triangles += piece.triangle_count;
    }
  }
  return plan;
}

/// Reserves one buffer view per stream, shared by all `parts`.
Result<void> place_batch(const format::Container& file, GltfWriter& writer, std::span<Part> parts) {
  for (size_t stream = 0; stream < kStreamCount; ++stream) {
    const uint64_t element_bytes = kStreams[stream].element_bytes;
    uint64_t bytes = 0, users = 0;
    for (Part& part : parts) {
      const uint64_t elements = part.elements(stream, file.meshes()[part.mesh].attributes);
      part.view_offset[stream] = bytes;
      bytes += elements * element_bytes;
      users += elements != 0;
    }
    if (bytes == 0) continue;
    const auto offset = SCREE_TRY(writer.reserve(bytes));
    const bool is_vertex = kStreams[stream].attribute != nullptr;
    GltfBufferView view{.offset = offset, .bytes = bytes};
    view.stride =
        is_vertex && users > 1 ? kStreams[stream].element_bytes : 0;  // glTF requires it if accessors share a view
    view.target = is_vertex ? GltfTarget::kVertices : GltfTarget::kIndices;
    const uint32_t number = writer.add_buffer_view(view);
    for (Part& part : parts) {
      part.view[stream] = number;
      part.offset[stream] = offset + part.view_offset[stream];
    }
  }
  return {};
}

Result<void> place_parts(const format::Container& file, GltfWriter& writer, std::span<Part> parts) {
  size_t first = 0;
  uint64_t batch_bytes = 0;
  for (size_t i = 0; i <= parts.size(); ++i) {
    uint64_t bytes = 0;
    if (i < parts.size()) {
      for (size_t stream = 0; stream < kStreamCount; ++stream)
        bytes += parts[i].elements(stream, file.meshes()[parts[i].mesh].attributes) * kStreams[stream].element_bytes;
    }
    if (i > first && (i == parts.size() || batch_bytes + bytes > kBatchBytes)) {
      SCREE_TRY(place_batch(file, writer, parts.subspan(first, i - first)));
      first = i;
      batch_bytes = 0;
    }
    batch_bytes += bytes;
  }
  return {};
}

/// Decodes jobs and writes their data at the reserved offsets. One per thread.
class JobWriter {
 public:
  JobWriter(const format::Container& file, const GltfWriter& writer) : file_(file), writer_(writer), reader_(file) {}

  /// Bytes written so far.
  uint64_t written() const { return written_; }

  /// Extends `box` by the positions of the job.
  Result<void> write(const Job& job, const Part& part, convert::Box& box) {
    uint64_t vertex = job.first_vertex, triangle = job.first_triangle;
    for (uint64_t chunk = job.first_chunk; chunk < job.first_chunk + job.chunk_count; ++chunk) {
      const auto read = SCREE_TRY(reader_.read(chunk, kPartAll & ~uint32_t{kPartSourceIds}));
      const DecodedChunk& decoded = *read;
      convert::grow(box, convert::box_of(decoded.positions));
      for (const Result<void>& done :
           {put(part, kPositions, vertex, std::as_bytes(std::span(decoded.positions))),
            put(part, kNormals, vertex, std::as_bytes(std::span(decoded.normals))),
            put(part, kTangents, vertex, std::as_bytes(std::span(decoded.tangents))),
            put(part, kUvs, vertex, std::as_bytes(std::span(decoded.uvs))),
            put(part, kSecondUvs, vertex, std::as_bytes(std::span(decoded.second_uvs))),
            put_colors(part, vertex, decoded), put_indices(part, vertex, triangle, decoded)}) {
        if (!done) return done.error();
      }
      vertex += file_.chunks()[chunk].vertex_count;
      triangle += file_.chunks()[chunk].triangle_count;
    }
    return {};
  }

 private:
  Result<void> put(const Part& part, Stream stream, uint64_t element, std::span<const std::byte> bytes) {
    if (bytes.empty()) return {};
    written_ += bytes.size();
    return writer_.write_at(part.offset[stream] + element * kStreams[stream].element_bytes, bytes);
  }

  Result<void> put_colors(const Part& part, uint64_t vertex, const DecodedChunk& decoded) {
    bytes_.resize(decoded.colors.size());
    for (size_t i = 0; i < bytes_.size(); ++i)  // exact, because the colours are stored as RGBA8
      bytes_[i] = static_cast<std::byte>(std::lround(std::clamp(decoded.colors[i], 0.0f, 1.0f) * 255.0f));
    return put(part, kColors, vertex, bytes_);
  }

  Result<void> put_indices(const Part& part, uint64_t vertex, uint64_t triangle, const DecodedChunk& decoded) {
    if (part.has_short_indices()) {
      short_indices_.resize(decoded.indices.size());
      for (size_t i = 0; i < short_indices_.size(); ++i)
        short_indices_[i] = static_cast<uint16_t>(vertex + decoded.indices[i]);
      return put(part, kShortIndices, 3 * triangle, std::as_bytes(std::span(short_indices_)));
    }
    indices_.resize(decoded.indices.size());
    for (size_t i = 0; i < indices_.size(); ++i) indices_[i] = static_cast<uint32_t>(vertex + decoded.indices[i]);
    return put(part, kIndices, 3 * triangle, std::as_bytes(std::span(indices_)));
  }

  const format::Container& file_;
  const GltfWriter& writer_;
  ChunkReader reader_;
  uint64_t written_ = 0;
  std::vector<std::byte> bytes_;
  std::vector<uint16_t> short_indices_;
  std::vector<uint32_t> indices_;
};

/// Runs all jobs. The threads share the number of the next job, the boxes of the parts and the error that is first in
/// file order.
class JobRunner {
 public:
  JobRunner(const format::Container& file, const GltfWriter& writer, const ExportOptions& options, Plan& plan)
      : file_(file), writer_(writer), options_(options), plan_(plan) {}

  Result<void> run() {
    const uint32_t threads =
        options_.threads != 0 ? options_.threads : std::max(1u, std::thread::hardware_concurrency());
    runtime::on_threads(std::min<uint64_t>(threads, plan_.jobs.size()), [this](bool is_caller) { work(is_caller); });
    return failure_.any() ? failure_.error() : Result<void>();
  }

 private:
  void work(bool is_caller) {
    JobWriter writer(file_, writer_);
    for (size_t i = next_.fetch_add(1); i < plan_.jobs.size(); i = next_.fetch_add(1)) {
      const Job& job = plan_.jobs[i];
      convert::Box box = convert::empty_box();
      const uint64_t before = writer.written();
      const Result<void> done = write(writer, job, box);
      const format::PageRecord& page = file_.pages()[file_.chunks()[job.first_chunk].page];
      if (options_.is_done_with) options_.is_done_with(page.offset, page.stored_bytes);
      if (!done) {
        // Jobs are taken in order, so all earlier ones have begun and will end.
        failure_.report(i, done.error());
        next_.store(plan_.jobs.size());
        return;
      }
      uint64_t triangles = 0, bytes = 0;
      {
        const std::lock_guard lock(mutex_);
        convert::grow(plan_.parts[job.part].box, box);
        triangles = triangles_ += job.triangles;
        bytes = bytes_ += writer.written() - before;
      }
      if (is_caller && options_.progress) options_.progress(triangles, bytes);
    }
  }

  Result<void> write(JobWriter& writer, const Job& job, convert::Box& box) const try {
    SCREE_TRY(check_stop(options_.stop));
    return writer.write(job, plan_.parts[job.part], box);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "mesh " + std::to_string(plan_.parts[job.part].mesh) + ": out of memory"};
  }

  const format::Container& file_;
  const GltfWriter& writer_;
  const ExportOptions& options_;
  Plan& plan_;
  std::atomic<size_t> next_{0};
  runtime::FirstError failure_;
  std::mutex mutex_;  // for the boxes in plan_ and all members below
  uint64_t triangles_ = 0;
  uint64_t bytes_ = 0;
};

}  // namespace

Result<std::vector<ExportedPrimitive>> write_primitives(const format::Container& file, GltfWriter& writer,
                                                        const ExportOptions& options, uint64_t max_vertices) {
  Plan plan = make_plan(file, max_vertices);
  SCREE_TRY(place_parts(file, writer, plan.parts));
  SCREE_TRY(JobRunner(file, writer, options, plan).run());

  std::vector<ExportedPrimitive> primitives;
  primitives.reserve(plan.parts.size());
  for (const Part& part : plan.parts) {
    const uint32_t attributes = file.meshes()[part.mesh].attributes;
    ExportedPrimitive exported{.mesh = part.mesh,
                               .has_uv = (attributes & format::kHasUv) != 0,
                               .has_second_uv = (attributes & format::kHasSecondUv) != 0,
                               .vertices = part.vertices,
                               .triangles = part.triangles};
    for (size_t stream = 0; stream < kStreamCount; ++stream) {
      const uint64_t elements = part.elements(stream, attributes);
      if (elements == 0) continue;
      GltfAccessor accessor{.buffer_view = part.view[stream],
                            .offset = part.view_offset[stream],
                            .component = kStreams[stream].component,
                            .type = kStreams[stream].type,
                            .normalized = kStreams[stream].normalized,
                            .count = elements};
      if (stream == kPositions) {
        accessor.min.assign(part.box.lo.begin(), part.box.lo.end());
        accessor.max.assign(part.box.hi.begin(), part.box.hi.end());
      }
      const uint32_t number = writer.add_accessor(std::move(accessor));
      if (kStreams[stream].attribute != nullptr) {
        exported.primitive.attributes.emplace_back(kStreams[stream].attribute, number);
      } else {
        exported.primitive.indices = number;
      }
    }
    primitives.push_back(std::move(exported));
  }
  return primitives;
}

}  // namespace scree::tools
