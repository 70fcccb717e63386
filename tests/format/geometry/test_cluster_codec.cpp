#include "format/geometry/cluster_codec.h"

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_pack.h"
#include "format/geometry/cluster_read.h"
#include "tests/format/geometry/cluster_lists.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/results.h"
#include "tools/clusters/cluster_builder.h"

using namespace scree::format;
using scree::tools::ClusterEffort;
using namespace scree::tests;

namespace {

/// Compares the decoder with the kernels' reader, one triangle and one vertex at a time.
void check_reader(const ClusteredChunk& chunk, const std::vector<uint32_t>& indices,
                  const std::vector<uint32_t>& offsets) {
  const ClusterStreams streams = chunk.streams(chunk.payload);
  for (uint32_t c = 0; c < streams.cluster_count; ++c) {
    const auto record = load<ClusterRecord>(streams.clusters.data() + c * sizeof(ClusterRecord));
    const auto bounds = load<ClusterBounds>(streams.cluster_bounds.data() + c * sizeof(ClusterBounds));
    const ClusterReader reader = make_cluster_reader(record, bounds, streams.data.data());
    for (uint32_t t = 0; t < reader.layout.triangle_count; ++t) {
      uint32_t corner[3];
      reader.triangle(t, corner);
      for (size_t i = 0; i < 3; ++i) {
        const uint32_t expected = indices[3 * size_t{record.first_triangle + t} + i];
        if (record.first_vertex + corner[i] != expected) FAIL("cluster " << c << ", triangle " << t);
      }
    }
    for (uint32_t v = 0; v < reader.layout.vertex_count; ++v) {
      uint32_t offset[3];
      reader.offset(v, offset);
      for (size_t i = 0; i < 3; ++i) {
        const uint32_t expected = offsets[3 * size_t{record.first_vertex + v} + i] - chunk.record.position_min[i];
        if (offset[i] != expected) FAIL("cluster " << c << ", vertex " << v);
      }
    }
  }
}

/// Decodes the chunk and compares it with the list, triangle by triangle: vertices, orientation and offsets must be
/// equal.
void check_round_trip(const List& list, const ClusteredChunk& chunk) {
  std::vector<uint32_t> indices(3 * size_t{chunk.record.triangle_count});
  std::vector<uint32_t> offsets(3 * size_t{chunk.record.vertex_count});
  std::vector<float> positions(offsets.size());
  GuardedBytes guarded(chunk.payload);
  const ClusterStreams streams = chunk.streams(guarded.bytes());
  must(decode_clusters(streams, {indices, offsets, positions}));
  CHECK(outcome(check_clusters(streams)) == "ok");

  REQUIRE(chunk.record.triangle_count == list.indices.size() / 3);
  REQUIRE(chunk.set.triangles.size() == chunk.record.triangle_count);
  REQUIRE(chunk.set.vertices.size() == chunk.record.vertex_count);
  std::vector<uint32_t> seen(chunk.record.triangle_count);
  for (size_t t = 0; t < seen.size(); ++t) {
    const uint32_t source = chunk.set.triangles[t];
    REQUIRE(source < seen.size());
    ++seen[source];
    // Some rotation of the source's corners must be equal.
    std::array<uint32_t, 3> found{};
    for (size_t i = 0; i < 3; ++i) {
      REQUIRE(indices[3 * t + i] < chunk.record.vertex_count);
      found[i] = chunk.set.vertices[indices[3 * t + i]];
    }
    const uint32_t* corner = &list.indices[3 * size_t{source}];
    bool equal = false;
    for (size_t r = 0; r < 3; ++r)
      equal |= found[0] == corner[r] && found[1] == corner[(r + 1) % 3] && found[2] == corner[(r + 2) % 3];
    if (!equal) FAIL("triangle " << t << " is not triangle " << source << " of the list");
  }
  CHECK(std::count(seen.begin(), seen.end(), 1u) == static_cast<std::ptrdiff_t>(seen.size()));
  for (size_t v = 0; v < chunk.set.vertices.size(); ++v) {
    for (size_t i = 0; i < 3; ++i) {
      if (offsets[3 * v + i] != list.offsets[3 * size_t{chunk.set.vertices[v]} + i]) FAIL("vertex " << v << " moved");
      const float position = dequantize(chunk.mesh.lattice_min[i] + offsets[3 * v + i], chunk.mesh.lattice_exponent);
      if (positions[3 * v + i] != position) FAIL("vertex " << v << " at " << positions[3 * v + i]);
    }
  }
  check_reader(chunk, indices, offsets);
}

void check_round_trip(const List& list) {
  for (const ClusterEffort effort : {ClusterEffort::kFast, ClusterEffort::kBest})
    check_round_trip(list, encode(list, effort));
}

}  // namespace

TEST_CASE("cluster streams of the spec", "[cluster_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("clusters.txt")) {
    INFO(vector.text("name"));
    ClusteredChunk chunk;
    const auto lattice_bits = vector.integers<uint32_t>("lattice_bits");
    const auto position_min = vector.integers<uint32_t>("position_min");
    const auto position_bits = vector.integers<uint32_t>("position_bits");
    for (size_t i = 0; i < 3; ++i) {
      chunk.mesh.lattice_bits[i] = static_cast<uint8_t>(lattice_bits.at(i));
      chunk.record.position_min[i] = position_min.at(i);
      chunk.record.position_bits[i] = static_cast<uint8_t>(position_bits.at(i));
    }
    chunk.record.encoding = ChunkEncoding::kClustered;
    chunk.record.triangle_count = vector.integer<uint32_t>("triangle_count");
    chunk.record.vertex_count = vector.integer<uint32_t>("vertex_count");
    chunk.record.cluster_count = vector.integer<uint32_t>("cluster_count");
    chunk.record.cluster_words = vector.integer<uint32_t>("cluster_words");
    chunk.payload = vector.bytes("bytes");
    REQUIRE(chunk.payload.size() == chunk_streams(chunk.mesh, chunk.record).bytes);
    std::vector<uint32_t> indices(3 * size_t{chunk.record.triangle_count});
    std::vector<uint32_t> offsets(3 * size_t{chunk.record.vertex_count});
    std::vector<float> positions(offsets.size());
    const ClusterStreams streams = chunk.streams(chunk.payload);
    const std::string expected = vector.has("error") ? vector.text("error") : "ok";
    CHECK(outcome(decode_clusters(streams, {indices, offsets, positions})) == expected);
    CHECK(outcome(check_clusters(streams)) == expected);
    if (expected != "ok") continue;
    CHECK(indices == vector.integers<uint32_t>("indices"));
    CHECK(offsets == vector.integers<uint32_t>("offsets"));
    check_reader(chunk, indices, offsets);
    if (!vector.has("list")) continue;
    List list;
    list.indices = vector.integers<uint32_t>("list");
    list.offsets = vector.integers<uint32_t>("list_offsets");
    CHECK(encode(list).payload == chunk.payload);
  }
}

TEST_CASE("clusters keep triangles, sides and offsets", "[cluster_codec]") {
  List one;
  for (uint32_t i = 0; i < 3; ++i) one.add(5 * i, 7, i * i);
  one.triangle(2, 0, 1);
  check_round_trip(one);

  check_round_trip(grid_list(1, 1, 0));
  check_round_trip(grid_list(8, 100, 3));          // 128 triangles: one cluster
  check_round_trip(grid_list(40, 377, 50));        // 3200: several clusters
  check_round_trip(grid_list(200, 83800, 80000));  // more than 32 clusters, 24 bits
}

TEST_CASE("degenerate triangles keep their places and their vertices", "[cluster_codec]") {
  List point;
  point.add(9, 8, 7);
  point.triangle(0, 0, 0);
  check_round_trip(point);
  CHECK(encode(point).record.vertex_count == 3);  // two vertices are repeated

  List edge;
  edge.add(1, 2, 3);
  edge.add(4, 5, 6);
  for (int i = 0; i < 130; ++i) edge.triangle(0, i % 2, 1);
  check_round_trip(edge);

  List mixed;  // a point first, then triangles that use all other vertices
  for (uint32_t i = 0; i < 400; ++i) mixed.add(i, i * i % 97, 3 * i);
  for (uint32_t i = 0; i + 2 < 400; i += 3) {
    if (i % 5 == 0) mixed.triangle(i, i, i);
    mixed.triangle(i, i + 1, i + 2);
  }
  check_round_trip(mixed);
}

TEST_CASE("a cluster ends at its limit of vertices", "[cluster_codec]") {
  List apart;  // no vertex is shared, so 128 of them hold 42 triangles
  for (uint32_t t = 0; t < 128; ++t) {
    for (uint32_t i = 0; i < 3; ++i) apart.add(t * 50 + i, t * i, 4000 - t);
    apart.triangle(3 * t, 3 * t + 1, 3 * t + 2);
  }
  const ClusteredChunk chunk = encode(apart);
  CHECK(chunk.record.cluster_count == 4);
  CHECK(chunk.record.vertex_count == 3 * 128);
  check_round_trip(apart);

  List fans;  // 300 triangles around one vertex, two copies and one with the other orientation
  for (uint32_t v = 0; v <= 301; ++v) fans.add(v * 3, (v * v) % 1000, 500);
  for (uint32_t v = 1; v <= 300; ++v) fans.triangle(0, v, v + 1);
  for (uint32_t v = 1; v <= 300; ++v) fans.triangle(0, v, v + 1);
  for (uint32_t v = 1; v <= 300; ++v) fans.triangle(v + 1, v, 0);
  check_round_trip(fans);
}

TEST_CASE("clusters keep positions of every width", "[cluster_codec]") {
  std::mt19937 random(17);
  for (uint32_t bits = 0; bits <= 24; ++bits) {
    INFO(bits << " bits");
    check_round_trip(soup(random, 300, 200, bits));
    List flat = soup(random, 100, 60, bits);  // each axis has another width
    for (size_t i = 0; i < flat.offsets.size(); i += 3) {
      flat.offsets[i + 1] >>= bits / 2;
      flat.offsets[i + 2] = flat.offsets[i + 2] & 1u;
    }
    check_round_trip(flat);
  }
}

TEST_CASE("a predicted axis takes few bits", "[cluster_codec]") {
  for (uint32_t axis = 0; axis < 3; ++axis) {
    List slope = grid_list(8, 200, 0);
    for (size_t v = 0; v < slope.offsets.size(); v += 3) {
      const uint32_t x = slope.offsets[v], y = slope.offsets[v + 1];
      slope.offsets[v + axis] = 9000 - 2 * x + y + (x ^ y) % 3;
      slope.offsets[v + (axis + 1) % 3] = x;
      slope.offsets[v + (axis + 2) % 3] = y;
    }
    const ClusterLayout layout = cluster_layout(encode(slope).set.clusters[0].record);
    // Slopes of -2 are too steep to predict along this axis, so another axis is predicted.
    CHECK(layout.predicted_axis != kNotPredicted);
    CHECK(layout.position_bits[layout.predicted_axis] <= 3);
    check_round_trip(slope);
  }
}

TEST_CASE("damaged clusters are refused or decode within their limits", "[cluster_codec]") {
  std::mt19937 random(23);
  const List lists[] = {grid_list(20, 300, 200), soup(random, 200, 90, 20), soup(random, 60, 4, 3)};
  uint64_t accepted = 0;
  for (const List& list : lists) {
    const ClusteredChunk chunk = encode(list, ClusterEffort::kFast, 20);
    std::vector<uint32_t> indices(3 * size_t{chunk.record.triangle_count});
    std::vector<uint32_t> offsets(3 * size_t{chunk.record.vertex_count});
    std::vector<float> positions(offsets.size());
    GuardedBytes guarded(chunk.payload);
    for (int round = 0; round < 20000; ++round) {
      const uint64_t flips = 1 + random() % 3;
      std::array<uint64_t, 3> bits{};
      for (uint64_t f = 0; f < flips; ++f) {
        bits[f] = random() % (8 * chunk.payload.size());
        if (round % 2 == 0) bits[f] %= 8 * (chunk.payload.size() - 4 * uint64_t{chunk.record.cluster_words} - 8);
        guarded.bytes()[bits[f] / 8] ^= std::byte{1} << (bits[f] % 8);
      }
      const ClusterStreams streams = chunk.streams(guarded.bytes());
      const auto decoded = decode_clusters(streams, {indices, offsets, positions});
      const auto checked = check_clusters(streams);
      if (outcome(decoded) != outcome(checked)) FAIL(outcome(decoded) << " but the check returns " << outcome(checked));
      if (decoded) {
        ++accepted;
        for (const uint32_t index : indices)
          if (index >= chunk.record.vertex_count) FAIL("index " << index);
        for (const uint32_t offset : offsets)
          if (offset >= 1u << 20) FAIL("offset " << offset);
      }
      for (uint64_t f = 0; f < flips; ++f) guarded.bytes()[bits[f] / 8] ^= std::byte{1} << (bits[f] % 8);
    }
    CHECK(outcome(check_clusters(chunk.streams(guarded.bytes()))) == "ok");
  }
  CHECK(accepted > 1000);
}

TEST_CASE("checking and decoding clusters give the same result, at every width", "[cluster_codec]") {
  std::mt19937 random(29);
  std::vector<List> lists;
  for (uint32_t bits = 0; bits <= 24; ++bits) lists.push_back(soup(random, 200, 150, bits));
  for (uint32_t axis = 0; axis < 3; ++axis) {
    List slope = grid_list(12, 200, 0);  // one axis is predicted from the others
    for (size_t v = 0; v < slope.offsets.size(); v += 3) {
      const uint32_t x = slope.offsets[v], y = slope.offsets[v + 1];
      slope.offsets[v + axis] = 9000 - x + y + (x ^ y) % 3;
      slope.offsets[v + (axis + 1) % 3] = x;
      slope.offsets[v + (axis + 2) % 3] = y;
    }
    lists.push_back(slope);
  }
  uint64_t refused = 0;
  for (const List& list : lists) {
    const ClusteredChunk chunk = encode(list);
    std::vector<uint32_t> indices(3 * size_t{chunk.record.triangle_count});
    std::vector<uint32_t> offsets(3 * size_t{chunk.record.vertex_count});
    GuardedBytes guarded(chunk.payload);
    const uint64_t data_bits = 8 * (uint64_t{4} * chunk.record.cluster_words);
    const uint64_t data = 8 * chunk_streams(chunk.mesh, chunk.record).cluster_data.offset;
    for (int round = 0; round < 500; ++round) {
      const uint64_t bit = data + random() % data_bits;
      guarded.bytes()[bit / 8] ^= std::byte{1} << (bit % 8);
      const ClusterStreams streams = chunk.streams(guarded.bytes());
      const auto decoded = decode_clusters(streams, {indices, offsets, {}});
      const auto checked = check_clusters(streams);
      if (bool(decoded) != bool(checked)) FAIL(outcome(decoded) << " but the check returns " << outcome(checked));
      if (!decoded && decoded.error().message != checked.error().message)
        FAIL(decoded.error().message << " but the check returns " << checked.error().message);
      refused += decoded ? 0 : 1;
      guarded.bytes()[bit / 8] ^= std::byte{1} << (bit % 8);
    }
  }
  CHECK(refused > 1000);
}

TEST_CASE("each stream of a clustered chunk has one size and clean slack", "[cluster_codec]") {
  const ClusteredChunk chunk = encode(grid_list(30, 100, 10));
  const ClusterStreams streams = chunk.streams(chunk.payload);
  const uint64_t records = streams.cluster_count * sizeof(ClusterRecord);
  const auto with = [&](std::span<const std::byte> ClusterStreams::*part) {
    return [&streams, part](std::span<const std::byte> bytes) {
      ClusterStreams changed = streams;
      changed.*part = bytes;
      return check_clusters(changed);
    };
  };
  using scree::tests::check_stream_limits;
  check_stream_limits(streams.group_bounds, 8 * streams.group_bounds.size(), with(&ClusterStreams::group_bounds));
  check_stream_limits(streams.cluster_bounds, 8 * records, with(&ClusterStreams::cluster_bounds));
  check_stream_limits(streams.clusters, 8 * records, with(&ClusterStreams::clusters));
  check_stream_limits(streams.data, uint64_t{32} * streams.cluster_words, with(&ClusterStreams::data));
}

TEST_CASE("errors of clusters name the defect", "[cluster_codec]") {
  const ClusteredChunk chunk = encode(grid_list(20, 300, 200), ClusterEffort::kFast, 20);
  const ChunkStreams streams = chunk_streams(chunk.mesh, chunk.record);
  const auto message = [&](const auto& change) {
    ClusteredChunk broken = chunk;
    change(broken);
    const auto checked = check_clusters(broken.streams(broken.payload));
    return checked ? std::string("ok") : outcome(checked) + ": " + checked.error().message;
  };
  const auto change_record = [&](uint32_t cluster, auto change) {
    return message([&](ClusteredChunk& c) {
      std::byte* at = c.payload.data() + streams.clusters.offset + cluster * sizeof(ClusterRecord);
      auto record = load<ClusterRecord>(at);
      change(record);
      store(at, record);
    });
  };
  const auto change_bounds = [&](uint64_t place, auto change) {
    return message([&](ClusteredChunk& c) {
      std::byte* at = c.payload.data() + place;
      auto bounds = load<ClusterBounds>(at);
      change(bounds);
      store(at, bounds);
    });
  };
  CHECK(message([](ClusteredChunk&) {}) == "ok");
  CHECK(change_record(1, [](ClusterRecord& r) { ++r.first_triangle; }).starts_with("range: cluster 1: first triangle"));
  CHECK(change_record(1, [](ClusterRecord& r) { --r.first_vertex; }).starts_with("range: cluster 1: first triangle"));
  CHECK(change_record(2, [](ClusterRecord& r) { ++r.place; }).starts_with("range: cluster 2: data at word"));
  CHECK(change_record(0, [](ClusterRecord& r) { r.counts |= 31u << 27; }) ==
        "range: cluster 0: 31 position bits, expected at most 24");
  CHECK(change_record(0, [](ClusterRecord& r) {
          r.place &= ~(3u << 29);  // x is predicted from y and z
          r.counts = (r.counts & ~(31u << 22)) | 16u << 22;
        }) == "range: cluster 0: 16 bits of an axis from which another one is predicted, expected at most 15");
  CHECK(change_record(chunk.record.cluster_count - 1, [](ClusterRecord& r) {
          r.counts = (r.counts & 0x1ffffu) | 24u << 17 | 24u << 22 | 24u << 27;
          r.place |= kNotPredicted << 29;
        }).find("data end at word") != std::string::npos);
  CHECK(change_bounds(streams.cluster_bounds.offset, [](ClusterBounds& b) { b.shift |= 32; }) ==
        "reserved: cluster 0: reserved bits of its bounds are set");
  CHECK(change_bounds(streams.group_bounds.offset, [](ClusterBounds& b) { b.shift = 17; }) ==
        "range: cluster group 0: bounds of shift 17, expected at most 16");
  CHECK(change_bounds(streams.cluster_bounds.offset, [](ClusterBounds& b) {
          b.axis[0] &= 0xffffffu;
        }).starts_with("range: cluster 0: a position's code"));
  CHECK(change_bounds(streams.group_bounds.offset, [](ClusterBounds& b) {
          b.axis[1] &= 0xffffffu;
        }).find("outside the bounds of its group") != std::string::npos);
  CHECK(message([](ClusteredChunk& c) { c.record.position_bits[0] -= 1; }).find("but the chunk's box has") !=
        std::string::npos);
  CHECK(message([](ClusteredChunk& c) { c.mesh.lattice_bits[0] = 10; }).starts_with("range: positions: code"));
}

TEST_CASE("bounds contain exactly their documented range", "[cluster_codec]") {
  // Extents around every power of two give the finest shift with which all three fit.
  for (uint32_t bits = 1; bits <= 24; ++bits) {
    for (int away = -1; away <= 1; ++away) {
      const uint32_t extent = (1u << bits) + static_cast<uint32_t>(away);
      if (extent >= 1u << 24) continue;
      List list;
      list.add(0, 0, 0);
      list.add(extent, 0, 0);
      list.add(0, extent / 3, 0);
      list.triangle(0, 1, 2);
      const ClusteredChunk chunk = encode(list);
      const auto bounds = load<ClusterBounds>(chunk.streams(chunk.payload).cluster_bounds.data());
      const uint32_t step = 1u << bounds.shift;
      CHECK(bounds_extent(bounds, 0) >= extent);
      CHECK(bounds_extent(bounds, 0) - extent < step);
      CHECK((bounds.shift == 0 || extent >> (bounds.shift - 1) > 255));
      check_round_trip(list);
    }
  }
}
