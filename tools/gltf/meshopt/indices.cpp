// Modes TRIANGLES and INDICES, versions 0 and 1. meshoptimizer unpacks such streams only whole. These decoders can stop
// after any triangle or index. They accept the same streams as meshoptimizer.
#include <algorithm>
#include <array>

#include "format/bytes.h"
#include "tools/gltf/meshopt/stream.h"

namespace scree::convert {
namespace {

uint32_t take_byte(const std::byte*& data) {
  return std::to_integer<uint32_t>(*data++);
}

/// Seven bits per byte, the lowest first, in at most five bytes. The eighth bit is set if more bytes follow.
uint32_t take_varint(const std::byte*& data) {
  const uint32_t lowest = take_byte(data);
  if (lowest < 128) return lowest;
  uint32_t value = lowest & 127;
  for (uint32_t shift = 7; shift <= 28; shift += 7) {
    const uint32_t bits = take_byte(data);
    value |= (bits & 127) << shift;
    if (bits < 128) break;
  }
  return value;
}

/// 0, 1, 2, 3... for 0, -1, 1, -2...
uint32_t unzigzag(uint32_t value) {
  return value >> 1 ^ (0u - (value & 1));
}

template <class State>
State load_state(const MeshoptPlace& at) {
  static_assert(sizeof(State) <= sizeof at.state);
  return format::load<State>(at.state.data());
}

// The stream has one byte of code per triangle, then further data that some codes need, then 16 frequent codes of
// corners. A corner is new (numbered in order), one of the last 16 edges and vertices, or explicit: coded as the
// difference to the last explicit corner.
constexpr size_t kTableBytes = 16;
constexpr size_t kMostTriangleData = 16;  // one byte for three corners, and five for each corner

struct TriangleState {
  // Rings, written at edge_at and vertex_at. An edge is written as a whole, its first vertex in the low half. If it
  // were written in two halves, a read of the whole soon after would have to wait until both have reached the cache.
  std::array<uint64_t, 16> edges;
  std::array<uint32_t, 16> vertices;
  uint32_t edge_at, vertex_at;
  uint32_t next, last;  // the next new vertex, and the last explicit one
  uint32_t told_from;   // corners beside an edge are explicit from this code on; smaller codes are new or recent
  std::array<std::byte, kTableBytes> table;

  void push_vertex(uint32_t vertex, bool is_new) {
    vertices[vertex_at] = vertex;  // if it is not new, the next one overwrites it before any read
    vertex_at = (vertex_at + is_new) & 15;
  }
  void push_edge(uint32_t a, uint32_t b) {
    edges[edge_at] = a | uint64_t{b} << 32;
    edge_at = (edge_at + 1) & 15;
  }
  /// The `age`-th of the most recent vertices, from 1.
  uint32_t recent(uint32_t age) const { return vertices[(vertex_at - age) & 15]; }
  uint32_t new_or_recent(uint32_t age) {
    const uint32_t vertex = age == 0 ? next : recent(age);
    next += age == 0;
    return vertex;
  }
  uint32_t told(const std::byte*& data) { return last += unzigzag(take_varint(data)); }
};

template <class Index>
void store_triangle(std::byte*& out, uint32_t a, uint32_t b, uint32_t c) {
  format::store(out, static_cast<Index>(a));
  format::store(out + sizeof(Index), static_cast<Index>(b));
  format::store(out + 2 * sizeof(Index), static_cast<Index>(c));
  out += 3 * sizeof(Index);
}

/// Unpacks triangles while there are codes, and while `data` is at most `last_data`; returns how many. Advances `data`.
/// Each triangle takes at most kMostTriangleData.
template <class Index>
size_t decode_triangles(TriangleState& state, std::span<const std::byte> codes, const std::byte*& data,
                        const std::byte* last_data, std::byte* out) {
  TriangleState s = state;  // a copy, so that most of it stays in registers
  const std::byte* from = data;
  size_t done = 0;
  for (; done < codes.size() && from <= last_data; ++done) {
    const uint32_t code = std::to_integer<uint32_t>(codes[done]);
    uint32_t a, b, c;
    if (code < 0xf0) {
      const uint64_t edge = s.edges[(s.edge_at - 1 - (code >> 4)) & 15];
      a = static_cast<uint32_t>(edge);
      b = static_cast<uint32_t>(edge >> 32);
      const uint32_t third = code & 15;
      if (third < s.told_from) {
        // Age 0 is a new vertex, so other ages count from 1. Here the last vertex but one has code 1.
        const uint32_t recent = s.recent(third + 1);
        c = third == 0 ? s.next : recent;
        s.next += third == 0;
        s.push_vertex(c, third == 0);
      } else {
        c = third == 15 ? s.told(from) : third == 14 ? ++s.last : --s.last;
        s.push_vertex(c, true);
      }
    } else {
      const uint32_t ages = code < 0xfe ? std::to_integer<uint32_t>(s.table[code & 15]) : take_byte(from);
      const bool is_free = code >= 0xfe;
      if (is_free && ages == 0) s.next = 0;
      const uint32_t age_b = ages >> 4, age_c = ages & 15;
      const bool told_a = code == 0xff, told_b = is_free && age_b == 15, told_c = is_free && age_c == 15;
      a = told_a ? 0 : s.next++;
      b = s.new_or_recent(age_b);
      c = s.new_or_recent(age_c);
      if (told_a) a = s.told(from);
      if (told_b) b = s.told(from);
      if (told_c) c = s.told(from);
      s.push_vertex(a, true);
      s.push_vertex(b, age_b == 0 || told_b);
      s.push_vertex(c, age_c == 0 || told_c);
      s.push_edge(b, a);
    }
    s.push_edge(c, b);
    s.push_edge(a, c);
    store_triangle<Index>(out, a, b, c);
  }
  state = s;
  data = from;
  return done;
}

class TriangleStream final : public MeshoptStream {
 public:
  using MeshoptStream::MeshoptStream;

  uint64_t granularity() const override { return 3; }

  void will_need(uint64_t first, uint64_t end) const override {
    source().will_need(stated().offset + 1 + first / 3, (end - first) / 3);
    hint_part(1 + stated().count / 3, first, end);
  }

  Result<void> unpack(MeshoptPlace& at, uint64_t first, std::span<std::byte> out) const override {
    const uint64_t bytes = 3 * stated().stride, count = out.size() / bytes;
    const uint64_t codes_at = stated().offset + 1 + first / 3;
    PieceReader codes(source(), codes_at, codes_at + count), data(source(), stated().offset + at.offset, end());
    TriangleState state = load_state<TriangleState>(at);
    for (uint64_t done = 0; done < count;) {
      SCREE_TRY(codes.want(1));
      SCREE_TRY(data.want(kMostTriangleData));
      if (data.size() < kMostTriangleData) return ends_early();
      const auto decode = stated().stride == 2 ? decode_triangles<uint16_t> : decode_triangles<uint32_t>;
      const std::byte* from = data.data();
      const size_t more = decode(state, {codes.data(), codes.size()}, from,
                                 data.data() + data.size() - kMostTriangleData, out.data() + done * bytes);
      codes.skip(more);
      data.skip(static_cast<size_t>(from - data.data()));
      done += more;
    }
    at.offset = data.offset() - stated().offset;
    format::store(at.state.data(), state);
    if (first / 3 + count == stated().count / 3 && at.offset + kTableBytes != stated().bytes) return has_more();
    return {};
  }

 private:
  Result<MeshoptPlace> start(uint32_t version) const override {
    const uint64_t triangles = stated().count / 3;
    if (stated().bytes < kTableBytes + 1 || stated().bytes - kTableBytes - 1 < triangles) return ends_early();
    MeshoptPlace at{.offset = 1 + triangles};
    TriangleState state{};
    state.edges.fill(~uint64_t{0});
    state.vertices.fill(~0u);
    state.told_from = version == 0 ? 15 : 13;
    SCREE_TRY(source().read(end() - kTableBytes, state.table));
    format::store(at.state.data(), state);
    return at;
  }
};

// Each index is the difference to the previous one of two series; the lowest bit chooses the series.
constexpr size_t kTailBytes = 4;
constexpr size_t kMostIndexBytes = 5;

using IndexState = std::array<uint32_t, 2>;

template <class Index>
size_t decode_indices(IndexState& state, size_t count, const std::byte*& data, const std::byte* last_data,
                      std::byte* out) {
  IndexState last = state;
  const std::byte* from = data;
  size_t done = 0;
  for (; done < count && from <= last_data; ++done) {
    const uint32_t value = take_varint(from);
    const uint32_t index = last[value & 1] += unzigzag(value >> 1);
    format::store(out + done * sizeof(Index), static_cast<Index>(index));
  }
  state = last;
  data = from;
  return done;
}

class IndexStream final : public MeshoptStream {
 public:
  using MeshoptStream::MeshoptStream;

  uint64_t granularity() const override { return 1; }

  Result<void> unpack(MeshoptPlace& at, uint64_t first, std::span<std::byte> out) const override {
    const uint64_t count = out.size() / stated().stride;
    PieceReader data(source(), stated().offset + at.offset, end());
    IndexState state = load_state<IndexState>(at);
    for (uint64_t done = 0; done < count;) {
      SCREE_TRY(data.want(kMostIndexBytes));
      if (data.size() < kMostIndexBytes) return ends_early();
      const auto decode = stated().stride == 2 ? decode_indices<uint16_t> : decode_indices<uint32_t>;
      const std::byte* from = data.data();
      done += decode(state, count - done, from, data.data() + data.size() - kMostIndexBytes,
                     out.data() + done * stated().stride);
      data.skip(static_cast<size_t>(from - data.data()));
    }
    at.offset = data.offset() - stated().offset;
    format::store(at.state.data(), state);
    if (first + count == stated().count && at.offset + kTailBytes != stated().bytes) return has_more();
    return {};
  }

 private:
  Result<MeshoptPlace> start(uint32_t /*version*/) const override {
    if (stated().bytes < kTailBytes + 1 || stated().bytes - kTailBytes - 1 < stated().count) return ends_early();
    return MeshoptPlace{.offset = 1};
  }
};

}  // namespace

std::unique_ptr<const MeshoptStream> triangle_stream(const DocMeshopt& stated,
                                                     std::shared_ptr<const ByteSource> source) {
  return std::make_unique<TriangleStream>(stated, std::move(source));
}

std::unique_ptr<const MeshoptStream> index_stream(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source) {
  return std::make_unique<IndexStream>(stated, std::move(source));
}

}  // namespace scree::convert
