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

namespace scree::format {
namespace {

using namespace split_streams;

uint32_t zigzag(uint32_t value) {
  return value << 1 ^ static_cast<uint32_t>(static_cast<int32_t>(value) >> 31);
}

/// Splits clusters.
class Splitter {
 public:
  void part(const std::byte* payload, uint32_t clusters) {
    memory_.recent.clear();
    std::fill(latest_.begin(), latest_.end(), kNone);
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
    uint32_t all = 0;
    for (const auto& residual : residuals_)
      for (const uint32_t code : residual) all |= code;
    const uint32_t planes = (static_cast<uint32_t>(std::bit_width(all | 1)) + 7) / 8;
    for (uint32_t plane = 0; plane < planes; ++plane)
      for (size_t axis = 0; axis < 3; ++axis)
        for (const auto& residual : residuals_) put(kResiduals, static_cast<uint8_t>(residual[axis] >> 8 * plane));
    SplitPage page;
    uint64_t bytes = kHeaderBytes;
    for (const auto& stream : out_) bytes += stream.size();
    page.bytes.resize(kHeaderBytes);
    page.bytes.reserve(bytes);
    store(page.bytes.data(), planes);
    for (uint32_t i = 0; i < kStreams; ++i) {
      store(page.bytes.data() + 4 * (1 + uint64_t{i}), static_cast<uint32_t>(out_[i].size()));
      const uint64_t ends = i == kResiduals ? 3 * planes : 1;
      for (uint64_t k = 1; k <= ends; ++k) page.stream_ends.push_back(page.bytes.size() + out_[i].size() * k / ends);
      page.bytes.insert(page.bytes.end(), out_[i].begin(), out_[i].end());
    }
    return page;
  }

 private:
  static constexpr uint32_t kSlotBits = 17;

  void put(Stream stream, uint8_t value) { out_[stream].push_back(std::byte{value}); }
  template <class T>
  void put(Stream stream, T value) {
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    out_[stream].insert(out_[stream].end(), bytes, bytes + sizeof value);
  }

  void cluster(const ClusterReader& reader) {
    const ClusterLayout& layout = reader.layout;
    put(kTriangles, static_cast<uint8_t>(layout.triangle_count - 1));
    put(kVertices, static_cast<uint8_t>(layout.vertex_count - 1));
    put(kForms, static_cast<uint8_t>(layout.distance_bits | (layout.wide_steps ? 8 : 0) | layout.predicted_axis << 4));
    if (layout.predicted_axis != kNotPredicted) put(kSlopes, reader.word(layout.prediction));
    const uint32_t step_bytes = (layout.triangle_count + 7) / 8;
    const uint32_t step_words = (layout.triangle_count + 31) / 32;
    for (uint32_t half = 0; half < (layout.wide_steps ? 2u : 1u); ++half) {
      const std::byte* steps = reader.data + 4 * uint64_t{layout.steps + half * step_words};
      out_[kSteps].insert(out_[kSteps].end(), steps, steps + step_bytes);
    }
    ClusterTriangles triangles;
    triangles.count = layout.triangle_count;
    triangles.distance_bits = layout.distance_bits;
    for (uint32_t i = 0; i < layout.triangle_count; ++i) {
      uint32_t back[2];
      reader.distances(i, back);
      if (layout.distance_bits <= kShortDistance) {
        put(kDistances, static_cast<uint8_t>(back[0] | back[1] << 4));
      } else {
        put(kDistances, static_cast<uint8_t>(back[0]));
        put(kDistances, static_cast<uint8_t>(back[1]));
      }
      triangles.largest[i] = static_cast<uint8_t>(reader.largest(i));
      for (size_t k = 0; k < 2; ++k) triangles.back[k][i] = static_cast<uint8_t>(back[k]);
    }
    memory_.predictor.begin(triangles, layout.vertex_count);
    Offsets* const at = memory_.recent.make_room();
    for (uint32_t v = 0; v < layout.vertex_count; ++v) {
      uint32_t offset[3];
      reader.offset(v, offset);
      at[v] =
          Offsets{static_cast<int32_t>(offset[0]), static_cast<int32_t>(offset[1]), static_cast<int32_t>(offset[2]), 0};
      place_vertex(memory_.recent.count() + v, at[v], v == 0 ? first_ : memory_.predictor.expected(v, at));
    }
    memory_.recent.add(layout.vertex_count);
    first_ = at[0];
  }

  void place_vertex(uint32_t number, const Offsets& offsets, const Offsets& expected) {
    RecentVertices& recent = memory_.recent;
    uint32_t& latest = latest_[slot(offsets)];
    if (latest != kNone && number - latest <= kMostBack && is_equal(recent.at(latest), offsets)) {
      const uint32_t place = zigzag(latest - named_) + 1;
      if (place < kFarPlace) {
        put(kPlaces, static_cast<uint8_t>(place));
      } else {
        put(kPlaces, static_cast<uint8_t>(kFarPlace));
        put(kFar, static_cast<uint16_t>(number - latest));
      }
      named_ = latest;
    } else {
      put(kPlaces, uint8_t{0});
      const Offsets left = (offsets - expected) << 8 >> 8;  // modulo 2^24, the representative nearest to 0
      std::array<uint32_t, 3> codes;
      for (int axis = 0; axis < 3; ++axis) codes[static_cast<size_t>(axis)] = zigzag(static_cast<uint32_t>(left[axis]));
      residuals_.push_back(codes);
    }
    latest = number;
  }

  static bool is_equal(const Offsets& a, const Offsets& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

  static uint32_t slot(const Offsets& offsets) {
    uint64_t hash = 0;
    for (int axis = 0; axis < 3; ++axis) hash = (hash + static_cast<uint64_t>(offsets[axis])) * 0x9e3779b97f4a7c15u;
    return static_cast<uint32_t>(hash >> (64 - kSlotBits));
  }

  SplitMemory memory_;
  std::array<uint32_t, 1u << kSlotBits> latest_;  // latest vertex of the part with that hash
  uint32_t named_ = 0;
  Offsets first_{};
  std::array<std::vector<std::byte>, kStreams> out_;
  std::vector<std::array<uint32_t, 3>> residuals_;
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
  const auto splitter = std::make_unique_for_overwrite<Splitter>();
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
