// Speed of every codec on one core: scree_tests "[.bench]". Hidden, because it measures; it checks only the round trip.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_page.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "tests/format/geometry/index_range.h"
#include "tests/results.h"
#include "tools/clusters/cluster_builder.h"
#include "tools/clusters/fifo_order.h"

using namespace scree::format;

namespace {

constexpr uint64_t kTriangles = 65536;  // a chunk: streams and values stay in the second-level cache
constexpr int kRepeats = 41;

/// Prints the fastest of kRepeats calls, in millions of values per second.
template <class Work>
void report(const char* name, uint64_t values, Work&& work) {
  double best = 1e30;
  for (int i = 0; i < kRepeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    work();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::printf("%-40s %9.1f M/s\n", name, static_cast<double>(values) / best * 1e-6);
}

}  // namespace

TEST_CASE("codec speed", "[.bench]") {
  std::mt19937 random(1);
  for (const uint32_t bits : {0u, 8u, 13u, 16u, 17u, 24u, 32u}) {
    std::vector<uint32_t> indices(3 * kTriangles);
    for (uint32_t& index : indices) index = bits == 0 ? 5 : static_cast<uint32_t>(random()) >> (32 - bits);
    for (uint32_t& index : indices) index = std::min(index, 0xfffffffeu);
    const IndexRange range{0, bits};
    std::vector<std::byte> bytes(packed_bytes(indices.size(), bits));
    std::vector<uint32_t> decoded(indices.size());
    const std::string name = "indices, " + std::to_string(bits) + " bits, ";
    report((name + "encode").c_str(), indices.size(), [&] { encode_indices(bytes, indices, {bits ? 0u : 5u, bits}); });
    bool good = true;
    report((name + "decode").c_str(), indices.size(), [&] {
      good &= bool(decode_indices(decoded, 0xffffffffu, {bits ? 0u : 5u, bits}, bytes));
    });
    report((name + "check").c_str(), indices.size(), [&] {
      good &= bool(check_indices(indices.size(), bits == 0 ? 6 : static_cast<uint32_t>((uint64_t{1} << bits) - 1),
                                 range, bytes));
    });
    CHECK(decoded == indices);
  }
  {
    std::vector<uint32_t> indices(3 * kTriangles);
    for (uint32_t& index : indices) index = static_cast<uint32_t>(random());
    IndexRange range{};
    report("indices, range", indices.size(), [&] { range = scree::tests::index_range(indices); });
    CHECK(range.bits == 32);
  }

  const uint64_t vertices = kTriangles / 2;
  for (const uint32_t bits : {10u, 15u, 16u, 20u, 24u}) {
    std::vector<float> positions(3 * vertices);
    std::uniform_real_distribution<float> uniform(-10, 10);
    for (float& value : positions) value = uniform(random);
    const float lo[3] = {-10, -10, -10};
    const float hi[3] = {10, 10, 10};
    const auto lattice = must(choose_lattice(lo, hi, bits, 0));
    std::vector<uint32_t> coordinates(positions.size());
    const std::string name = "positions, " + std::to_string(bits) + " bits, ";
    report((name + "quantize").c_str(), vertices, [&] { quantize_positions(coordinates, positions, lattice); });
    PositionRange range;
    report((name + "range").c_str(), vertices, [&] { range = position_range(coordinates); });
    std::vector<std::byte> bytes(position_stream_bytes(vertices, range));
    report((name + "encode").c_str(), vertices, [&] { encode_positions(bytes, coordinates, range); });
    std::vector<float> decoded(positions.size());
    bool good = true;
    report((name + "decode").c_str(), vertices,
           [&] { good &= bool(decode_positions(decoded, lattice, range, bytes)); });
    MeshLattice narrow = lattice;  // so that every code is checked
    narrow.bits[0] = static_cast<uint8_t>(range.bits[0] - 1);
    report((name + "check").c_str(), vertices, [&] { good &= !bool(check_positions(vertices, narrow, range, bytes)); });
    CHECK(good);
  }

  std::uniform_real_distribution<float> unit(0, 1);
  {
    std::vector<float> uvs(2 * vertices);
    for (float& value : uvs) value = unit(random);
    UvRange range;
    report("uvs, range", vertices, [&] { range = choose_uv_range(uvs); });
    std::vector<std::byte> bytes(uv_stream_bytes(vertices, range));
    report("uvs, encode", vertices, [&] { encode_uvs(bytes, uvs, range); });
    bool good = true;
    report("uvs, decode", vertices, [&] { good &= bool(decode_uvs(uvs, range, bytes)); });
    CHECK(good);
  }
  {
    std::vector<float> colors(4 * vertices);
    for (float& value : colors) value = unit(random);
    std::vector<std::byte> bytes(color_stream_bytes(vertices));
    report("colors, encode", vertices, [&] { encode_colors(bytes, colors); });
    bool good = true;
    report("colors, decode", vertices, [&] { good &= bool(decode_colors(colors, bytes)); });
    CHECK(good);
  }
  for (const uint32_t bits : {8u, 12u, 16u}) {
    std::vector<float> normals(3 * vertices);
    std::normal_distribution<float> gauss;
    for (float& value : normals) value = gauss(random);
    std::vector<std::byte> bytes(normal_stream_bytes(vertices, bits));
    const std::string name = "normals, " + std::to_string(bits) + " bits, ";
    report((name + "encode").c_str(), vertices, [&] { encode_normals(bytes, normals, bits); });
    bool good = true;
    report((name + "decode").c_str(), vertices, [&] { good &= bool(decode_normals(normals, bits, bytes)); });
    CHECK(good);
  }
  {
    std::vector<uint64_t> ids(kTriangles);
    for (uint64_t& id : ids) id = (uint64_t{1} << 33) + random() % 100000;
    SourceIdRange range;
    report("source ids, range", kTriangles, [&] { range = source_id_range(ids); });
    std::vector<std::byte> bytes(packed_bytes(kTriangles, range.bits));
    report("source ids, encode", kTriangles, [&] { encode_source_ids(bytes, ids, range); });
    std::vector<uint64_t> decoded(kTriangles);
    bool good = true;
    report("source ids, decode", kTriangles, [&] { good &= bool(decode_source_ids(decoded, range, bytes)); });
    CHECK(good);
    CHECK(decoded == ids);
  }
}

TEST_CASE("cluster speed", "[.bench]") {
  // A chunk like those of scans: a rough height field of 181 x 181 quads at 16 bits, in the order of convert.
  constexpr uint32_t kSide = 181;
  std::mt19937 random(2);
  std::vector<uint32_t> rows, indices, offsets;
  for (uint32_t y = 0; y <= kSide; ++y)
    for (uint32_t x = 0; x <= kSide; ++x)
      offsets.insert(offsets.end(),
                     {x * 300 + static_cast<uint32_t>(random() % 40), y * 300 + static_cast<uint32_t>(random() % 40),
                      20000 + 100 * x + 50 * y + static_cast<uint32_t>(random() % 60)});
  for (uint32_t y = 0; y < kSide; ++y)
    for (uint32_t x = 0; x < kSide; ++x) {
      const uint32_t a = y * (kSide + 1) + x;
      rows.insert(rows.end(), {a, a + 1, a + kSide + 2, a, a + kSide + 2, a + kSide + 1});
    }
  scree::tools::FifoOrder order;
  for (const uint64_t triangle : order.run(rows, static_cast<uint32_t>(offsets.size() / 3)))
    for (uint64_t corner = 0; corner < 3; ++corner) indices.push_back(rows[3 * triangle + corner]);
  MeshRecord mesh{};
  for (uint8_t& bits : mesh.lattice_bits) bits = 16;
  ChunkRecord record{};
  const uint64_t triangles = indices.size() / 3;
  ClusterSet set;
  report("clusters, cut and pack", triangles,
         [&] { set = scree::tools::ClusterBuilder().build(indices, offsets, scree::tools::ClusterEffort::kFast); });
  const ClusterRun run{0, set.clusters.size(), 0};
  describe_clusters(set, run, record);
  std::vector<std::byte> bytes(cluster_stream_bytes(record.cluster_count, record.cluster_words));
  report("clusters, write", triangles, [&] { write_clusters(bytes, set, run, record); });
  const ClusterStreams streams = cluster_streams_of(mesh, record, bytes);
  std::vector<uint32_t> decoded(3 * uint64_t{record.triangle_count});
  std::vector<float> positions(3 * uint64_t{record.vertex_count});
  bool good = true;
  report("clusters, decode", triangles, [&] { good &= bool(decode_clusters(streams, {decoded, {}, positions})); });
  report("clusters, check", triangles, [&] { good &= bool(check_clusters(streams)); });
  std::printf("clusters, bytes a triangle %27.2f\n",
              static_cast<double>(bytes.size()) / static_cast<double>(triangles));
  const PageClusters parts[] = {{0, record.cluster_count}};
  SplitPage split;
  report("clusters, split a page", triangles, [&] { split = split_page(bytes, parts); });
  std::vector<std::byte> joined(bytes.size());
  report("clusters, join a split page", triangles, [&] { good &= bool(join_page(split.bytes, joined)); });
  CHECK(joined == bytes);
  CHECK(good);
}
