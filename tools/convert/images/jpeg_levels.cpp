#include "tools/convert/images/jpeg_levels.h"

#include <algorithm>
#include <new>
#include <optional>
#include <utility>

#include "format/container/mip_levels.h"
#include "format/jpeg/picture.h"
#include "runtime/images/jpeg_writer.h"
#include "runtime/textures/mip_rows.h"
#include "runtime/textures/srgb.h"
#include "tools/convert/images/jpeg_file.h"

namespace scree::convert {
namespace {

using runtime::JpegCoding;
using runtime::JpegWriter;
using runtime::MipRows;
using runtime::Srgb;
using runtime::Texel;
using runtime::TexelCoding;

/// A level's quantisation step: one and a half times the base level's. Small pictures have more detail per pixel; with
/// equal steps the levels would take half of the base level's bytes, instead of a third.
uint16_t coarser(uint16_t step) {
  const uint32_t most = step <= 255 ? 255 : 32767;  // 8-bit steps keep 8 bits; libjpeg writes no steps above 32767
  return static_cast<uint16_t>(std::min((3 * uint32_t{step} + 1) / 2, most));
}

/// The encoding options of the base level, adapted to a level.
JpegCoding coding_of(const format::JpegIndex& base, uint32_t level) {
  JpegCoding coding;
  coding.width = std::max(1u, uint32_t{base.width} >> level);
  coding.height = std::max(1u, uint32_t{base.height} >> level);
  coding.colour = base.colour;
  coding.components = base.components;
  coding.quant = base.quant;
  for (auto& table : coding.quant)
    for (uint16_t& value : table) value = coarser(value);
  uint32_t h = 1;
  uint32_t v = 1;
  for (const format::JpegComponent& component : coding.components) {
    h = std::max<uint32_t>(h, component.h);
    v = std::max<uint32_t>(v, component.v);
  }
  // libjpeg subsamples only by whole factors.
  for (format::JpegComponent& component : coding.components)
    if (h % component.h != 0 || v % component.v != 0) component.h = component.v = 0;
  if (std::any_of(coding.components.begin(), coding.components.end(), [](const auto& c) { return c.h == 0; }))
    for (format::JpegComponent& component : coding.components) component.h = component.v = 1;
  return coding;
}

Result<std::vector<std::vector<std::byte>>> make_or_throw(const format::JpegIndex& base, TexelCoding coding) {
  const uint32_t count = format::stored_level_count(base.width, base.height);
  if (count == 0) return std::vector<std::vector<std::byte>>{};
  const Srgb& srgb = Srgb::tables();
  const bool is_color = coding == TexelCoding::kColor;
  const bool is_grey = base.colour == format::JpegColour::kGrey;
  std::vector<JpegWriter> writers;
  for (uint32_t level = 1; level <= count; ++level) {
    writers.push_back(SCREE_TRY(JpegWriter::create(coding_of(base, level))));
  }
  std::optional<Error> failure;
  std::vector<uint8_t> codes;
  MipRows levels(base.width, base.height, count, [&](uint32_t level, uint32_t, std::span<const Texel> row) {
    codes.clear();
    for (const Texel& texel : row)
      for (size_t c = 0; c < (is_grey ? 1 : 3); ++c)
        codes.push_back(is_color ? srgb.code(texel[c]) : runtime::code_of_number(texel[c]));
    if (failure) return;
    if (const Result<void> written = writers[level - 1].row(codes); !written) failure = written.error();
  });
  std::vector<Texel> texels(base.width, Texel{0, 0, 0, 1});
  const auto decoded = format::decode_jpeg_rows(base, [&](uint32_t, std::span<const uint8_t> rgb) {
    for (size_t x = 0; x < texels.size(); ++x)
      for (size_t c = 0; c < 3; ++c)
        texels[x][c] = is_color ? srgb.linear(rgb[3 * x + c]) : static_cast<float>(rgb[3 * x + c]) * (1.0f / 255.0f);
    levels.push(texels);
  });
  if (!decoded) return decoded.error();
  if (failure) return *failure;

  std::vector<std::vector<std::byte>> indexed;
  for (JpegWriter& writer : writers) {
    const auto file = SCREE_TRY(writer.finish());
    auto level = SCREE_TRY(index_jpeg(file));
    indexed.push_back(std::move(level.bytes));
  }
  return indexed;
}

}  // namespace

Result<std::vector<std::vector<std::byte>>> make_jpeg_levels(const format::JpegIndex& base, TexelCoding coding) try {
  return make_or_throw(base, coding);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "JPEG: out of memory"};
}

}  // namespace scree::convert
