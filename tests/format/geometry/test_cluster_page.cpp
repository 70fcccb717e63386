#include "format/geometry/cluster_page.h"

#include <algorithm>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "format/geometry/cluster_codec.h"
#include "tests/catch.h"
#include "tests/format/geometry/cluster_lists.h"
#include "tests/format/geometry/guarded_bytes.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"

using namespace scree::format;
using namespace scree::tests;
using scree::tools::ClusterEffort;

namespace {

using Bytes = std::vector<std::byte>;

constexpr size_t kHeaderBytes = 48;

/// Bytes of a stream, numbered in the order of spec/codecs.md.
size_t stream_bytes(const Bytes& split, size_t stream) {
  return load<uint32_t>(split.data() + 4 * (1 + stream));
}
size_t stream_begin(const Bytes& split, size_t stream) {
  size_t begin = kHeaderBytes;
  for (size_t i = 0; i < stream; ++i) begin += stream_bytes(split, i);
  return begin;
}

/// Splits a page and joins it again, between guard pages.
SplitPage check_split(const Bytes& page, const std::vector<PageClusters>& clusters) {
  SplitPage split = split_page(page, clusters);
  REQUIRE(!split.bytes.empty());
  CHECK(split.bytes.size() <= kMaxSplitRatio * page.size());
  CHECK(std::is_sorted(split.stream_ends.begin(), split.stream_ends.end()));
  CHECK(split.stream_ends.back() == split.bytes.size());
  GuardedBytes from(split.bytes);
  GuardedBytes to(page.size());
  std::fill(to.bytes().begin(), to.bytes().end(), std::byte{0xaa});
  if (const auto joined = join_page(from.bytes(), to.bytes()); !joined) FAIL(joined.error().message);
  CHECK(std::equal(page.begin(), page.end(), to.bytes().begin()));
  return split;
}

SplitPage check_split(const List& list, ClusterEffort effort = ClusterEffort::kFast) {
  const ClusteredChunk chunk = encode(list, effort);
  return check_split(chunk.payload, {{0, chunk.record.cluster_count}});
}

/// The outcome of joining, with the message.
std::string join(const Bytes& split, size_t page_bytes) {
  GuardedBytes from(split);
  GuardedBytes to(page_bytes);
  const auto joined = join_page(from.bytes(), to.bytes());
  return joined ? "ok" : outcome(joined) + ": " + joined.error().message;
}

/// `count` triangles without shared vertices, then one with the corners of triangle `again`.
List far_apart(uint32_t count, uint32_t again) {
  List list;
  const auto add = [&list](uint32_t i) {
    const uint32_t away = i * 7919 % 65521;
    const uint32_t first = list.add(3 * i, away, i * 104729 % 65521);
    list.add(3 * i + 1, i * 611953 % 65521, away / 5);
    list.add(3 * i + 2, away, i * 1299709 % 65521);
    list.triangle(first, first + 1, first + 2);
  };
  for (uint32_t i = 0; i < count; ++i) add(i);
  add(again);
  return list;
}

TEST_CASE("split pages come back byte for byte", "[cluster_page]") {
  check_split(grid(1, 1, 0));
  check_split(grid(8, 100, 3));
  check_split(grid(200, 83800, 80000));  // 24 bits
  for (const ClusterEffort effort : {ClusterEffort::kFast, ClusterEffort::kBest})
    check_split(grid(40, 377, 50), effort);
  std::mt19937 random(7);
  for (const uint32_t bits : {8u, 15u, 16u, 24u})
    for (const uint32_t vertices : {40u, 900u}) check_split(soup(random, 700, vertices, bits));
}

TEST_CASE("split pages of the spec", "[cluster_page][spec]") {
  for (const auto& vector : spec_vectors("split.txt")) {
    INFO(vector.text("name"));
    const Bytes split = vector.bytes("bytes");
    const Bytes page = vector.bytes("page");
    if (vector.has("error")) {
      CHECK(join(split, page.size()).starts_with(vector.text("error") + ": split page: "));
      continue;
    }
    Bytes joined(page.size());
    REQUIRE(join_page(split, joined));
    CHECK(joined == page);
    const auto offsets = vector.integers<uint64_t>("offsets");
    const auto counts = vector.integers<uint32_t>("cluster_counts");
    std::vector<PageClusters> clusters;
    for (size_t i = 0; i < offsets.size(); ++i) clusters.push_back({offsets[i], counts.at(i)});
    CHECK(split_page(page, clusters).bytes == split);
  }
}

TEST_CASE("what lies between clusters is kept as it is", "[cluster_page]") {
  std::mt19937 random(3);
  const ClusteredChunk first = encode(grid(30, 377, 50));
  const ClusteredChunk second = encode(soup(random, 300, 200, 12));
  Bytes page;
  std::vector<PageClusters> clusters;
  const auto add_plain = [&](size_t bytes) {
    for (size_t i = 0; i < bytes; ++i) page.push_back(static_cast<std::byte>(random()));
  };
  const auto add = [&](const ClusteredChunk& chunk) {
    clusters.push_back({page.size(), chunk.record.cluster_count});
    page.insert(page.end(), chunk.payload.begin(), chunk.payload.end());
  };
  add_plain(64);
  add(first);
  add_plain(160);
  add(second);
  add(first);
  const SplitPage split = check_split(page, clusters);
  CHECK(stream_bytes(split.bytes, 0) == 4 * 8);  // the part before the first, and three more
  CHECK(stream_bytes(split.bytes, 10) == 64 + 160);
  add_plain(48);
  CHECK(stream_bytes(check_split(page, clusters).bytes, 10) == 64 + 160 + 48);
}

TEST_CASE("vertices are named 65535 back and no further", "[cluster_page]") {
  CHECK(stream_bytes(check_split(far_apart(20000, 1000)).bytes, 8) == 2);  // the other two vertices follow the first
  CHECK(stream_bytes(check_split(far_apart(23000, 1000)).bytes, 8) == 0);
}

TEST_CASE("clusters that would take more than twice their bytes are not split", "[cluster_page]") {
  List point;
  point.add(9, 8, 7);
  for (int i = 0; i < 300; ++i) point.triangle(0, 0, 0);
  const ClusteredChunk chunk = encode(point);  // no bits except the steps'
  CHECK(split_page(chunk.payload, std::vector<PageClusters>{{0, chunk.record.cluster_count}}).bytes.empty());
}

TEST_CASE("clusters that are not the tightest are not split", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid(8, 20, 3));
  ClusteredChunk loose = chunk;
  const ChunkStreams streams = chunk_streams(chunk.mesh, chunk.record);
  std::byte* const at = loose.payload.data() + streams.cluster_bounds.offset;
  auto bounds = load<ClusterBounds>(at);
  for (uint32_t& axis : bounds.axis) axis |= 255u << 24;
  store(at, bounds);
  REQUIRE(outcome(check_clusters(loose.streams(loose.payload))) == "ok");
  CHECK(!split_page(chunk.payload, std::vector<PageClusters>{{0, chunk.record.cluster_count}}).bytes.empty());
  CHECK(split_page(loose.payload, std::vector<PageClusters>{{0, chunk.record.cluster_count}}).bytes.empty());
}

TEST_CASE("a split page that is cut off, too long or changed is refused or makes a page", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid(12, 3000, 200));
  Bytes page = chunk.payload;
  page.resize(page.size() + 32, std::byte{9});
  const Bytes split = check_split(page, {{0, chunk.record.cluster_count}}).bytes;
  for (size_t size = 0; size < split.size(); ++size) {
    const std::string found = join(Bytes(split.begin(), split.begin() + static_cast<ptrdiff_t>(size)), page.size());
    if (!found.starts_with("truncated")) FAIL("a prefix of " << size << " bytes: " << found);
  }
  Bytes longer = split;
  longer.push_back(std::byte{0});
  CHECK(join(longer, page.size()) == "trailing: split page: bytes after the last stream");
  CHECK(join(split, page.size() + 1).starts_with("truncated: split page: it makes"));
  CHECK(join(split, page.size() - 1).starts_with("trailing: split page: it makes more than"));
  CHECK(join(split, 0).starts_with("trailing: split page: it makes more than"));
  GuardedBytes from(split);
  GuardedBytes to(page.size());
  size_t accepted = 0;
  for (size_t i = 0; i < split.size(); ++i) {
    const std::byte before = from.bytes()[i];
    for (const unsigned change : {1u, 2u, 0x80u, 0xffu}) {
      from.bytes()[i] = before ^ static_cast<std::byte>(change);
      accepted += bool(join_page(from.bytes(), to.bytes()));
    }
    from.bytes()[i] = before;
  }
  CHECK(accepted > split.size());  // with other positions and triangles
  CHECK(accepted < 4 * split.size());
}

TEST_CASE("what is wrong with a split page is said", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid(12, 3000, 200));
  const Bytes page = chunk.payload;
  const Bytes split = check_split(page, {{0, chunk.record.cluster_count}}).bytes;
  const auto with = [&](size_t at, uint8_t value) {
    Bytes changed = split;
    changed[at] = std::byte{value};
    return join(changed, page.size());
  };
  const auto in = [&](size_t stream) { return stream_begin(split, stream); };
  CHECK(with(0, 0) == "range: split page: residuals of 0 bytes, expected 1 to 3");
  CHECK(with(0, 4) == "range: split page: residuals of 4 bytes, expected 1 to 3");
  CHECK(with(7, 255) == "truncated: split page: its parts end early");
  Bytes another = split;
  another[in(0)] = static_cast<std::byte>(chunk.record.cluster_count + 1);
  CHECK(join(another, page.size() + 64) == "truncated: split page: its triangles end early");
  CHECK(with(in(0) + 3, 200).starts_with("trailing: split page: it makes more than the page's"));
  CHECK(with(in(0) + 4, 1) == "truncated: split page: its plain end early");
  CHECK(with(in(1), 128) == "range: split page: more than 128 triangles or vertices of a cluster");
  CHECK(with(in(2), 255) == "range: split page: more than 128 triangles or vertices of a cluster");
  CHECK(with(in(2), 4) == "range: split page: a triangle with vertices that its cluster lacks");
  CHECK(with(in(3), 64) == "reserved: split page: a reserved bit of a form is set");
  CHECK(with(in(6), 255) == "range: split page: a triangle with vertices that its cluster lacks");
  CHECK(with(in(7), 1) == "range: split page: a vertex that is not there, or too few residuals");
  CHECK(with(in(7), 255) == "range: split page: a vertex that is not there, or too few residuals");
  const auto moved = [&](size_t grown, size_t shrunk, size_t bytes) {  // moves bytes from the end of one stream to
                                                                       // another's
    Bytes changed = split;
    store(changed.data() + 4 * (1 + grown), static_cast<uint32_t>(stream_bytes(split, grown) + bytes));
    store(changed.data() + 4 * (1 + shrunk), static_cast<uint32_t>(stream_bytes(split, shrunk) - bytes));
    return join(changed, page.size());
  };
  CHECK(moved(10, 9, 1) == "trailing: split page: part of a residual");
  CHECK(moved(10, 9, 3 * load<uint32_t>(split.data())) ==
        "range: split page: a vertex that is not there, or too few residuals");
  CHECK(moved(1, 0, 4) == "truncated: split page: half a part");
}

}  // namespace
