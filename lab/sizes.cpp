#include "lab/sizes.h"

#include <meshoptimizer.h>
#include <zstd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <tuple>
#include <utility>

#include "format/geometry/chunk_layout.h"
#include "lab/options.h"
#include "lab/setup/work_folder.h"
#include "runtime/threads/stopwatch.h"
#include "tools/bench/csv.h"
#include "tools/common/chunk_decode.h"
#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"
#include "tools/convert/convert.h"

namespace scree::lab {
namespace {

using Bytes = std::vector<std::byte>;
using tools::fixed;

constexpr int kZstdLevels[] = {0, 3, 9, 19};
constexpr uint32_t kPositionBits = 16;
constexpr int kDecodings = 3;  // the fastest one counts

/// Processor time of `work` in seconds: the minimum of `times` runs.
template <class Work>
double seconds_of(const Work& work, int times = 1) {
  double least = INFINITY;
  for (int i = 0; i < times; ++i) {
    const runtime::Stopwatch watch;
    work();
    least = std::min(least, watch.elapsed().cpu_ms * 1e-3);
  }
  return least;
}

/// A mesh in the form for codecs of whole meshes: without repeated vertices, with scree's lattice offsets.
struct PlainMesh {
  std::vector<uint32_t> indices;
  std::vector<uint16_t> positions;  // x, y, z, 0: lattice offsets
  std::vector<uint16_t> normals;    // u, v: octahedral codes; empty: none

  size_t vertices() const { return positions.size() / 4; }
};

Result<PlainMesh> plain_mesh(const format::Container& file, uint64_t number, tools::ChunkReader& reader) {
  const format::MeshRecord& mesh = file.meshes()[number];
  PlainMesh out;
  if (mesh.chunk_count == 0) return out;
  const format::ChunkRecord& chunk = file.chunks()[mesh.first_chunk];
  const auto decoded = SCREE_TRY(reader.read(mesh.first_chunk));
  out.indices = decoded->indices;
  const std::vector<float>& floats = decoded->positions;
  out.positions.resize(4 * size_t{chunk.vertex_count});
  for (size_t v = 0; v < chunk.vertex_count; ++v) {
    for (size_t axis = 0; axis < 3; ++axis) {
      // Exact: a lattice position is a multiple of the step, a power of two.
      const double coordinate = std::ldexp(floats[3 * v + axis], -mesh.lattice_exponent);
      out.positions[4 * v + axis] = static_cast<uint16_t>(coordinate - static_cast<double>(mesh.lattice_min[axis]));
    }
  }
  if ((mesh.attributes & format::kHasNormal) != 0) {
    std::vector<std::byte> scratch;
    const auto page = SCREE_TRY(file.load_page(chunk.page, scratch));
    const uint32_t bits = chunk.normal_bits;
    const std::byte* codes = page.data() + chunk.offset + format::chunk_streams(mesh, chunk).normals.offset;
    out.normals.resize(2 * size_t{chunk.vertex_count});
    for (size_t i = 0; i < out.normals.size(); ++i)
      out.normals[i] = static_cast<uint16_t>(format::unpack(codes, i * bits, bits));
  }
  return out;
}

/// Measures the size of meshes in meshoptimizer's codecs.
class MeshoptCodec {
 public:
  explicit MeshoptCodec(const std::vector<PlainMesh>& meshes) : meshes_(meshes) {}

  void encode() {
    for (const PlainMesh& mesh : meshes_) {
      const size_t vertices = mesh.vertices();
      std::vector<uint32_t> indices(mesh.indices.size());
      meshopt_optimizeVertexCache(indices.data(), mesh.indices.data(), indices.size(), vertices);
      std::vector<uint32_t> remap(vertices);
      meshopt_optimizeVertexFetchRemap(remap.data(), indices.data(), indices.size(), vertices);
      meshopt_remapIndexBuffer(indices.data(), indices.data(), indices.size(), remap.data());
      Bytes stream(meshopt_encodeIndexBufferBound(indices.size(), vertices));
      stream.resize(meshopt_encodeIndexBuffer(reinterpret_cast<unsigned char*>(stream.data()), stream.size(),
                                              indices.data(), indices.size()));
      put(std::move(stream), indices.size(), 0);
      put_vertices(mesh.positions, 8, remap);
      if (!mesh.normals.empty()) put_vertices(mesh.normals, 4, remap);
    }
  }

  Result<void> decode(const std::vector<Bytes>& streams) const {
    Bytes out;
    for (size_t i = 0; i < streams.size(); ++i) {
      const auto* from = reinterpret_cast<const unsigned char*>(streams[i].data());
      const size_t stride = kinds_[i].second == 0 ? 4 : kinds_[i].second;
      out.resize(kinds_[i].first * stride);
      const int failed = kinds_[i].second == 0
                             ? meshopt_decodeIndexBuffer(out.data(), kinds_[i].first, stride, from, streams[i].size())
                             : meshopt_decodeVertexBuffer(out.data(), kinds_[i].first, stride, from, streams[i].size());
      if (failed != 0) return Error{ErrorCode::kFormat, "meshoptimizer cannot decode its own output"};
    }
    return {};
  }

  const std::vector<Bytes>& streams() const { return streams_; }

 private:
  /// `stride`: bytes of a vertex; 0 for indices.
  void put(Bytes stream, size_t count, size_t stride) {
    streams_.push_back(std::move(stream));
    kinds_.push_back({count, stride});
  }

  void put_vertices(const std::vector<uint16_t>& values, size_t stride, const std::vector<uint32_t>& remap) {
    const size_t count = remap.size();
    std::vector<uint16_t> ordered(values.size());
    meshopt_remapVertexBuffer(ordered.data(), values.data(), count, stride, remap.data());
    Bytes stream(meshopt_encodeVertexBufferBound(count, stride));
    stream.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(stream.data()), stream.size(),
                                             ordered.data(), count, stride));
    put(std::move(stream), count, stride);
  }

  const std::vector<PlainMesh>& meshes_;
  std::vector<Bytes> streams_;
  std::vector<std::pair<size_t, size_t>> kinds_;  // number of elements and bytes per element
};

Bytes zstd_packed(const Bytes& bytes, int level) {
  Bytes out(ZSTD_compressBound(bytes.size()));
  out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), level));
  return out;
}

/// Measures one model, with or without normals.
class ModelSizes {
 public:
  ModelSizes(const std::string& model, bool normals, const WorkFolder& folder, std::vector<SizeRow>& rows)
      : model_(model), normals_(normals), folder_(folder), rows_(rows) {}

  Result<void> run() {
    SCREE_TRY(read_meshes());
    if (normals_ && !has_normals_) return {};
    for (const auto& [encoding, effort, name] :
         {std::tuple{convert::Encoding::kIndexed, tools::ClusterEffort::kFast, "indexed"},
          std::tuple{convert::Encoding::kClustered, tools::ClusterEffort::kFast, "clustered"},
          std::tuple{convert::Encoding::kClustered, tools::ClusterEffort::kBest, "clustered best"}}) {
      for (const int level : kZstdLevels) SCREE_TRY(measure_ours(encoding, effort, name, level));
    }
    SCREE_TRY(measure_meshopt());
    return {};
  }

  bool has_normals() const { return has_normals_; }

 private:
  SizeRow row(const std::string& encoding, int level) const {
    return {.model = file_name(model_),
            .encoding = encoding,
            .content = normals_ ? "normals" : "geometry",
            .zstd_level = level,
            .triangles = triangles_,
            .vertices = vertices_};
  }

  convert::ConvertOptions options() const {
    convert::ConvertOptions options;
    options.input = model_;
    options.output = folder_.file("out.scree");
    options.position_bits = kPositionBits;
    options.normals = normals_ ? convert::Normals::kAlways : convert::Normals::kNever;
    options.threads = 1;
    return options;
  }

  /// Reads every mesh as one chunk, and the sizes in the glTF.
  Result<void> read_meshes() {
    convert::ConvertOptions whole = options();
    whole.chunk_triangles = 0;
    whole.encoding = convert::Encoding::kIndexed;  // clusters would store border vertices several times
    SCREE_TRY(convert::convert(whole));
    const auto opened = SCREE_TRY(runtime::SceneFile::open(whole.output));
    tools::ChunkReader reader(opened.container());
    for (uint64_t m = 0; m < opened.container().meshes().size(); ++m) {
      auto mesh = SCREE_TRY(plain_mesh(opened.container(), m, reader));
      triangles_ += mesh.indices.size() / 3;
      vertices_ += mesh.vertices();
      has_normals_ |= !mesh.normals.empty();
      meshes_.push_back(std::move(mesh));
    }
    const format::SourceRecord& source = opened.container().source();
    SizeRow gltf = row("glTF", 0);
    gltf.disk_bytes = source.index_bytes + source.position_bytes * (normals_ ? 2 : 1);  // both have three floats per
                                                                                        // vertex
    gltf.device_bytes = gltf.disk_bytes;
    rows_.push_back(gltf);
    return {};
  }

  Result<void> measure_ours(convert::Encoding encoding, tools::ClusterEffort effort, const char* name, int level) {
    convert::ConvertOptions packed = options();
    packed.encoding = encoding;
    packed.clusters = effort;
    packed.zstd_level = level;
    SizeRow out = row(name, level);
    Result<void> failed;
    out.encode_s = seconds_of([&] {
      if (const auto done = convert::convert(packed); !done) failed = done.error();
    });
    if (!failed) return failed;
    const auto opened = SCREE_TRY(runtime::SceneFile::open(packed.output));
    for (uint64_t i = 0; i < opened.container().pages().size(); ++i) {
      if (opened.container().pages()[i].kind != format::PageKind::kGeometry) continue;
      out.device_bytes += opened.container().pages()[i].raw_bytes;
      out.disk_bytes += opened.container().pages()[i].stored_bytes;
    }
    out.decode_s = seconds_of(
        [&] {
          tools::ChunkReader reader(opened.container());
          for (uint64_t i = 0; i < opened.container().chunks().size(); ++i)
            if (const auto read = reader.read(i); !read) failed = read.error();
        },
        kDecodings);
    if (!failed) return failed;
    rows_.push_back(out);
    return {};
  }

  Result<void> measure_meshopt() {
    MeshoptCodec codec(meshes_);
    const double encode_s = seconds_of([&] { codec.encode(); });
    for (const int level : kZstdLevels) {
      SizeRow out = row("meshoptimizer", level);
      out.device_bytes = 12 * triangles_ + (normals_ ? 12 : 8) * vertices_;  // u32 indices, u16 positions and normals
      std::vector<Bytes> streams = codec.streams();
      out.encode_s = encode_s;
      if (level > 0) {
        out.encode_s += seconds_of([&] {
          for (Bytes& stream : streams) stream = zstd_packed(stream, level);
        });
      }
      for (const Bytes& stream : streams) out.disk_bytes += stream.size();
      Result<void> decoded;
      out.decode_s = seconds_of(
          [&] {
            std::vector<Bytes> raw = codec.streams();
            for (size_t i = 0; level > 0 && i < streams.size(); ++i)
              ZSTD_decompress(raw[i].data(), raw[i].size(), streams[i].data(), streams[i].size());
            decoded = codec.decode(raw);
          },
          kDecodings);
      if (!decoded) return decoded;
      rows_.push_back(out);
    }
    return {};
  }

  std::string model_;
  bool normals_;
  const WorkFolder& folder_;
  std::vector<SizeRow>& rows_;
  std::vector<PlainMesh> meshes_;
  uint64_t triangles_ = 0;
  uint64_t vertices_ = 0;
  bool has_normals_ = false;
};

bench::CsvCells size_cells(const SizeRow& row) {
  using bench::csv_number;
  return {{"model", row.model},
          {"content", row.content},
          {"encoding", row.encoding},
          {"zstd_level", csv_number(static_cast<uint64_t>(row.zstd_level))},
          {"triangles", csv_number(row.triangles)},
          {"vertices", csv_number(row.vertices)},
          {"device_bytes", csv_number(row.device_bytes)},
          {"disk_bytes", csv_number(row.disk_bytes)},
          {"encode_s", csv_number(row.encode_s)},
          {"decode_s", csv_number(row.decode_s)}};
}

/// A table of bytes per triangle.
std::string sizes_table(const std::vector<SizeRow>& rows) {
  inspect::TextTable table(3);
  table.row(
      {"model", "content", "encoding", "zstd", "GPU, B/tri", "disk, B/tri", "encode, M tri/s", "decode, M tri/s"});
  table.rule();
  for (const SizeRow& row : rows) {
    const auto triangles = static_cast<double>(row.triangles);
    const auto each = [&](uint64_t bytes) {
      return bytes == 0 ? "-" : fixed(static_cast<double>(bytes) / triangles, 2);
    };
    const auto speed = [&](double seconds) { return seconds > 0 ? fixed(triangles / seconds * 1e-6, 2) : "-"; };
    table.row({inspect::printable(row.model), row.content, row.encoding,
               row.zstd_level == 0 ? "-" : std::to_string(row.zstd_level), each(row.device_bytes), each(row.disk_bytes),
               speed(row.encode_s), speed(row.decode_s)});
  }
  return table.text();
}

}  // namespace

Result<std::vector<SizeRow>> measure_sizes(const std::vector<std::string>& models) {
  const auto folder = SCREE_TRY(WorkFolder::make());
  std::vector<SizeRow> rows;
  for (const std::string& model : models) {
    for (const bool normals : {false, true}) {
      std::vector<SizeRow> measured;
      ModelSizes sizes(model, normals, folder, measured);
      SCREE_TRY(sizes.run());
      if (normals && !sizes.has_normals()) continue;
      rows.insert(rows.end(), measured.begin(), measured.end());
    }
  }
  return rows;
}

Result<void> run_sizes(const std::vector<std::string>& models, const std::string& csv) {
  const auto rows = SCREE_TRY(measure_sizes(models));
  std::printf("%s", sizes_table(rows).c_str());
  for (const SizeRow& row : rows) {
    if (csv.empty()) break;
    SCREE_TRY(bench::append_csv(csv, size_cells(row)));
  }
  return {};
}

}  // namespace scree::lab
