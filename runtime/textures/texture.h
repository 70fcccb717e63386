// Decoded textures with their mip levels.
#pragma once

#include <cstdint>
#include <vector>

#include "format/layout.h"
#include "kernels/scene_view.h"
#include "runtime/images/image.h"
#include "runtime/textures/mip_rows.h"

namespace scree::runtime {

/// A picture and its mip levels down to 1 x 1, one after the other, in the layout of kernels::TextureView.
struct MipChain {
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t level_count = 0;
  uint64_t level_offset[kernels::TextureView::kMaxLevels] = {};  // texels
  std::vector<uint8_t> texels;                                   // RGBA8
};

/// Makes the levels of a picture of at most kMaxDecodedSide per side. A level is half the size of the level above,
/// rounded down. Each texel is the mean of the area that it covers in the level above: colour in linear light, numbers
/// and alpha as they are. For an odd side that area is two texels and a fraction, so that no column or row is lost and
/// the picture's mean stays the same. Levels are averaged in float, each rounded once. Throws std::bad_alloc.
MipChain make_mips(Image image, TexelCoding coding = TexelCoding::kColor);

/// The view of a chain for kernels, with a texture record's wrapping and filters.
kernels::TextureView texture_view(const MipChain& chain, const format::TextureRecord& record);

}  // namespace scree::runtime
