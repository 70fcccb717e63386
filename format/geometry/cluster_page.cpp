// Splits pages; cluster_join.cpp joins them.
#include "format/geometry/cluster_page.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstring>
#include <memory>
#include <new>

#include "format/bitpack.h"
#include "format/bytes.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_read.h"
#include "format/geometry/recent_vertices.h"
#include "format/geometry/split_streams.h"
#include "format/geometry/split_triangles.h"

namespace scree::format {
namespace {

using namespace split_streams;

uint32_t zigzag(uint32_t value) {
  return value << 1 ^ static_cast<uint32_t>(static_cast<int32_t>(value) >> 31);
}

/// Splits clusters. Each step handles a whole cluster, mostly without branches, as in cluster_join.cpp.
class Splitter {
 public:
  Splitter() { latest_.fill(kNone); }

  void part(const std::byte* payload, uint32_t clusters) {
    start_ += memory_.recent.count();
    memory_.recent.clear();
    named_ = 0;
    first_ = Offsets{};
    const std::byte* const bounds = payload + group_count(clusters) * sizeof(ClusterBounds);
    const std::byte* const records = bounds + clusters * sizeof(ClusterBounds);
    const std::byte* const data = records + clusters * sizeof(ClusterRecord);
    for (uint64_t i = 0; i < clusters; ++i) {
      cluster(make_cluster_reader(load<ClusterRecord>(records + i * sizeof(ClusterRecord)),
                                  load<ClusterBounds>(bounds + i * sizeof(ClusterBounds)), data));
    }
  }

  void put_part(uint32_t clusters, std::span<const std::byte> plain) {
    put(kParts, clusters);
    put(kParts, static_cast<uint32_t>(plain.size()));
    out_[kPlain].insert(out_[kPlain].end(), plain.begin(), plain.end());
  }

  SplitPage finish() {
    put_planes(kFar, far_, 2);
    const uint32_t tall_bytes = put_residuals();
    SplitPage page;
    uint64_t bytes = kHeaderBytes;
    for (const auto& stream : out_) bytes += stream.size();
    page.bytes.resize(kHeaderBytes);
    page.bytes.reserve(bytes);
    store(page.bytes.data(), tall_bytes);
    for (uint32_t i = 0; i < kStreams; ++i) {
      store(page.bytes.data() + 4 * (1 + uint64_t{i}), static_cast<uint32_t>(out_[i].size()));
      const uint64_t ends = i == kLow ? 3 : i == kTall ? tall_bytes : i == kFar ? 2 : 1;
      for (uint64_t k = 1; k <= ends; ++k) page.stream_ends.push_back(page.bytes.size() + out_[i].size() * k / ends);
      page.bytes.insert(page.bytes.end(), out_[i].begin(), out_[i].end());
    }
    return page;
  }

 private:
  static constexpr uint32_t kSlotBits = 17;

  /// Room for more bytes of a stream, until the stream grows again.
  std::byte* grow(Stream stream, size_t bytes) {
    std::vector<std::byte>& out = out_[stream];
    out.resize(out.size() + bytes);
    return out.data() + out.size() - bytes;
  }
  template <class T>
  void put(Stream stream, T value) {
    store(grow(stream, sizeof value), value);
  }

  void cluster(const ClusterReader& reader) {
    const ClusterLayout& layout = reader.layout;
    put(kTriangles, static_cast<uint8_t>(layout.triangle_count - 1));
    put(kVertices, static_cast<uint8_t>(layout.vertex_count - 1));
    put(kForms, static_cast<uint8_t>(layout.distance_bits | (layout.wide_steps ? 8 : 0) | layout.predicted_axis << 4));
    if (layout.predicted_axis != kNotPredicted) put(kSlopes, reader.word(layout.prediction));
    put_triangles(reader);
    memory_.predictor.begin(triangles_, layout.vertex_count);
    put_vertices(read_vertices(reader), layout.vertex_count);
  }

  /// Writes the gates and distances, and keeps the triangles.
  void put_triangles(const ClusterReader& reader) {
    const uint32_t count = reader.layout.triangle_count;
    std::byte* const gates = grow(kGates, count);
    std::byte distances[2 * kMaxClusterTriangles + 2];
    uint32_t distance_count = 0;
    OpenEdges edges;
    uint32_t largest = 2;
    uint32_t last = 0;
    for (uint32_t i = 0; i < count; ++i) {
      uint32_t back[2];
      reader.distances(i, back);
      const uint32_t step = reader.step(i);
      largest += step;
      const uint32_t a = largest - back[0];
      const uint32_t b = largest - back[1];
      uint32_t gate = kExplicitGate + step;
      if (edges.next(a) == b && step == 0 && a == last) gate = 0;
      if (edges.next(a) == b && step == 1 && a != largest) gate = back[0];
      const bool is_explicit = gate >= kExplicitGate;
      distances[distance_count] = static_cast<std::byte>(back[0]);
      distances[distance_count + 1] = static_cast<std::byte>(back[1]);
      distance_count += is_explicit ? 2 : 0;
      gates[i] = static_cast<std::byte>(gate);
      triangles_.corners[i] = corner_of(a, b, is_explicit ? ClusterTriangles::kNoVertex : edges.across(a));
      edges.add(largest, a, b);
      last = b;
      triangles_.largest[i] = static_cast<uint8_t>(largest);
      triangles_.back[i] = static_cast<uint16_t>(back[0] | back[1] << 8);
    }
    triangles_.count = count;
    triangles_.largest[count] = ClusterTriangles::kNoVertex;
    if (distance_count != 0) std::memcpy(grow(kDistances, distance_count), distances, distance_count);
  }

  /// Writes the residuals of all vertices. Returns the bytes of a tall code.
  uint32_t put_residuals() {
    const size_t count = residuals_[0].size();
    std::vector<uint16_t> tall;
    std::vector<std::byte> high(count);
    uint32_t all = 0;
    for (size_t i = 0; i < count; ++i) {
      for (size_t axis = 0; axis < 3; ++axis) {
        const uint32_t rest = residuals_[axis][i] >> 8;
        all |= rest;
        high[i] |= static_cast<std::byte>(std::min(rest, kTallCode) << 2 * axis);
        if (rest >= kTallCode) tall.push_back(static_cast<uint16_t>(rest));
      }
    }
    for (const auto& codes : residuals_) {
      std::byte* const low = grow(kLow, count);
      for (size_t i = 0; i < count; ++i) low[i] = static_cast<std::byte>(codes[i]);
    }
    if (all != 0) out_[kHigh] = std::move(high);
    const uint32_t tall_bytes = all >> 8 != 0 ? 2 : 1;
    put_planes(kTall, tall, tall_bytes);
    return tall_bytes;
  }

  /// Writes the low bytes of all values, then the high bytes if values have two.
  void put_planes(Stream stream, std::span<const uint16_t> values, uint32_t bytes) {
    for (uint32_t byte = 0; byte < bytes; ++byte) {
      std::byte* const to = grow(stream, values.size());
      for (size_t i = 0; i < values.size(); ++i) to[i] = static_cast<std::byte>(values[i] >> 8 * byte);
    }
  }

  /// Reads a cluster's vertices behind the recent ones, and their slots. Returns the vertices.
  const Offsets* read_vertices(const ClusterReader& reader) {
    const uint32_t count = reader.layout.vertex_count;
    const uint32_t* const bits = reader.layout.position_bits;
    const ClusterPredictor& predictor = reader.predictor;
    int32_t codes[3][kMaxClusterVertices];
    uint64_t bit = uint64_t{reader.layout.positions} * 32;
    for (uint32_t v = 0; v < count; ++v)
      for (size_t axis = 0; axis < 3; bit += bits[axis++])
        codes[axis][v] = static_cast<int32_t>(unpack(reader.data, bit, bits[axis]));
    if (predictor.axis != kNotPredicted) {
      int32_t* const sums = codes[predictor.axis];
      const int32_t* const u = codes[(predictor.axis + 1) % 3];
      const int32_t* const w = codes[(predictor.axis + 2) % 3];
      for (uint32_t v = 0; v < count; ++v) {
        const int32_t predicted = (predictor.slope_u * u[v] + predictor.slope_v * w[v]) >> kPredictorShift;
        sums[v] =
            static_cast<int32_t>(static_cast<uint32_t>(sums[v]) + static_cast<uint32_t>(predicted) + predictor.bias);
      }
    }
    const Offsets min{static_cast<int32_t>(reader.min[0]), static_cast<int32_t>(reader.min[1]),
                      static_cast<int32_t>(reader.min[2]), 0};
    Offsets* const at = memory_.recent.make_room();
    for (uint32_t v = 0; v < count; ++v) at[v] = Offsets{codes[0][v], codes[1][v], codes[2][v], 0} + min;
    for (uint32_t v = 0; v < count; ++v) {  // most of the table is not in the fastest cache
      slots_[v] = slot(at[v]);
      __builtin_prefetch(&latest_[slots_[v]]);
    }
    return at;
  }

  /// Writes the references of the vertices at `at`, and keeps the residuals.
  void put_vertices(const Offsets* at, uint32_t count) {
    RecentVertices& recent = memory_.recent;
    const Offsets* const values = recent.values();
    const uint32_t first_index = recent.first_index();
    const uint32_t first_number = recent.count();
    uint8_t fresh[kMaxClusterVertices / 8] = {};
    uint8_t references[kMaxClusterVertices];
    uint16_t far[kMaxClusterVertices];
    uint32_t codes[3][kMaxClusterVertices];
    uint32_t far_count = 0;
    uint32_t new_count = 0;
    uint32_t named = named_;
    for (uint32_t v = 0; v < count; ++v) {
      const uint32_t number = first_number + v;
      const Offsets offsets = at[v];
      uint32_t& latest = latest_[slots_[v]];
      const uint32_t back = start_ + number - latest;  // an earlier part's vertex lies before the part's first
      latest = start_ + number;
      // Garbage if the vertex lies too far back.
      const Offsets& earlier = values[(first_index + number - back) % kMostValues];
      const bool is_known = back <= std::min(number, kMostBack) && std::memcmp(&earlier, &offsets, sizeof offsets) == 0;
      const uint32_t reference = std::min(zigzag(number - back - named), kFarReference);
      fresh[v / 8] = static_cast<uint8_t>(fresh[v / 8] | (is_known ? 0u : 1u) << v % 8);
      references[v - new_count] = static_cast<uint8_t>(reference);
      far[far_count] = static_cast<uint16_t>(back);
      far_count += is_known && reference == kFarReference;
      named = is_known ? number - back : named;
      const Offsets expected = v == 0 ? first_ : memory_.predictor.expected(v, at);
      const Offsets left = (offsets - expected) << 8 >> 8;  // modulo 2^24, the representative nearest to 0
      for (int axis = 0; axis < 3; ++axis) codes[axis][new_count] = zigzag(static_cast<uint32_t>(left[axis]));
      new_count += !is_known;
    }
    named_ = named;
    first_ = at[0];
    recent.add(count);
    const uint32_t fresh_bytes = bytes_of_bits(count);
    std::memcpy(grow(kFresh, fresh_bytes), fresh, fresh_bytes);
    if (new_count != count) std::memcpy(grow(kReferences, count - new_count), references, count - new_count);
    far_.insert(far_.end(), far, far + far_count);
    for (size_t axis = 0; axis < 3; ++axis)
      residuals_[axis].insert(residuals_[axis].end(), codes[axis], codes[axis] + new_count);
  }

  static uint32_t slot(const Offsets& offsets) {
    uint64_t hash = 0;
    for (int axis = 0; axis < 3; ++axis) hash = (hash + static_cast<uint64_t>(offsets[axis])) * 0x9e3779b97f4a7c15u;
    return static_cast<uint32_t>(hash >> (64 - kSlotBits));
  }

  SplitMemory memory_;
  ClusterTriangles triangles_;
  // The latest vertex with each hash. Vertices count over all parts.
  std::array<uint32_t, 1u << kSlotBits> latest_;
  std::array<uint32_t, kMaxClusterVertices> slots_;  // of the cluster's vertices
  uint32_t start_ = 0;                               // the part's first vertex
  uint32_t named_ = 0;
  Offsets first_{};
  std::array<std::vector<std::byte>, kStreams> out_;
  std::array<std::vector<uint32_t>, 3> residuals_;  // codes per axis
  std::vector<uint16_t> far_;
};

/// Bytes of the streams of a chunk's clusters.
uint64_t cluster_bytes(const std::byte* payload, uint32_t clusters) {
  const uint64_t head = (group_count(clusters) + clusters) * sizeof(ClusterBounds);
  const auto last = load<ClusterRecord>(payload + head + (clusters - uint64_t{1}) * sizeof(ClusterRecord));
  return cluster_stream_bytes(clusters, cluster_layout(last).end);
}

}  // namespace

SplitPage split_page(std::span<const std::byte> page, std::span<const PageClusters> clusters) try {
  if (page.size() > UINT32_MAX / kMaxSplitRatio) return {};
  const auto splitter = std::make_unique<Splitter>();
  uint64_t done = 0;
  uint32_t before = 0;  // clusters of the part whose plain bytes come next
  for (const PageClusters& part : clusters) {
    assert(part.cluster_count != 0 && part.offset >= done);
    if (part.offset != done || before != 0) splitter->put_part(before, page.subspan(done, part.offset - done));
    splitter->part(page.data() + part.offset, part.cluster_count);
    before = part.cluster_count;
    done = part.offset + cluster_bytes(page.data() + part.offset, part.cluster_count);
  }
  splitter->put_part(before, page.subspan(done));
  SplitPage split = splitter->finish();
  if (split.bytes.size() > kMaxSplitRatio * page.size()) return {};
  std::vector<std::byte> joined(page.size());
  if (!join_page(split.bytes, joined) || std::memcmp(joined.data(), page.data(), page.size()) != 0) return {};
  return split;
} catch (const std::bad_alloc&) {
  return {};
}

}  // namespace scree::format
