// The depth pyramid: the farthest depth code of every square of 2, 4, 8, ... samples per side. A box is hidden if it is
// behind the codes of all squares that it touches. Source: Greene, Kass, Miller, Hierarchical Z-Buffer Visibility,
// 1993.
#pragma once

#include "kernels/raster/depth.h"
#include "kernels/raster/queues.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The samples that a box's triangles may cover, and the nearest depth code that they may have there.
struct ScreenBounds {
  PixelBox pixels;        // inside the image; not empty
  uint32_t nearest_code;  // 0 if unknown
};

/// Levels 1 to kPyramidLevels; one square of the last covers the largest image.
inline constexpr uint32_t kPyramidLevels = 14;
static_assert(kMaxImageSide <= 1u << kPyramidLevels);

/// Squares of 2^level samples per side, row by row. The last square of a row or column may cover fewer.
struct DepthPyramid {
  uint32_t* codes;
  uint64_t offset[kPyramidLevels + 1];  // index of each level's first code; 0 for absent levels
  int32_t width;                        // the image's
  int32_t height;

  SCREE_HD int32_t across(uint32_t level) const { return ((width - 1) >> level) + 1; }
  SCREE_HD int32_t down(uint32_t level) const { return ((height - 1) >> level) + 1; }
  SCREE_HD uint32_t* row(uint32_t level, int32_t y) const {
    return codes + offset[level] + static_cast<uint64_t>(y) * static_cast<uint64_t>(across(level));
  }
};

/// Lays out the levels from `first_level` (1 or more) on. Returns the number of codes.
SCREE_HD inline uint64_t lay_out(DepthPyramid& pyramid, int32_t width, int32_t height, uint32_t first_level = 1) {
  pyramid.width = width;
  pyramid.height = height;
  uint64_t count = 0;
  for (uint32_t level = 0; level < first_level; ++level) pyramid.offset[level] = 0;
  for (uint32_t level = first_level; level <= kPyramidLevels; ++level) {
    pyramid.offset[level] = count;
    count += static_cast<uint64_t>(pyramid.across(level)) * static_cast<uint64_t>(pyramid.down(level));
  }
  return count;
}

/// The code of a square, from the codes of the level below; level 2 and up.
SCREE_HD inline uint32_t code_from_below(const DepthPyramid& pyramid, uint32_t level, int32_t x, int32_t y) {
  const PixelBox below{2 * x, 2 * y, min_of(2 * x + 1, pyramid.across(level - 1) - 1),
                       min_of(2 * y + 1, pyramid.down(level - 1) - 1)};
  uint32_t farthest = 0;
  for (int32_t row = below.y0; row <= below.y1; ++row) {
    for (int32_t column = below.x0; column <= below.x1; ++column) {
      farthest = max_of(farthest, pyramid.row(level - 1, row)[column]);
    }
  }
  return farthest;
}

/// Fills a level (2 or up) from the one below. Thread `rank` of `size` fills its share.
SCREE_HD inline void fill_level(const DepthPyramid& pyramid, uint32_t level, int32_t rank, int32_t size) {
  const int32_t across = pyramid.across(level);
  const int32_t count = across * pyramid.down(level);
  for (int32_t i = rank; i < count; i += size)
    pyramid.row(level, i / across)[i % across] = code_from_below(pyramid, level, i % across, i / across);
}

/// Fills the pyramid from the samples of its image, by plain loops.
inline void build_pyramid(const DepthPyramid& pyramid, const uint64_t* samples) {
  for (int32_t y = 0; y < pyramid.down(1); ++y) {
    for (int32_t x = 0; x < pyramid.across(1); ++x) {
      uint32_t farthest = 0;
      for (int32_t row = 2 * y; row < min_of(2 * y + 2, pyramid.height); ++row) {
        const uint64_t* const from = samples + static_cast<uint64_t>(row) * static_cast<uint64_t>(pyramid.width);
        for (int32_t column = 2 * x; column < min_of(2 * x + 2, pyramid.width); ++column) {
          farthest = max_of(farthest, sample_depth_code(from[column]));
        }
      }
      pyramid.row(1, y)[x] = farthest;
    }
  }
  for (uint32_t level = 2; level <= kPyramidLevels; ++level) fill_level(pyramid, level, 0, 1);
}

/// The farthest code of the level's squares that `box` touches.
SCREE_HD inline uint32_t farthest_code(const DepthPyramid& pyramid, uint32_t level, const PixelBox& box) {
  uint32_t farthest = 0;
  for (int32_t y = box.y0 >> level; y <= box.y1 >> level; ++y) {
    const uint32_t* const row = pyramid.row(level, y);
    for (int32_t x = box.x0 >> level; x <= box.x1 >> level; ++x) farthest = max_of(farthest, row[x]);
  }
  return farthest;
}

/// True only if every sample of `box` has a depth code smaller than `nearest_code`. `samples`: those of the pyramid, or
/// nearer ones. Tests boxes of up to 2 x 2 samples against the samples. Tests other boxes against the first level on
/// which at most 2 x 2 squares cover the box; if that does not hide the box, against the level below.
SCREE_HD inline bool is_occluded(const DepthPyramid& pyramid, const uint64_t* samples, const PixelBox& box,
                                 uint32_t nearest_code) {
  const int32_t longest = max_of(box.x1 - box.x0, box.y1 - box.y0);
  if (longest <= 1) {
    const uint64_t* first = samples + static_cast<uint64_t>(box.y0) * static_cast<uint64_t>(pyramid.width);
    const uint64_t* second = samples + static_cast<uint64_t>(box.y1) * static_cast<uint64_t>(pyramid.width);
    const uint64_t a = max_of(first[box.x0], first[box.x1]);
    const uint64_t b = max_of(second[box.x0], second[box.x1]);
    return nearest_code > sample_depth_code(max_of(a, b));
  }
  uint32_t level = 1;
  while (longest >> level > 0) ++level;
  const uint32_t* const first = pyramid.row(level, box.y0 >> level);
  const uint32_t* const second = pyramid.row(level, box.y1 >> level);
  const uint32_t farthest = max_of(max_of(first[box.x0 >> level], first[box.x1 >> level]),
                                   max_of(second[box.x0 >> level], second[box.x1 >> level]));
  return nearest_code > farthest || nearest_code > farthest_code(pyramid, level - 1, box);
}

/// Whether every sample within the bounds is nearer, as the samples are now.
template <class Team>
SCREE_HD inline bool is_occluded_now(Team team, const Target& target, const ScreenBounds& bounds) {
  const PixelBox& box = bounds.pixels;
  for (int32_t y = box.y0; y <= box.y1; ++y) {
    const uint64_t* const row = target.row(y);
    for (int32_t x = box.x0; x <= box.x1; ++x) {
      if (bounds.nearest_code <= sample_depth_code(team.load_relaxed(row + x))) return false;
    }
  }
  return true;
}

/// True only if the samples hide all that lies within the bounds. Uses the levels from `first_level` on: squares of a
/// quarter of the box or larger, at most 5 x 5 of them.
SCREE_HD inline bool is_occluded_by_pyramid(const DepthPyramid& pyramid, uint32_t first_level,
                                            const ScreenBounds& bounds) {
  const PixelBox& pixels = bounds.pixels;
  const int32_t longest = max_of(pixels.x1 - pixels.x0, pixels.y1 - pixels.y0);
  uint32_t level = first_level;
  while (level < kPyramidLevels && longest >> level > 3) ++level;
  return bounds.nearest_code > farthest_code(pyramid, level, pixels);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
