#include "format/geometry/cluster_page.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_read.h"
#include "tests/format/geometry/cluster_lists.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/results.h"

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
  must(join_page(from.bytes(), to.bytes()));
  CHECK(std::equal(page.begin(), page.end(), to.bytes().begin()));
  return split;
}

SplitPage check_split(const List& list, ClusterEffort effort = ClusterEffort::kFast) {
  const ClusteredChunk chunk = encode(list, effort);
  return check_split(chunk.payload, {{0, chunk.record.cluster_count}});
}

using Point = std::array<int64_t, 3>;

/// Reads the values of the streams one after the other.
struct Values {
  const Bytes& split;
  std::vector<size_t> at;  // of each stream

  explicit Values(const Bytes& bytes) : split(bytes) {
    for (size_t stream = 0; stream < 11; ++stream) at.push_back(stream_begin(bytes, stream));
  }
  template <class T = uint8_t>
  T next(size_t stream) {
    const T value = load<T>(split.data() + at[stream]);
    at[stream] += sizeof(T);
    return value;
  }
};

/// The positions of a page that has one part and can be joined: the words of spec/codecs.md one by one.
std::vector<Point> positions_of(const Bytes& split) {
  const auto unzigzag = [](int64_t z) { return z % 2 == 0 ? z / 2 : -(z + 1) / 2; };
  const auto modulo = [](int64_t value) { return value & 0xffffff; };
  Values in(split);
  const size_t planes = load<uint32_t>(split.data());
  const size_t residuals = stream_bytes(split, 9) / (3 * planes);
  size_t residual = 0;
  std::vector<Point> all;
  int64_t named = 0;
  Point first{};
  for (auto clusters = in.next<uint32_t>(0); clusters != 0; --clusters) {
    const int triangles = in.next(1) + 1, vertices = in.next(2) + 1, form = in.next(3);
    const size_t steps = in.at[5];
    const size_t step_bytes = (static_cast<size_t>(triangles) + 7) / 8;
    in.at[5] += step_bytes * ((form & 8) != 0 ? 2 : 1);
    const auto step = [&](int i, size_t half) {
      return std::to_integer<int>(split[steps + half * step_bytes + static_cast<size_t>(i) / 8]) >> i % 8 & 1;
    };
    std::map<std::pair<int, int>, int> across;
    std::vector<Point> at;
    Point expected = first;
    int found = 0;
    const auto place_to = [&](int end) {
      while (static_cast<int>(at.size()) < end) {
        const int place = in.next(7);
        Point q{};
        if (place == 0) {
          for (size_t axis = 0; axis < 3; ++axis) {
            int64_t code = 0;
            for (size_t plane = 0; plane < planes; ++plane)
              code += std::to_integer<int64_t>(split[in.at[9] + (3 * plane + axis) * residuals + residual])
                      << 8 * plane;
            q[axis] = modulo(expected[axis] + unzigzag(code));
          }
          ++residual;
        } else {
          named = place == 255 ? static_cast<int64_t>(all.size()) - in.next<uint16_t>(8) : named + unzigzag(place - 1);
          q = all.at(static_cast<size_t>(named));
        }
        all.push_back(q);
        at.push_back(q);
        expected = q;
        found = 0;
      }
    };
    int m = 2;
    for (int i = 0; i < triangles; ++i) {
      m += step(i, 0) + ((form & 8) != 0 ? 2 * step(i, 1) : 0);
      const int pair = in.next(6);
      const int a = m - ((form & 7) <= 4 ? pair % 16 : pair);
      const int b = m - ((form & 7) <= 4 ? pair / 16 : in.next(6));
      place_to(m);
      if (m == a || m == b || a == b) continue;
      const auto edge = [](int from, int to) { return std::pair{std::min(from, to), std::max(from, to)}; };
      const auto other = across.find(edge(a, b));
      const auto corner = [&](auto&& of) {
        Point point;
        for (size_t axis = 0; axis < 3; ++axis) point[axis] = of(axis);
        return point;
      };
      const Point from = at[static_cast<size_t>(a)], to = at[static_cast<size_t>(b)];
      if (other != across.end() && other->second < m) {
        const Point over = at[static_cast<size_t>(other->second)];
        const Point here = corner([&](size_t axis) { return from[axis] + to[axis] - over[axis]; });
        if (found < 2)
          expected = found == 0 ? here : corner([&](size_t axis) { return (expected[axis] + here[axis]) >> 1; });
        ++found;
      } else if (found == 0) {
        expected = corner([&](size_t axis) { return (from[axis] + to[axis]) >> 1; });
      }
      across[edge(a, b)] = m;
      across[edge(m, a)] = b;
      across[edge(m, b)] = a;
    }
    place_to(vertices);
    first = at[0];
  }
  return all;
}

/// The outcome of joining, with the message.
std::string join(const Bytes& split, size_t page_bytes) {
  GuardedBytes from(split);
  GuardedBytes to(page_bytes);
  const auto joined = join_page(from.bytes(), to.bytes());
  return joined ? "ok" : outcome(joined) + ": " + joined.error().message;
}

/// The positions of the joined page; empty if joining fails.
std::optional<std::vector<Point>> joined_positions(const Bytes& split, const ClusteredChunk& chunk) {
  const std::string too_short = "truncated: split page: it makes ";
  const std::string found = join(split, 4 * chunk.payload.size());
  if (!found.starts_with(too_short)) return {};
  Bytes page(std::stoul(found.substr(too_short.size())));
  if (!join_page(split, page)) return {};  // some residuals are left over
  const ChunkStreams streams = chunk_streams(chunk.mesh, chunk.record);
  std::vector<Point> points;
  for (uint32_t c = 0; c < chunk.record.cluster_count; ++c) {
    const auto record = load<ClusterRecord>(page.data() + streams.clusters.offset + c * sizeof(ClusterRecord));
    const auto bounds = load<ClusterBounds>(page.data() + streams.cluster_bounds.offset + c * sizeof(ClusterBounds));
    const ClusterReader reader = make_cluster_reader(record, bounds, page.data() + streams.cluster_data.offset);
    for (uint32_t v = 0; v < reader.layout.vertex_count; ++v) {
      uint32_t offset[3];
      reader.offset(v, offset);
      points.push_back({offset[0], offset[1], offset[2]});
    }
  }
  return points;
}

/// `count` triangles without shared vertices, then a copy of triangle `again`.
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

TEST_CASE("split pages are joined byte for byte", "[cluster_page]") {
  check_split(grid_list(1, 1, 0));
  check_split(grid_list(8, 100, 3));
  check_split(grid_list(200, 83800, 80000));  // 24 bits
  for (const ClusterEffort effort : {ClusterEffort::kFast, ClusterEffort::kBest})
    check_split(grid_list(40, 377, 50), effort);
  std::mt19937 random(7);
  for (const uint32_t bits : {8u, 15u, 16u, 24u})
    for (const uint32_t vertices : {40u, 900u}) check_split(soup(random, 700, vertices, bits));
}

TEST_CASE("split pages of the spec", "[cluster_page][spec]") {
  for (const auto& vector : spec_vectors("split.txt")) {
    INFO(vector.text("name"));
    const Bytes split = vector.bytes("bytes"), page = vector.bytes("page");
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

TEST_CASE("bytes between clusters stay unchanged", "[cluster_page]") {
  std::mt19937 random(3);
  const ClusteredChunk first = encode(grid_list(30, 377, 50));
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

TEST_CASE("references go back 65535 vertices and no further", "[cluster_page]") {
  CHECK(stream_bytes(check_split(far_apart(20000, 1000)).bytes, 8) == 2);  // the other two vertices follow it
  CHECK(stream_bytes(check_split(far_apart(23000, 1000)).bytes, 8) == 0);
}

TEST_CASE("references also work after more vertices than are kept", "[cluster_page]") {
  // More vertices than are kept at a time, so that the oldest ones are dropped on the way.
  CHECK(stream_bytes(check_split(far_apart(60000, 60000 - 21845)).bytes, 8) == 2);
  CHECK(stream_bytes(check_split(far_apart(60000, 60000 - 21846)).bytes, 8) == 0);
}

TEST_CASE("joined positions equal the spec's", "[cluster_page]") {
  std::mt19937 random(11);
  std::vector<List> lists = {grid_list(12, 3000, 200), grid_list(40, 11, 3), grid_list(9, 1800000, 1700000)};
  for (const uint32_t vertices : {4u, 40u, 900u}) lists.push_back(soup(random, 700, vertices, 13));  // some degenerate
  for (const List& list : lists) {
    const ClusteredChunk chunk = encode(list);
    SplitPage split = check_split(chunk.payload, {{0, chunk.record.cluster_count}});
    CHECK(joined_positions(split.bytes, chunk) == positions_of(split.bytes));
    // Changes triangles, places and residuals, and checks the pages that can still be joined.
    size_t joined = 0;
    for (int i = 0; i < 1000; ++i) {
      Bytes changed = split.bytes;
      for (size_t stream : {size_t{5}, size_t{6}, size_t{7}, size_t{9}}) {
        const size_t bytes = stream_bytes(changed, stream);
        if (bytes != 0 && random() % 2 == 0)
          changed[stream_begin(changed, stream) + random() % bytes] = static_cast<std::byte>(random());
      }
      const auto points = joined_positions(changed, chunk);
      if (!points) continue;
      ++joined;
      if (*points != positions_of(changed)) FAIL("change " << i << " of " << list.indices.size() / 3 << " triangles");
    }
    CHECK(joined > 50);
  }
}

TEST_CASE("clusters that would take more than twice their bytes are not split", "[cluster_page]") {
  List point;
  point.add(9, 8, 7);
  for (int i = 0; i < 300; ++i) point.triangle(0, 0, 0);
  const ClusteredChunk chunk = encode(point);  // no bits except the steps'
  CHECK(split_page(chunk.payload, std::vector<PageClusters>{{0, chunk.record.cluster_count}}).bytes.empty());
}

TEST_CASE("clusters whose encoding is not the tightest are not split", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid_list(8, 20, 3));
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

TEST_CASE("a split page that is cut off, too long or changed is refused or gives a valid page", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid_list(12, 3000, 200));
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

TEST_CASE("errors of split pages name the defect", "[cluster_page]") {
  const ClusteredChunk chunk = encode(grid_list(12, 3000, 200));
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
  CHECK(with(in(7), 1) == "range: split page: a missing vertex, or too few residuals");
  CHECK(with(in(7), 255) == "range: split page: a missing vertex, or too few residuals");
  const auto moved = [&](size_t grown, size_t shrunk, size_t bytes) {  // moves bytes from the end of one stream to
                                                                       // another's
    Bytes changed = split;
    store(changed.data() + 4 * (1 + grown), static_cast<uint32_t>(stream_bytes(split, grown) + bytes));
    store(changed.data() + 4 * (1 + shrunk), static_cast<uint32_t>(stream_bytes(split, shrunk) - bytes));
    return join(changed, page.size());
  };
  CHECK(moved(10, 9, 1) == "trailing: split page: part of a residual");
  CHECK(moved(10, 9, 3 * load<uint32_t>(split.data())) == "range: split page: a missing vertex, or too few residuals");
  CHECK(moved(1, 0, 4) == "truncated: split page: half a part");
}

}  // namespace
