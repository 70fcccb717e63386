#include "format/geometry/cluster_codec.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <string>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_scan.h"
#include "format/geometry/packed_values.h"
#include "format/processor.h"

namespace scree::format {
namespace {

using enum ErrorCode;

constexpr uint32_t kMaxBoundsShift = 16;  // boxes of 2^24

void grow(OffsetBox& box, const PackedCluster& cluster) {
  for (int i = 0; i < 3; ++i) {
    box.min[i] = std::min(box.min[i], cluster.min[i]);
    box.max[i] = std::max(box.max[i], cluster.max[i]);
  }
}

OffsetBox box_of(std::span<const PackedCluster> clusters) {
  OffsetBox box{{~0u, ~0u, ~0u}, {0, 0, 0}};
  for (const PackedCluster& cluster : clusters) grow(box, cluster);
  return box;
}

std::span<const PackedCluster> clusters_of(const ClusterSet& set, const ClusterRun& run) {
  return std::span<const PackedCluster>(set.clusters).subspan(run.first_cluster, run.cluster_count);
}

/// `what`, `number`: owner of the bounds, for the message.
Result<void> check_bounds(const ClusterBounds& bounds, const char* what, uint64_t number) {
  if (bounds.shift <= kMaxBoundsShift) return {};
  const std::string place = what + (" " + std::to_string(number));
  if (bounds.shift > 31) return Error{kReserved, place + ": reserved bits of its bounds are set"};
  return Error{kRange, place + ": bounds of shift " + std::to_string(bounds.shift) + ", expected at most 16"};
}

/// Returns whether the bits of a word section after its first `bits` are zero. Sections end within the stream.
bool ends_clean(const std::byte* data, uint32_t first_word, uint32_t bits) {
  if (bits % 32 == 0) return true;
  return load<uint32_t>(data + 4 * (uint64_t{first_word} + bits / 32)) >> (bits % 32) == 0;
}

/// The codes of a cluster's vertices: stored codes with the predicted part added.
struct CodeRange {
  uint32_t smallest[3];
  uint32_t largest[3];
};

/// Decodes and checks the clusters one by one.
class Decoder {
 public:
  Decoder(const ClusterStreams& streams, const ClusterOutput& out)
      : s_(streams),
        out_(out),
        scans_(isa_avx2::kScansClusters && has_avx2() && out.indices.empty() && out.offsets.empty() &&
               out.positions.empty()) {}

  Result<void> run() {
    // Refuses exponents outside the range of exp2i().
    SCREE_TRY(check_offsets(s_.lattice, s_.range, {}));
    step_ = exp2i(s_.lattice.exponent);
    SCREE_TRY(sizes());
    for (cluster_ = 0; cluster_ < s_.cluster_count; ++cluster_) {
      if (cluster_ % kGroupClusters == 0) {
        group_ = load<ClusterBounds>(s_.group_bounds.data() + cluster_ / kGroupClusters * sizeof(ClusterBounds));
        SCREE_TRY(check_bounds(group_, "cluster group", cluster_ / kGroupClusters));
      }
      SCREE_TRY(cluster());
    }
    if (triangles_ != s_.triangle_count || vertices_ != s_.vertex_count) {
      return Error{kRange, "clusters of " + std::to_string(triangles_) + " triangles and " + std::to_string(vertices_) +
                               " vertices, but the chunk has " + std::to_string(s_.triangle_count) + " and " +
                               std::to_string(s_.vertex_count)};
    }
    if (words_ != s_.cluster_words) {
      return Error{kTrailing,
                   "clusters end at word " + std::to_string(words_) + " of " + std::to_string(s_.cluster_words)};
    }
    for (size_t axis = 0; axis < 3; ++axis) {
      if (largest_[axis] > low_mask(s_.range.bits[axis])) {
        return Error{kRange, "a cluster's vertex at " + std::to_string(largest_[axis]) + ", but the chunk's box has " +
                                 std::to_string(s_.range.bits[axis]) + " bits"};
      }
    }
    return check_offsets(s_.lattice, s_.range, largest_);
  }

 private:
  Result<void> sizes() const {
    if (s_.cluster_words > kMaxClusterWords) {
      return Error{kRange, "clusters: " + std::to_string(s_.cluster_words) + " words, expected at most 2^29"};
    }
    const uint64_t clusters = s_.cluster_count;
    struct Part {
      const char* name;
      uint64_t data_bits;
      uint64_t bytes;
      std::span<const std::byte> stream;
    };
    const uint64_t group_bytes = group_count(clusters) * sizeof(ClusterBounds);
    const uint64_t bounds_bytes = clusters * sizeof(ClusterBounds);
    const uint64_t record_bytes = clusters * sizeof(ClusterRecord);
    const Part parts[] = {
        {"cluster group bounds", 8 * group_bytes, group_bytes, s_.group_bounds},
        {"cluster bounds", 8 * bounds_bytes, bounds_bytes, s_.cluster_bounds},
        {"cluster records", 8 * record_bytes, record_bytes, s_.clusters},
        {"cluster data", uint64_t{32} * s_.cluster_words, packed_bytes(s_.cluster_words, 32), s_.data},
    };
    for (const Part& part : parts) SCREE_TRY(check_stream(part.name, part.data_bits, part.bytes, part.stream));
    return {};
  }

  Error error(ErrorCode code, const std::string& what) const {
    return Error{code, "cluster " + std::to_string(cluster_) + ": " + what};
  }

  Result<void> cluster() {
    const auto record = load<ClusterRecord>(s_.clusters.data() + cluster_ * sizeof(ClusterRecord));
    const auto bounds = load<ClusterBounds>(s_.cluster_bounds.data() + cluster_ * sizeof(ClusterBounds));
    if (record.first_triangle != triangles_ || record.first_vertex != vertices_) {
      return error(kRange, "first triangle " + std::to_string(record.first_triangle) + " and vertex " +
                               std::to_string(record.first_vertex) + ", but the clusters before have " +
                               std::to_string(triangles_) + " and " + std::to_string(vertices_));
    }
    const ClusterLayout layout = cluster_layout(record);
    if (layout.prediction != words_) {
      return error(kRange,
                   "data at word " + std::to_string(layout.prediction) + ", expected " + std::to_string(words_));
    }
    SCREE_TRY(widths(layout));
    if (layout.end > s_.cluster_words) {  // below 2^29 + 1200, so it cannot wrap
      return error(kRange,
                   "data end at word " + std::to_string(layout.end) + " of " + std::to_string(s_.cluster_words));
    }
    if (triangles_ + uint64_t{layout.triangle_count} > s_.triangle_count ||
        vertices_ + uint64_t{layout.vertex_count} > s_.vertex_count) {
      return error(kRange, std::to_string(layout.triangle_count) + " triangles and " +
                               std::to_string(layout.vertex_count) + " vertices, more than the chunk has left");
    }
    SCREE_TRY(check_bounds(bounds, "cluster", cluster_));
    const ClusterReader reader = make_cluster_reader(record, bounds, s_.data.data());
    if (!ends_clean(s_.data.data(), layout.steps, layout.triangle_count) ||
        (layout.wide_steps &&
         !ends_clean(s_.data.data(), layout.steps + (layout.triangle_count + 31) / 32, layout.triangle_count)) ||
        !ends_clean(s_.data.data(), layout.distances, layout.triangle_count * 2 * layout.distance_bits)) {
      return error(kTrailing, "a bit is set after its triangles");
    }
    // Codes are at least 0, so the smallest codes need no check if the cluster's bounds begin within the group's
    // bounds.
    ClusterScan scan;
    const bool scanned = scans_ && begins_in_group(reader) && isa_avx2::scan_cluster(reader, s_.data.size(), scan);
    CodeRange codes{};
    if (scanned) std::copy_n(scan.largest, 3, codes.largest);
    if (!scanned || !scan.triangles_are_good) SCREE_TRY(triangles(reader));
    if (!ends_clean(s_.data.data(), layout.positions, layout.vertex_count * reader.stride())) {
      return error(kTrailing, "a bit is set after its positions");
    }
    if (!scanned) vertices(reader, codes);
    SCREE_TRY(boxes(reader, bounds, codes));
    triangles_ += layout.triangle_count;
    vertices_ += layout.vertex_count;
    words_ = layout.end;
    return {};
  }

  Result<void> widths(const ClusterLayout& layout) const {
    for (uint32_t axis = 0; axis < 3; ++axis) {
      if (layout.position_bits[axis] > kMaxPositionBits) {
        return error(kRange, std::to_string(layout.position_bits[axis]) + " position bits, expected at most 24");
      }
      if (layout.predicted_axis != kNotPredicted && axis != layout.predicted_axis &&
          layout.position_bits[axis] > kMaxPredictorBits) {
        return error(kRange, std::to_string(layout.position_bits[axis]) +
                                 " bits of an axis from which another one is predicted, expected at most 15");
      }
    }
    return {};
  }

  Result<void> triangles(const ClusterReader& reader) {
    const ClusterLayout& layout = reader.layout;
    const std::byte* data = s_.data.data();
    const uint32_t count = layout.triangle_count;
    const uint32_t step_words = (count + 31) / 32;
    uint32_t* out = out_.indices.empty() ? nullptr : out_.indices.data() + uint64_t{3} * triangles_;
    // As reader.triangle(), without its look-ups per triangle.
    const uint32_t bits = layout.distance_bits;
    const uint32_t mask = (1u << bits) - 1;
    uint64_t bit = uint64_t{layout.distances} * 32;
    uint32_t low = 0;
    uint32_t high = 0;
    uint32_t largest = 2;
    for (uint32_t i = 0; i < count; ++i) {
      if (i % 32 == 0) {
        low = reader.word(layout.steps + i / 32);
        high = layout.wide_steps ? reader.word(layout.steps + step_words + i / 32) : 0;
      }
      largest += (low & 1) + 2 * (high & 1);
      low >>= 1;
      high >>= 1;
      const uint32_t both = unpack(data, bit, 2 * bits);
      bit += 2 * bits;
      const uint32_t back[2] = {both & mask, both >> bits};
      if (std::max(back[0], back[1]) > largest) {
        return error(kRange, "triangle " + std::to_string(i) + " goes back " +
                                 std::to_string(std::max(back[0], back[1])) + " vertices from " +
                                 std::to_string(largest));
      }
      if (out != nullptr) {
        const uint32_t vertex = vertices_ + largest;
        out[3 * i] = vertex;
        out[3 * i + 1] = vertex - back[0];
        out[3 * i + 2] = vertex - back[1];
      }
    }
    if (largest >= layout.vertex_count) {  // steps are never negative, so that the last is the largest
      return error(kRange, "vertex " + std::to_string(largest) + ", but it has " + std::to_string(layout.vertex_count) +
                               " vertices");
    }
    return {};
  }

  bool begins_in_group(const ClusterReader& reader) const {
    return reader.min[0] >= bounds_min(group_, 0) && reader.min[1] >= bounds_min(group_, 1) &&
           reader.min[2] >= bounds_min(group_, 2);
  }

  void vertices(const ClusterReader& reader, CodeRange& codes) {
    const ClusterLayout& layout = reader.layout;
    uint32_t* offsets = out_.offsets.empty() ? nullptr : out_.offsets.data() + uint64_t{3} * vertices_;
    float* positions = out_.positions.empty() ? nullptr : out_.positions.data() + uint64_t{3} * vertices_;
    // If this wraps, boxes() refuses the cluster.
    uint32_t base[3];
    for (size_t axis = 0; axis < 3; ++axis) base[axis] = s_.range.min[axis] + reader.min[axis];
    const uint32_t stride = reader.stride();
    const uint64_t first_bit = uint64_t{layout.positions} * 32;
    uint64_t masks[3];
    for (size_t axis = 0; axis < 3; ++axis) masks[axis] = low_mask(layout.position_bits[axis]);
    for (size_t axis = 0; axis < 3; ++axis) {
      codes.smallest[axis] = ~0u;
      codes.largest[axis] = 0;
    }
    for (uint32_t v = 0; v < layout.vertex_count; ++v) {
      uint32_t code[3];
      if (stride <= 57) {  // 64 bits hold a vertex that starts at any bit of a byte
        const uint64_t bit = first_bit + uint64_t{v} * stride;
        const uint64_t window = stride == 0 ? 0 : load<uint64_t>(s_.data.data() + bit / 8) >> (bit % 8);
        code[0] = static_cast<uint32_t>(window & masks[0]);
        code[1] = static_cast<uint32_t>(window >> layout.position_bits[0] & masks[1]);
        code[2] = static_cast<uint32_t>(window >> (layout.position_bits[0] + layout.position_bits[1]) & masks[2]);
      } else {
        reader.stored(v, code);
      }
      reader.predictor.apply(code);
      for (size_t axis = 0; axis < 3; ++axis) {
        codes.smallest[axis] = std::min(codes.smallest[axis], code[axis]);
        codes.largest[axis] = std::max(codes.largest[axis], code[axis]);
        code[axis] += base[axis];
        if (offsets != nullptr) offsets[3 * v + axis] = code[axis];
        if (positions != nullptr) {
          positions[3 * v + axis] =
              static_cast<float>(static_cast<double>(s_.lattice.min[axis] + int64_t{code[axis]}) * step_);
        }
      }
    }
  }

  /// Checks that a cluster's codes lie in its bounds and its group's.
  Result<void> boxes(const ClusterReader& reader, const ClusterBounds& bounds, const CodeRange& codes) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<size_t>(axis);
      if (codes.largest[i] > bounds_extent(bounds, axis)) {
        return error(kRange, "a position's code " + std::to_string(codes.largest[i]) + ", but its bounds end at " +
                                 std::to_string(bounds_extent(bounds, axis)));
      }
      // Both are below 2^24 here.
      const uint32_t first = reader.min[i] + codes.smallest[i];
      const uint32_t last = reader.min[i] + codes.largest[i];
      if (first < bounds_min(group_, axis) || last - bounds_min(group_, axis) > bounds_extent(group_, axis)) {
        return error(kRange, "positions from " + std::to_string(first) + " to " + std::to_string(last) +
                                 ", outside the bounds of its group");
      }
      largest_[i] = std::max(largest_[i], last);
    }
    return {};
  }

  const ClusterStreams& s_;
  const ClusterOutput& out_;
  bool scans_;       // only the checks are needed, no output
  double step_ = 0;  // step of the lattice
  uint64_t cluster_ = 0;
  ClusterBounds group_{};
  uint32_t triangles_ = 0;  // of the clusters before this one
  uint32_t vertices_ = 0;
  uint32_t words_ = 0;
  std::array<uint32_t, 3> largest_{};  // offsets from the chunk's position_min
};

}  // namespace

ClusterStreams cluster_streams_of(const MeshRecord& mesh, const ChunkRecord& chunk,
                                  std::span<const std::byte> payload) {
  const ChunkStreams streams = chunk_streams(mesh, chunk);
  const auto bytes_of = [&](const ChunkStream& stream) { return payload.subspan(stream.offset, stream.bytes); };
  return {chunk.triangle_count,
          chunk.vertex_count,
          chunk.cluster_count,
          chunk.cluster_words,
          lattice_of(mesh),
          position_range_of(chunk),
          bytes_of(streams.group_bounds),
          bytes_of(streams.cluster_bounds),
          bytes_of(streams.clusters),
          bytes_of(streams.cluster_data)};
}

Result<void> decode_clusters(const ClusterStreams& streams, const ClusterOutput& out) {
  assert(out.indices.empty() || out.indices.size() == uint64_t{3} * streams.triangle_count);
  assert(out.offsets.empty() || out.offsets.size() == uint64_t{3} * streams.vertex_count);
  assert(out.positions.empty() || out.positions.size() == uint64_t{3} * streams.vertex_count);
  return Decoder(streams, out).run();
}

Result<void> check_clusters(const ClusterStreams& streams) {
  return decode_clusters(streams, {});
}

void ClusterSet::clear() {
  clusters.clear();
  words.clear();
  triangles.clear();
  vertices.clear();
}

void describe_clusters(const ClusterSet& set, const ClusterRun& run, ChunkRecord& record) {
  uint32_t triangles = 0;
  uint32_t vertices = 0;
  uint32_t words = 0;
  for (const PackedCluster& cluster : clusters_of(set, run)) {
    triangles += cluster.triangle_count();
    vertices += cluster.vertex_count();
    words += cluster.words;
  }
  const OffsetBox box = box_of(clusters_of(set, run));
  record.encoding = ChunkEncoding::kClustered;
  record.triangle_count = triangles;
  record.vertex_count = vertices;
  record.cluster_count = static_cast<uint32_t>(run.cluster_count);
  record.cluster_words = words;
  record.index_min = 0;
  record.index_bits = 0;
  for (int i = 0; i < 3; ++i) {
    record.position_min[i] = box.min[i];
    record.position_bits[i] = static_cast<uint8_t>(std::bit_width(box.max[i] - box.min[i]));
  }
}

uint64_t cluster_stream_bytes(uint64_t clusters, uint64_t words) {
  return (group_count(clusters) + clusters) * sizeof(ClusterBounds) + clusters * sizeof(ClusterRecord) +
         packed_bytes(words, 32);
}

void write_clusters(std::span<std::byte> out, const ClusterSet& set, const ClusterRun& run, const ChunkRecord& record) {
  assert(out.size() == cluster_stream_bytes(record.cluster_count, record.cluster_words));
  const std::span<const PackedCluster> clusters = clusters_of(set, run);
  std::byte* at = out.data();
  const auto put = [&at](const auto& value) {
    store(at, value);
    at += sizeof value;
  };
  for (size_t first = 0; first < clusters.size(); first += kGroupClusters) {
    const size_t count = std::min<size_t>(kGroupClusters, clusters.size() - first);
    put(bounds_of(box_of(clusters.subspan(first, count)), record.position_min));
  }
  for (const PackedCluster& cluster : clusters) put(bounds_of(box_of({&cluster, 1}), record.position_min));
  ClusterRecord next{};
  for (const PackedCluster& cluster : clusters) {
    ClusterRecord placed = cluster.record;
    placed.place |= next.place;
    placed.first_triangle = next.first_triangle;
    placed.first_vertex = next.first_vertex;
    put(placed);
    next.place += cluster.words;
    next.first_triangle += cluster.triangle_count();
    next.first_vertex += cluster.vertex_count();
  }
  assert(next.place == record.cluster_words && next.place < kMaxClusterWords);
  std::memcpy(at, set.words.data() + run.first_word, 4 * uint64_t{record.cluster_words});
  zero_slack({at, packed_bytes(record.cluster_words, 32)}, uint64_t{32} * record.cluster_words);
}

}  // namespace scree::format
