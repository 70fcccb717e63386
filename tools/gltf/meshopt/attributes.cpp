// Mode ATTRIBUTES, versions 0 and 1.
// - A byte of header is followed by blocks of vertices. A block stores its vertices byte by byte: byte 0 of all
//   vertices, then byte 1 of all, and so on. The codes of a byte form groups of 16. Two bits per group, which give the
//   width of its codes, precede the groups.
// - In version 1 a block begins with two bits per byte of a vertex, the control of that byte. Every four bytes of a
//   vertex (a channel) have a mode, which defines how codes become differences to the previous vertex.
// - The stream ends with the vertex to which the first one is coded as a difference, followed by these modes.
// Source: KHR_meshopt_compression, appendix A.
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "format/bytes.h"
#include "format/fail.h"
#include "tools/gltf/meshopt/stream.h"

namespace scree::convert {
namespace {

constexpr size_t kGroupVertices = 16;
// 16 codes of 4 bits and a whole byte for each. Reading any group requires this many bytes.
constexpr size_t kMostGroupBytes = 24;
constexpr size_t kMostBlockVertices = 256;
constexpr size_t kMostBlockBytes = 8192;  // unpacked
constexpr size_t kMostStride = 256;

enum Control : uint32_t { kNarrow, kWide, kZero, kLiteral, kVersion0 };

// Bits of a code, by the control and the two bits of its group.
constexpr uint8_t kWidths[5][4] = {{0, 1, 2, 4}, {1, 2, 4, 8}, {}, {}, {0, 2, 4, 8}};

enum ChannelMode : uint32_t { kByteDeltas, kShortDeltas, kWordXor, kChannelModes };

using Bytes16 = uint8_t __attribute__((vector_size(16)));
using Shorts8 = uint16_t __attribute__((vector_size(16)));
using Words4 = uint32_t __attribute__((vector_size(16)));

template <class Vector>
Vector load(const void* from) {
  Vector vector;
  std::memcpy(&vector, from, sizeof(vector));
  return vector;
}

/// The four codes of two bits in a byte, the highest bits first.
constexpr std::array<uint32_t, 256> two_bit_codes() {
  std::array<uint32_t, 256> table{};
  for (uint32_t byte = 0; byte < 256; ++byte)
    table[byte] = byte >> 6 | (byte >> 4 & 3) << 8 | (byte >> 2 & 3) << 16 | (byte & 3) << 24;
  return table;
}

/// Bit i is set if byte i is not 0. Each byte is 0 or 0xff.
uint32_t set_bytes(Bytes16 bytes) {
  uint64_t halves[2];
  std::memcpy(halves, &bytes, sizeof(halves));
  const auto gathered = [](uint64_t half) {
    return static_cast<uint32_t>((half & 0x0101010101010101) * 0x0102040810204080 >> 56);
  };
  return gathered(halves[0]) | gathered(halves[1]) << 8;
}

/// Writes the bytes from `rest` on over the codes marked in `escapes`. Returns the address after them.
const std::byte* put_escaped(uint32_t escapes, const std::byte* rest, std::byte* codes) {
  for (; escapes != 0; escapes &= escapes - 1) codes[std::countr_zero(escapes)] = *rest++;
  return rest;
}

/// Reads a group of 16 codes; kMostGroupBytes must be readable. Returns the address after it. The highest code of 1, 2
/// or 4 bits is an escape: the value is a whole byte after the group.
const std::byte* read_group(uint32_t width, const std::byte* group, std::byte* codes) {
  static constexpr std::array<uint32_t, 256> kTwoBitCodes = two_bit_codes();
  switch (width) {
    case 0:
      std::memset(codes, 0, kGroupVertices);
      return group;
    case 1:
      std::memset(codes, 0, kGroupVertices);
      return put_escaped(format::load<uint16_t>(group), group + 2, codes);
    case 2: {
      uint32_t words[4];
      for (size_t i = 0; i < 4; ++i) words[i] = kTwoBitCodes[std::to_integer<size_t>(group[i])];
      std::memcpy(codes, words, kGroupVertices);
      return put_escaped(set_bytes(load<Bytes16>(words) == 3), group + 4, codes);
    }
    case 4: {
      Bytes16 pairs{};
      std::memcpy(&pairs, group, 8);
      const Bytes16 high = pairs >> 4, low = pairs & 15;
      const Bytes16 both = __builtin_shufflevector(high, low, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
      std::memcpy(codes, &both, kGroupVertices);
      return put_escaped(set_bytes(both == 15), group + 8, codes);
    }
    default:
      std::memcpy(codes, group, kGroupVertices);
      return group + kGroupVertices;
  }
}

/// Reads the codes of one byte of `vertices` vertices from [at, end); `codes` has room for whole groups. Returns the
/// address after them, or null if the stream ends too early.
const std::byte* read_codes(Control control, size_t vertices, const std::byte* at, const std::byte* end,
                            std::byte* codes) {
  const size_t groups = (vertices + kGroupVertices - 1) / kGroupVertices;
  const auto available = [&] { return static_cast<size_t>(end - at); };
  if (control == kZero) {
    std::memset(codes, 0, groups * kGroupVertices);
    return at;
  }
  if (control == kLiteral) {
    if (available() < vertices) return nullptr;
    std::memcpy(codes, at, vertices);
    std::memset(codes + vertices, 0, groups * kGroupVertices - vertices);
    return at + vertices;
  }
  const size_t width_bytes = (groups + 3) / 4;
  if (available() < width_bytes) return nullptr;
  const std::byte* const widths = at;
  at += width_bytes;
  for (size_t group = 0; group < groups; ++group) {
    if (available() < kMostGroupBytes) return nullptr;
    const uint32_t width = std::to_integer<uint32_t>(widths[group / 4]) >> group % 4 * 2 & 3;
    at = read_group(kWidths[control][width], at, codes + group * kGroupVertices);
  }
  return at;
}

template <ChannelMode kMode>
using Lanes =
    std::conditional_t<kMode == kByteDeltas, Bytes16, std::conditional_t<kMode == kShortDeltas, Shorts8, Words4>>;

/// Four differences from their codes, one per word. `turn`: for kWordXor, the bits by which a difference was rotated to
/// the left.
template <ChannelMode kMode>
Words4 differences(Words4 words, uint32_t turn) {
  if constexpr (kMode == kWordXor) {
    return words >> turn | words << ((32 - turn) & 31);
  } else {
    const auto codes = reinterpret_cast<Lanes<kMode>>(words);
    return reinterpret_cast<Words4>((codes >> 1) ^ -(codes & 1));
  }
}

template <ChannelMode kMode>
Words4 sum(Words4 a, Words4 b) {
  if constexpr (kMode == kWordXor) return a ^ b;
  return reinterpret_cast<Words4>(reinterpret_cast<Lanes<kMode>>(a) + reinterpret_cast<Lanes<kMode>>(b));
}

/// Codes of four bytes of a block's vertices.
using Planes = std::array<std::array<std::byte, kMostBlockVertices>, 4>;

/// Decodes these four bytes of every vertex and writes them `stride` apart. `before`: the four bytes of the previous
/// vertex.
template <ChannelMode kMode>
void write_channel(const Planes& codes, size_t vertices, uint32_t turn, const std::byte* before, size_t stride,
                   std::byte* out) {
  Words4 last = Words4{} + format::load<uint32_t>(before);
  for (size_t first = 0; first < vertices; first += kGroupVertices) {
    const auto a = load<Bytes16>(codes[0].data() + first), b = load<Bytes16>(codes[1].data() + first),
               c = load<Bytes16>(codes[2].data() + first), d = load<Bytes16>(codes[3].data() + first);
    const auto low = [](auto x, auto y) {
      return __builtin_shufflevector(x, y, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
    };
    const auto high = [](auto x, auto y) {
      return __builtin_shufflevector(x, y, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
    };
    const auto low_pairs = [](Bytes16 x, Bytes16 y) {
      return reinterpret_cast<Words4>(__builtin_shufflevector(reinterpret_cast<Shorts8>(x),
                                                              reinterpret_cast<Shorts8>(y), 0, 8, 1, 9, 2, 10, 3, 11));
    };
    const auto high_pairs = [](Bytes16 x, Bytes16 y) {
      return reinterpret_cast<Words4>(__builtin_shufflevector(
          reinterpret_cast<Shorts8>(x), reinterpret_cast<Shorts8>(y), 4, 12, 5, 13, 6, 14, 7, 15));
    };
    const Bytes16 ab = low(a, b), cd = low(c, d), ab_high = high(a, b), cd_high = high(c, d);
    Words4 group[4] = {low_pairs(ab, cd), high_pairs(ab, cd), low_pairs(ab_high, cd_high),
                       high_pairs(ab_high, cd_high)};
    for (Words4& words : group) {
      const Words4 none{};
      words = differences<kMode>(words, turn);
      words = sum<kMode>(words, __builtin_shufflevector(none, words, 0, 4, 5, 6));
      words = sum<kMode>(words, __builtin_shufflevector(none, words, 0, 1, 4, 5));
      words = sum<kMode>(words, last);
      last = __builtin_shufflevector(words, words, 3, 3, 3, 3);
    }
    if (vertices - first >= kGroupVertices) {
      for (size_t i = 0; i < kGroupVertices; ++i, out += stride) {
        const uint32_t word = group[i / 4][i % 4];
        std::memcpy(out, &word, sizeof(word));
      }
    } else {
      uint32_t words[kGroupVertices];
      std::memcpy(words, group, sizeof(words));
      for (size_t i = 0; i < vertices - first; ++i, out += stride) std::memcpy(out, words + i, sizeof(words[i]));
    }
  }
}

/// Layout of MeshoptPlace::state: the previous vertex, then `stride / 4` modes of channels, and the version at the end.
constexpr size_t kVersionAt = kMostStride + kMostStride / 4;
static_assert(kVersionAt < sizeof(MeshoptPlace::state));

/// Reads a block of `vertices` vertices from [at, end) to `out`. Returns the address after it, or null if the stream
/// ends too early. `state` as above; its vertex is not changed.
const std::byte* read_block(const std::byte* at, const std::byte* end, size_t vertices, size_t stride,
                            const std::byte* state, std::byte* out) {
  const bool has_controls = state[kVersionAt] != std::byte{0};
  const std::byte* const controls = at;
  if (has_controls) {
    if (static_cast<size_t>(end - at) < stride / 4) return nullptr;
    at += stride / 4;
  }
  Planes codes;  // left uninitialised; whole groups of it are read
  for (size_t channel = 0; channel < stride / 4; ++channel) {
    for (size_t byte = 0; byte < 4; ++byte) {
      const uint32_t control = std::to_integer<uint32_t>(controls[channel]) >> 2 * byte & 3;
      at = read_codes(has_controls ? static_cast<Control>(control) : kVersion0, vertices, at, end, codes[byte].data());
      if (at == nullptr) return nullptr;
    }
    const std::byte* const before = state + 4 * channel;
    std::byte* const to = out + 4 * channel;
    const uint32_t mode = has_controls ? std::to_integer<uint32_t>(state[stride + channel]) : 0;
    if ((mode & 15) == kByteDeltas) write_channel<kByteDeltas>(codes, vertices, 0, before, stride, to);
    if ((mode & 15) == kShortDeltas) write_channel<kShortDeltas>(codes, vertices, 0, before, stride, to);
    if ((mode & 15) == kWordXor) write_channel<kWordXor>(codes, vertices, mode >> 4, before, stride, to);
  }
  return at;
}

class AttributeStream final : public MeshoptStream {
 public:
  AttributeStream(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source)
      : MeshoptStream(stated, std::move(source)),
        stride_(stated.stride),
        block_vertices_(std::min(kMostBlockVertices, kMostBlockBytes / stride_ & ~(kGroupVertices - 1))) {
    const size_t groups = block_vertices_ / kGroupVertices;
    most_block_bytes_ = stride_ / 4 + stride_ * ((groups + 3) / 4 + kMostGroupBytes * groups);
  }

  uint64_t granularity() const override { return block_vertices_; }

  Result<void> unpack(MeshoptPlace& at, uint64_t first, std::span<std::byte> out) const override {
    PieceReader piece(source(), stated().offset + at.offset, end());
    const uint64_t count = out.size() / stride_;
    std::byte* to = out.data();
    for (uint64_t done = 0; done < count;) {
      SCREE_TRY(piece.want(most_block_bytes_));
      const size_t vertices = std::min<uint64_t>(block_vertices_, count - done);
      const std::byte* const behind =
          read_block(piece.data(), piece.data() + piece.size(), vertices, stride_, at.state.data(), to);
      if (behind == nullptr) return ends_early();
      piece.skip(static_cast<size_t>(behind - piece.data()));
      done += vertices;
      to += vertices * stride_;
      std::memcpy(at.state.data(), to - stride_, stride_);
    }
    at.offset = piece.offset() - stated().offset;
    const uint64_t tail = at.state[kVersionAt] == std::byte{0} ? std::max<uint64_t>(32, stride_)
                                                               : std::max<uint64_t>(24, stride_ + stride_ / 4);
    if (first + count == stated().count && at.offset + tail != stated().bytes) return has_more();
    return {};
  }

 private:
  Result<MeshoptPlace> start(uint32_t version) const override {
    const uint64_t channels = version == 0 ? 0 : stride_ / 4;
    if (stated().bytes < 1 + stride_ + channels) return ends_early();
    MeshoptPlace at{};
    at.offset = 1;
    at.state[kVersionAt] = static_cast<std::byte>(version);
    const auto tail = std::span(at.state).first(stride_ + channels);
    SCREE_TRY(source().read(end() - tail.size(), tail));
    for (uint64_t channel = 0; channel < channels; ++channel) {
      const uint32_t mode = std::to_integer<uint32_t>(tail[stride_ + channel]);
      if ((mode & 15) >= kChannelModes || ((mode & 15) != kWordXor && mode >> 4 != 0))
        return fail(ErrorCode::kFormat, name(), ": channel ", channel, " has mode ", mode, ", which does not exist");
    }
    return at;
  }

  const uint64_t stride_;
  const size_t block_vertices_;
  size_t most_block_bytes_;
};

}  // namespace

std::unique_ptr<const MeshoptStream> attribute_stream(const DocMeshopt& stated,
                                                      std::shared_ptr<const ByteSource> source) {
  return std::make_unique<AttributeStream>(stated, std::move(source));
}

}  // namespace scree::convert
