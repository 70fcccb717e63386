// Mode ATTRIBUTES, version 0. Behind a byte of header there are blocks of vertices; a block holds, for each byte of a
// vertex in turn, that byte of all its vertices as deltas to the vertex before, in groups of 16: first two bits for
// each group, its bit-width, then the groups. At the end lies the vertex before the first. So a run of blocks with the
// vertex before it is a stream as well, which the library unpacks; only where blocks end is found out here.
#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>

#include "format/bytes.h"
#include "tools/gltf/meshopt_stream.h"

namespace scree::convert {
namespace {

constexpr size_t kGroupVertices = 16;
// Of 4 bits each, and a whole byte for each; as many must be there for any group.
constexpr size_t kMostGroupBytes = 24;
constexpr size_t kMostBlockVertices = 256;
constexpr size_t kMostBlockBytes = 8192;  // unpacked
constexpr size_t kLeastTailBytes = 32;
constexpr std::byte kHeader{0xa0};

/// Bytes of a group of that bit-width: 0, 2, 4 or 8 bits for `width` 0 to 3. At least 8 bytes are there. Of 2 and 4
/// bits the highest value says that a whole byte follows the group. Without a branch, since widths are hard to predict.
size_t group_bytes(uint32_t width, const std::byte* group) {
  static constexpr size_t kBytes[4] = {0, 4, 8, 16};
  static constexpr uint64_t kLowest2[4] = {0, 0x55555555, 0, 0}, kLowest4[4] = {0, 0, 0x1111111111111111, 0};
  const uint64_t bits = format::load<uint64_t>(group);
  const uint64_t pairs = bits & bits >> 1;
  uint64_t ones = (pairs & kLowest2[width]) | (pairs & pairs >> 2 & kLowest4[width]);  // one for each highest value
  ones = (ones & 0x3333333333333333) + (ones >> 2 & 0x3333333333333333);
  ones = (ones + (ones >> 4)) & 0x0f0f0f0f0f0f0f0f;
  return kBytes[width] + (ones * 0x0101010101010101 >> 56);
}

/// Bytes of a block; none where it takes more than `available`, or leaves fewer than the library wants to see.
std::optional<size_t> block_bytes(const std::byte* block, size_t available, uint64_t stride, size_t groups) {
  const size_t width_bytes = (groups + 3) / 4;
  size_t at = 0;
  for (uint64_t byte = 0; byte < stride; ++byte) {
    if (available - at < width_bytes) return std::nullopt;
    const std::byte* const widths = block + at;
    at += width_bytes;
    for (size_t group = 0; group < groups; ++group) {
      if (available - at < kMostGroupBytes) return std::nullopt;
      at += group_bytes(std::to_integer<uint32_t>(widths[group / 4]) >> group % 4 * 2 & 3, block + at);
    }
  }
  return at;
}

class AttributeStream final : public MeshoptStream {
 public:
  AttributeStream(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source)
      : MeshoptStream(stated, std::move(source)),
        stride_(stated.stride),
        block_vertices_(std::min(kMostBlockVertices, kMostBlockBytes / stride_ & ~(kGroupVertices - 1))),
        tail_bytes_(std::max<uint64_t>(kLeastTailBytes, stride_)) {
    const size_t groups = block_vertices_ / kGroupVertices;
    most_block_bytes_ = stride_ * ((groups + 3) / 4 + kMostGroupBytes * groups);
  }

  uint64_t granularity() const override { return block_vertices_; }

  Result<void> unpack(MeshoptPlace& at, uint64_t first, std::span<std::byte> out) const override {
    PieceReader piece(source(), stated().offset + at.offset, end());
    const uint64_t count = out.size() / stride_;
    std::byte* to = out.data();
    for (uint64_t done = 0; done < count;) {
      if (auto read = piece.want(most_block_bytes_); !read) return read;
      size_t bytes = 0, vertices = 0;
      while (done + vertices < count && (piece.is_at_end() || piece.size() - bytes >= most_block_bytes_)) {
        const size_t of_block = std::min<uint64_t>(block_vertices_, count - done - vertices);
        const auto more = block_bytes(piece.data() + bytes, piece.size() - bytes, stride_,
                                      (of_block + kGroupVertices - 1) / kGroupVertices);
        if (!more) return ends_early();
        bytes += *more;
        vertices += of_block;
      }
      if (!unpack_blocks(piece, bytes, at.state.data(), vertices, to)) return has_more();
      piece.skip(bytes);
      done += vertices;
      to += vertices * stride_;
      std::memcpy(at.state.data(), to - stride_, stride_);
    }
    at.offset = piece.offset() - stated().offset;
    if (first + count == stated().count && at.offset + tail_bytes_ != stated().bytes) return has_more();
    return {};
  }

 private:
  Result<MeshoptPlace> start(uint32_t /*version*/) const override {
    if (stated().bytes < 1 + stride_) return ends_early();
    MeshoptPlace at{};
    at.offset = 1;
    if (auto read = source().read(end() - stride_, std::span(at.state).first(stride_)); !read) return read.error();
    return at;
  }

  /// The first bytes of the piece, as a stream of their own; `before`: the vertex before them.
  bool unpack_blocks(PieceReader& piece, size_t bytes, const std::byte* before, size_t vertices, std::byte* out) const {
    static_assert(PieceReader::kRoomBefore >= 1 && PieceReader::kRoomBehind >= 256);
    std::byte* const stream = piece.data() - 1;
    std::byte* const tail = piece.data() + bytes;
    std::array<std::byte, PieceReader::kRoomBehind> kept;
    std::memcpy(kept.data(), tail, tail_bytes_);
    *stream = kHeader;
    std::memset(tail, 0, tail_bytes_ - stride_);
    std::memcpy(tail + tail_bytes_ - stride_, before, stride_);
    const int status = meshopt_decodeVertexBuffer(
        out, vertices, stride_, reinterpret_cast<const unsigned char*>(stream), 1 + bytes + tail_bytes_);
    std::memcpy(tail, kept.data(), tail_bytes_);
    return status == 0;
  }

  const uint64_t stride_;
  const size_t block_vertices_;
  const uint64_t tail_bytes_;
  size_t most_block_bytes_;
};

}  // namespace

std::unique_ptr<const MeshoptStream> attribute_stream(const DocMeshopt& stated,
                                                      std::shared_ptr<const ByteSource> source) {
  return std::make_unique<AttributeStream>(stated, std::move(source));
}

}  // namespace scree::convert
