// The streams of texture coordinates, colours, normals, source numbers, second texture coordinates and tangents.
#include "format/geometry/attribute_codec.h"

#include <cmath>

#include "format/geometry/tangent_codec.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {
namespace {

void uvs(Parameters& in, uint32_t count) {
  format::UvRange range{.exponent = in.take<int16_t>()};
  for (int64_t& min : range.min) min = in.take<int64_t>();
  for (uint8_t& bits : range.bits) bits = in.take<uint8_t>();
  const ExactCopy stream(in.rest());
  std::vector<float> values(2 * size_t{count});
  const auto decoded = format::decode_uvs(values, range, stream.bytes());
  must(bool(decoded) == bool(format::check_uvs(count, range, stream.bytes())), "decode and check of uvs agree");
  if (decoded)
    for (const float value : values) must(std::isfinite(value), "a texture coordinate is finite");
}

void colors(Parameters& in, uint32_t count) {
  const ExactCopy stream(in.rest());
  std::vector<float> values(4 * size_t{count});
  const auto decoded = format::decode_colors(values, stream.bytes());
  must(bool(decoded) == bool(format::check_colors(count, stream.bytes())), "decode and check of colours agree");
  if (!decoded) return;
  std::vector<std::byte> again(format::color_stream_bytes(count));
  format::encode_colors(again, values);
  must(std::ranges::equal(again, stream.bytes()), "colours have one form");
}

void normals(Parameters& in, uint32_t count) {
  const uint32_t bits = in.take<uint8_t>();
  const ExactCopy stream(in.rest());
  std::vector<float> values(3 * size_t{count});
  const auto decoded = format::decode_normals(values, bits, stream.bytes());
  must(bool(decoded) == bool(format::check_normals(count, bits, stream.bytes())), "decode and check of normals agree");
  if (!decoded) return;
  for (uint32_t i = 0; i < count; ++i) {
    const float* const n = &values[3 * size_t{i}];
    must(std::fabs(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1) < 1e-5f, "a normal has unit length");
  }
}

void source_ids(Parameters& in, uint32_t count) {
  format::SourceIdRange range{.min = in.take<uint64_t>(), .bits = in.take<uint8_t>()};
  const ExactCopy stream(in.rest());
  std::vector<uint64_t> values(count);
  const auto decoded = format::decode_source_ids(values, range, stream.bytes());
  must(bool(decoded) == bool(format::check_source_ids(count, range, stream.bytes())), "decode and check of ids agree");
  if (!decoded) return;
  std::vector<std::byte> again(format::packed_bytes(count, range.bits));
  format::encode_source_ids(again, values, range);
  must(std::ranges::equal(again, stream.bytes()), "ids have one form");
}

void second_uvs(Parameters& in, uint32_t count) {
  uint8_t widths[2];
  for (uint8_t& bits : widths) bits = in.take<uint8_t>();
  const ExactCopy stream(in.rest());
  std::span<const std::byte> codes = stream.bytes();
  const auto range = format::open_second_uvs(widths, codes);
  if (!range) return;
  std::vector<float> values(2 * size_t{count});
  const auto decoded = format::decode_uvs(values, *range, codes);
  must(bool(decoded) == bool(format::check_uvs(count, *range, codes)), "decode and check of second uvs agree");
  if (!decoded) return;
  for (const float value : values) must(std::isfinite(value), "a texture coordinate is finite");
}

void tangents(Parameters& in, uint32_t count) {
  const uint32_t bits = in.take<uint8_t>(), seed = in.take<uint32_t>();
  std::vector<float> normals(3 * size_t{count}), values(4 * size_t{count});
  for (uint32_t i = 0; i < count; ++i)
    format::decode_octahedral((seed + i * 40503u) % 4095, (seed / 7 + i * 30011u) % 4095, 12, &normals[3 * size_t{i}]);
  const ExactCopy stream(in.rest());
  const auto decoded = format::decode_tangents(values, normals, bits, stream.bytes());
  must(bool(decoded) == bool(format::check_tangents(count, bits, stream.bytes())),
       "decode and check of tangents agree");
  if (!decoded) return;
  std::vector<std::byte> again(format::tangent_stream_bytes(count, bits));
  must(format::encode_tangents(again, values, normals, bits) == 0, "a decoded tangent has a direction");
  must(std::ranges::equal(again, stream.bytes()), "tangents have one form");
}

}  // namespace

void attribute_codec(Bytes bytes) {
  Parameters in(bytes);
  const uint32_t kind = in.take<uint8_t>() % 6, count = in.take<uint16_t>() % 2048;
  switch (kind) {
    case 0:
      return uvs(in, count);
    case 1:
      return colors(in, count);
    case 2:
      return normals(in, count);
    case 3:
      return source_ids(in, count);
    case 4:
      return second_uvs(in, count);
    default:
      return tangents(in, count);
  }
}

}  // namespace scree::fuzz
