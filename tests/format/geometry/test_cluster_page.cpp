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

constexpr size_t kHeaderBytes = 60;

// The streams in the order of spec/codecs.md.
struct In {
  enum Stream : size_t {
    kParts,
    kTriangles,
    kVertices,
    kForms,
    kSlopes,
    kGates,
    kDistances,
    kFresh,
    kReferences,
    kFar,
    kLow,
    kHigh,
    kTall,
    kPlain,
    kStreams
  };
};

/// Bytes of a stream.
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
    for (size_t stream = 0; stream < In::kStreams; ++stream) at.push_back(stream_begin(bytes, stream));
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
  const size_t tall_bytes = load<uint32_t>(split.data());
  const size_t residuals = stream_bytes(split, In::kLow) / 3;
  const size_t tall_codes = stream_bytes(split, In::kTall) / tall_bytes;
  const auto byte_at = [&](size_t at) { return std::to_integer<int64_t>(split.at(at)); };
  size_t residual = 0;
  const auto next_residual = [&] {
    Point values;
    const int64_t high = stream_bytes(split, In::kHigh) == 0 ? 0 : in.next(In::kHigh);
    for (size_t axis = 0; axis < 3; ++axis) {
      int64_t rest = high >> 2 * axis & 3;
      if (rest == 3) {
        rest = byte_at(in.at[In::kTall]) + (tall_bytes == 2 ? byte_at(in.at[In::kTall] + tall_codes) * 256 : 0);
        ++in.at[In::kTall];
      }
      values[axis] = unzigzag(byte_at(in.at[In::kLow] + axis * residuals + residual) + rest * 256);
    }
    ++residual;
    return values;
  };
  const auto next_far = [&] {
    const size_t low = in.at[In::kFar]++;
    return byte_at(low) + 256 * byte_at(low + stream_bytes(split, In::kFar) / 2);
  };
  std::vector<Point> all;
  int64_t named = 0;
  Point first{};
  for (auto clusters = in.next<uint32_t>(In::kParts); clusters != 0; --clusters) {
    const int triangles = in.next(In::kTriangles) + 1, vertices = in.next(In::kVertices) + 1;
    in.next(In::kForms);
    const size_t fresh = in.at[In::kFresh];
    in.at[In::kFresh] += (static_cast<size_t>(vertices) + 7) / 8;
    std::vector<Point> at;
    Point expected = first;
    int found = 0;
    const auto place_to = [&](int end) {
      for (; static_cast<int>(at.size()) < end; found = 0) {
        Point q{};
        if ((byte_at(fresh + at.size() / 8) >> at.size() % 8 & 1) != 0) {
          const Point values = next_residual();
          for (size_t axis = 0; axis < 3; ++axis) q[axis] = modulo(expected[axis] + values[axis]);
        } else {
          const int64_t reference = in.next(In::kReferences);
          named = reference == 255 ? static_cast<int64_t>(all.size()) - next_far() : named + unzigzag(reference);
          q = all.at(static_cast<size_t>(named));
        }
        all.push_back(q);
        at.push_back(q);
        expected = q;
      }
    };
    std::map<int, int> next = {{0, 1}}, across;
    int m = 2, a = 0, b = 0, k = -1;  // k: earlier triangles with the same m
    for (int i = 0; i < triangles; ++i) {
      const int gate = in.next(In::kGates);
      k = gate == 0 || gate == 128 ? k + 1 : 0;
      std::optional<int> w;
      if (gate >= 128) {
        m += gate - 128;
        a = m - in.next(In::kDistances);
        b = m - in.next(In::kDistances);
      } else {
        m += gate != 0 ? 1 : 0;
        a = gate != 0 ? m - gate : b;
        b = next[a];
        if (across.contains(a)) w = across[a];
      }
      place_to(m);
      if (k < 2 && a < m && b < m) {
        const auto each = [&](auto&& of) {
          Point point;
          for (size_t axis = 0; axis < 3; ++axis) point[axis] = of(axis);
          return point;
        };
        const Point from = at.at(static_cast<size_t>(a)), to = at.at(static_cast<size_t>(b));
        if (w && *w < m) {
          const Point over = at.at(static_cast<size_t>(*w));
          const Point corner = each([&](size_t axis) { return from[axis] + to[axis] - over[axis]; });
          if (found == 0) expected = corner;
          if (found != 0) expected = each([&](size_t axis) { return (expected[axis] + corner[axis]) >> 1; });
          ++found;
        } else if (found == 0) {
          expected = each([&](size_t axis) { return (from[axis] + to[axis]) >> 1; });
        }
      }
      next[a] = m;
      across[a] = b;
      next[m] = b;
      across[m] = a;
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
  CHECK(stream_bytes(split.bytes, In::kParts) == 4 * 8);  // the part before the first, and three more
  CHECK(stream_bytes(split.bytes, In::kPlain) == 64 + 160);
  add_plain(48);
  CHECK(stream_bytes(check_split(page, clusters).bytes, In::kPlain) == 64 + 160 + 48);
}

TEST_CASE("references go back 65535 vertices and no further", "[cluster_page]") {
  CHECK(stream_bytes(check_split(far_apart(20000, 1000)).bytes, In::kFar) == 2);  // the other two vertices follow it
  CHECK(stream_bytes(check_split(far_apart(23000, 1000)).bytes, In::kFar) == 0);
}

TEST_CASE("references also work after more vertices than are kept", "[cluster_page]") {
  // More vertices than are kept at a time, so that the oldest ones are dropped on the way.
  CHECK(stream_bytes(check_split(far_apart(60000, 60000 - 21845)).bytes, In::kFar) == 2);
  CHECK(stream_bytes(check_split(far_apart(60000, 60000 - 21846)).bytes, In::kFar) == 0);
}

TEST_CASE("joined positions equal the spec's", "[cluster_page]") {
  std::mt19937 random(11);
  std::vector<List> lists = {grid_list(12, 3000, 200), grid_list(40, 11, 3), grid_list(9, 1800000, 1700000)};
  for (const uint32_t vertices : {40u, 70u, 900u}) lists.push_back(soup(random, 700, vertices, 13));  // some degenerate
  for (const List& list : lists) {
    const ClusteredChunk chunk = encode(list);
    SplitPage split = check_split(chunk.payload, {{0, chunk.record.cluster_count}});
    CHECK(joined_positions(split.bytes, chunk) == positions_of(split.bytes));
    // Changes triangles, references and residuals, and checks the pages that can still be joined.
    size_t joined = 0;
    for (int i = 0; i < 1000; ++i) {
      Bytes changed = split.bytes;
      for (const In::Stream stream :
           {In::kGates, In::kDistances, In::kFresh, In::kReferences, In::kLow, In::kHigh, In::kTall}) {
        const size_t bytes = stream_bytes(changed, stream);
        if (bytes != 0 && random() % 4 == 0)
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
  CHECK(with(0, 0) == "range: split page: tall codes of 0 bytes, expected 1 or 2");
  CHECK(with(0, 3) == "range: split page: tall codes of 3 bytes, expected 1 or 2");
  CHECK(with(7, 255) == "truncated: split page: its parts end early");
  Bytes another = split;
  another[in(In::kParts)] = static_cast<std::byte>(chunk.record.cluster_count + 1);
  CHECK(join(another, page.size() + 64) == "truncated: split page: its triangles end early");
  CHECK(with(in(In::kParts) + 3, 200).starts_with("trailing: split page: it makes more than the page's"));
  CHECK(with(in(In::kParts) + 4, 1) == "truncated: split page: its plain end early");
  CHECK(with(in(In::kTriangles), 128) == "range: split page: more than 128 triangles or vertices of a cluster");
  CHECK(with(in(In::kVertices), 255) == "range: split page: more than 128 triangles or vertices of a cluster");
  CHECK(with(in(In::kVertices), 4) == "range: split page: a triangle with vertices that its cluster lacks");
  CHECK(with(in(In::kForms), 64) == "reserved: split page: a reserved bit of a form is set");
  CHECK(with(in(In::kGates), 132) == "reserved: split page: a reserved bit of a gate is set");
  CHECK(with(in(In::kGates), 127) == "range: split page: a triangle with vertices that its cluster lacks");
  const size_t last_fresh = in(In::kReferences)-1;
  REQUIRE((split[last_fresh] & std::byte{128}) == std::byte{});
  CHECK(with(last_fresh, 128) == "reserved: split page: a fresh bit after the last vertex is set");
  REQUIRE(split[in(In::kFresh)] == std::byte{255});
  CHECK(with(in(In::kFresh), 254) == "range: split page: a missing vertex");
  CHECK(with(in(In::kReferences), 255).ends_with(": split page: a missing vertex"));
  CHECK(with(in(In::kHigh), 64) == "reserved: split page: a reserved bit of a residual is set");
  CHECK(with(in(In::kHigh), 63) == "truncated: split page: its tall bytes end early");
  const auto moved = [&](size_t grown, size_t shrunk, size_t bytes) {  // moves bytes from the end of one stream to
                                                                       // another's
    Bytes changed = split;
    store(changed.data() + 4 * (1 + grown), static_cast<uint32_t>(stream_bytes(split, grown) + bytes));
    store(changed.data() + 4 * (1 + shrunk), static_cast<uint32_t>(stream_bytes(split, shrunk) - bytes));
    return join(changed, page.size());
  };
  CHECK(moved(In::kPlain, In::kLow, 1) == "trailing: split page: part of a residual");
  CHECK(moved(In::kPlain, In::kHigh, 1).starts_with("range: split page: high bits of "));
  CHECK(moved(In::kFar, In::kLow, 3) == "trailing: split page: part of a far distance");
  CHECK(moved(In::kLow, In::kReferences, 3).starts_with("range: split page: high bits of "));
  CHECK(moved(In::kTriangles, In::kParts, 4) == "truncated: split page: half a part");
}

}  // namespace
