#include "runtime/textures/texture.h"

#include <algorithm>
#include <cassert>
#include <span>
#include <utility>

#include "runtime/textures/mip_rows.h"
#include "runtime/textures/srgb.h"

namespace scree::runtime {
namespace {

void decode_row(const uint8_t* rgba, TexelCoding coding, std::vector<Texel>& out) {
  const Srgb& srgb = Srgb::tables();
  if (coding == TexelCoding::kNumbers) {
    for (size_t x = 0; x < out.size(); ++x, rgba += 4)
      for (size_t c = 0; c < 4; ++c) out[x][c] = static_cast<float>(rgba[c]) * (1.0f / 255.0f);
    return;
  }
  for (size_t x = 0; x < out.size(); ++x, rgba += 4)
    out[x] = {srgb.linear(rgba[0]), srgb.linear(rgba[1]), srgb.linear(rgba[2]),
              static_cast<float>(rgba[3]) * (1.0f / 255.0f)};
}

void encode_texels(std::span<const Texel> texels, TexelCoding coding, uint8_t* rgba) {
  const Srgb& srgb = Srgb::tables();
  for (const Texel& texel : texels) {
    for (size_t c = 0; c < 3; ++c)
      rgba[c] = coding == TexelCoding::kColor ? srgb.code(texel[c]) : code_of_number(texel[c]);
    rgba[3] = code_of_number(texel[3]);
    rgba += 4;
  }
}

}  // namespace

MipChain make_mips(Image image, TexelCoding coding) {
  assert(image.width >= 1 && image.height >= 1 && image.width <= kMaxDecodedSide && image.height <= kMaxDecodedSide);
  MipChain chain{
      .width = image.width, .height = image.height, .level_count = mip_level_count(image.width, image.height)};
  uint64_t texels = 0;
  for (uint32_t level = 0; level < chain.level_count; ++level) {
    chain.level_offset[level] = texels;
    texels += uint64_t{std::max(1u, image.width >> level)} * std::max(1u, image.height >> level);
  }
  chain.texels = std::move(image.rgba);
  chain.texels.resize(4 * texels);

  MipRows levels(chain.width, chain.height, chain.level_count - 1,
                 [&](uint32_t level, uint32_t y, std::span<const Texel> row) {
                   encode_texels(row, coding, chain.texels.data() + 4 * (chain.level_offset[level] + row.size() * y));
                 });
  std::vector<Texel> row(chain.width);
  for (uint32_t y = 0; y < chain.height; ++y) {
    decode_row(chain.texels.data() + uint64_t{4} * chain.width * y, coding, row);
    levels.push(row);
  }
  return chain;
}

kernels::TextureView texture_view(const MipChain& chain, const format::TextureRecord& record) {
  kernels::TextureView view{.texels = chain.texels.data()};
  std::copy(std::begin(chain.level_offset), std::end(chain.level_offset), std::begin(view.level_offset));
  view.width = chain.width;
  view.height = chain.height;
  view.level_count = chain.level_count;
  view.wrap_s = record.wrap_s;
  view.wrap_t = record.wrap_t;
  view.magnified_nearest = format::takes_nearest_texel(record.mag_filter);
  view.minified_nearest = format::takes_nearest_texel(record.min_filter);
  view.one_level = format::takes_nearest_level(record.min_filter);
  view.finest_level = format::takes_finest_level(record.min_filter);
  return view;
}

}  // namespace scree::runtime
