// Compares two pictures of the same view: by triangle, by depth, by colour.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/frame.h"
#include "lab/report/case_result.h"

namespace scree::lab {

/// A frame on the host.
struct HostPicture {
  std::vector<uint64_t> samples;  // the visibility buffer
  std::vector<uint8_t> pixels;    // RGBA8, sRGB-coded, 4 bytes per pixel
};

/// Compares `picture` with `reference`, both of `view`. Leaves the position error 0.
PictureError compare_pictures(const kernels::View& view, const HostPicture& picture, const HostPicture& reference);

}  // namespace scree::lab
