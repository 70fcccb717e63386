#include "tools/gltf/meshopt/stream.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "format/fail.h"

namespace scree::convert {
namespace {

using Mode = DocMeshopt::Mode;
using Filter = DocMeshopt::Filter;

struct ModeRule {
  const char* name;
  uint32_t header;   // high half of the stream's first byte; the low half is its version
  uint32_t version;  // the newest known
};

const ModeRule& rule_of(Mode mode) {
  static constexpr ModeRule kAttributes{"ATTRIBUTES", 0xa0, 1}, kTriangles{"TRIANGLES", 0xe0, 1},
      kIndices{"INDICES", 0xd0, 1};
  return mode == Mode::kAttributes ? kAttributes : mode == Mode::kTriangles ? kTriangles : kIndices;
}

/// Unit vectors from the two coordinates on an octahedron. The third component holds the code of 1. The meshoptimizer
/// of Debian rounds 8-bit vectors differently from the current version. Source: KHR_meshopt_compression, filter 1.
template <class Int>
void undo_octahedron(std::span<std::byte> elements) {
  for (size_t at = 0; at + 4 * sizeof(Int) <= elements.size(); at += 4 * sizeof(Int)) {
    std::array<Int, 4> element;
    std::memcpy(element.data(), elements.data() + at, sizeof(element));
    const float x = element[0], y = element[1], z = static_cast<float>(element[2]) - (std::abs(x) + std::abs(y));
    const float fold = std::min(z, 0.0f);
    const std::array<float, 3> unit = {x + (x >= 0 ? fold : -fold), y + (y >= 0 ? fold : -fold), z};
    // Adds in the same order as meshoptimizer, because 16-bit results depend on it.
    const float length = std::sqrt(unit[0] * unit[0] + (unit[1] * unit[1] + unit[2] * unit[2]));
    const float scale = length > 0 ? static_cast<float>(std::numeric_limits<Int>::max()) / length : 0;
    for (size_t i = 0; i < 3; ++i) element[i] = static_cast<Int>(std::lrint(unit[i] * scale));
    std::memcpy(elements.data() + at, element.data(), sizeof(element));
  }
}

/// Colours from luma, two differences and an alpha whose highest bit gives the number of bits. Source:
/// KHR_meshopt_compression, filter 4. A colour without that bit, which no writer makes, becomes 0.
template <class Int>
void undo_color(std::span<std::byte> elements) {
  using Unsigned = std::make_unsigned_t<Int>;
  for (size_t at = 0; at + 4 * sizeof(Int) <= elements.size(); at += 4 * sizeof(Int)) {
    std::array<Int, 4> in;
    std::memcpy(in.data(), elements.data() + at, sizeof(in));
    const uint32_t alpha = static_cast<Unsigned>(in[3]);
    const int bits = std::bit_width(alpha);
    const int largest = (1 << bits) - 1;
    const int y = static_cast<Unsigned>(in[0]), co = in[1], cg = in[2];
    const int a = static_cast<int>(alpha) & largest >> 1;
    const float scale =
        bits == 0 ? 0 : static_cast<float>(std::numeric_limits<Unsigned>::max()) / static_cast<float>(largest);
    std::array<Unsigned, 4> out;
    const std::array<int, 4> colour = {y + co - cg, y + cg, y - co - cg, a << 1 | (a & 1)};
    for (size_t i = 0; i < 4; ++i) out[i] = static_cast<Unsigned>(std::lrint(static_cast<float>(colour[i]) * scale));
    std::memcpy(elements.data() + at, out.data(), sizeof(out));
  }
}

}  // namespace

const char* mode_name(Mode mode) {
  return rule_of(mode).name;
}

std::unique_ptr<const MeshoptStream> MeshoptStream::make(const DocMeshopt& stated,
                                                         std::shared_ptr<const ByteSource> source) {
  if (stated.mode == Mode::kAttributes) return attribute_stream(stated, std::move(source));
  if (stated.mode == Mode::kTriangles) return triangle_stream(stated, std::move(source));
  return index_stream(stated, std::move(source));
}

Result<MeshoptPlace> MeshoptStream::begin() const {
  const ModeRule& rule = rule_of(stated_.mode);
  std::byte first{0};
  if (stated_.bytes > 0) SCREE_TRY(source_->read(stated_.offset, std::span(&first, 1)));
  const uint32_t header = std::to_integer<uint32_t>(first);
  if ((header & 0xf0) != rule.header) return Error{ErrorCode::kFormat, name() + ": not a stream of " + rule.name};
  const uint32_t version = header & 0x0f;
  if (version > rule.version)
    return fail(ErrorCode::kUnsupported, name(), ": ", rule.name, " of version ", version, ", but at most ",
                rule.version, " is read");
  return start(version);
}

void MeshoptStream::will_need(uint64_t first, uint64_t end) const {
  hint_part(0, first, end);
}

void MeshoptStream::hint_part(uint64_t begin, uint64_t first, uint64_t end) const {
  if (first >= end || begin >= stated_.bytes) return;
  // Floating point, because the product of two numbers from a file may exceed 64 bits.
  const double bytes = static_cast<double>(stated_.bytes - begin) / static_cast<double>(stated_.count);
  const uint64_t from = begin + static_cast<uint64_t>(bytes * static_cast<double>(first));
  const uint64_t to = begin + static_cast<uint64_t>(bytes * static_cast<double>(end)) + 1;
  source_->will_need(stated_.offset + from, to - from);
}

void MeshoptStream::undo_filter(std::span<std::byte> elements) const {
  const size_t count = elements.size() / stated_.stride;
  switch (stated_.filter) {
    case Filter::kNone:
      break;
    case Filter::kOctahedral:
      if (stated_.stride == 4)
        undo_octahedron<int8_t>(elements);
      else
        undo_octahedron<int16_t>(elements);
      break;
    case Filter::kQuaternion:
      meshopt_decodeFilterQuat(elements.data(), count, stated_.stride);
      break;
    case Filter::kExponential:
      meshopt_decodeFilterExp(elements.data(), count, stated_.stride);
      break;
    case Filter::kColor:
      if (stated_.stride == 4)
        undo_color<int8_t>(elements);
      else
        undo_color<int16_t>(elements);
      break;
  }
}

std::string MeshoptStream::name() const {
  return "buffer view " + std::to_string(stated_.view) + ": " + stated_.extension();
}

Error MeshoptStream::ends_early() const {
  return {ErrorCode::kTruncated, name() + ": " + std::to_string(stated_.bytes) + " bytes end before " +
                                     std::to_string(stated_.count) + " elements are unpacked"};
}

Error MeshoptStream::has_more() const {
  return {ErrorCode::kTrailing, name() + ": " + std::to_string(stated_.bytes) + " bytes do not unpack to " +
                                    std::to_string(stated_.count) + " elements"};
}

Result<void> PieceReader::want(size_t bytes) {
  if (size() >= bytes || is_at_end()) return {};
  const size_t rest = size();
  std::memmove(bytes_.data(), data(), rest);
  const uint64_t more = std::min<uint64_t>(kPieceBytes - rest, end_ - next_);
  first_ = 0;
  last_ = rest + more;
  SCREE_TRY(source_.read(next_, std::span(bytes_).subspan(rest, more)));
  next_ += more;
  return {};
}

}  // namespace scree::convert
