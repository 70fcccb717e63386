#include "lab/frames/picture_error.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace scree::lab {

PictureError compare_pictures(const kernels::View& view, const HostPicture& picture, const HostPicture& reference) {
  assert(picture.samples.size() == reference.samples.size() && picture.pixels.size() == reference.pixels.size());
  PictureError error;
  uint64_t wrong_pixels = 0;
  double squares = 0;
  uint64_t both = 0;
  for (size_t i = 0; i < picture.samples.size(); ++i) {
    const uint64_t a = picture.samples[i];
    const uint64_t b = reference.samples[i];
    if (kernels::sample_id(a) != kernels::sample_id(b)) ++wrong_pixels;
    if (a == kernels::kBackground || b == kernels::kBackground) continue;
    const double expected = kernels::depth_of_code(view, kernels::sample_depth_code(b));
    const double found = kernels::depth_of_code(view, kernels::sample_depth_code(a));
    const double relative = std::fabs(found - expected) / expected;
    error.depth_error_max = std::max(error.depth_error_max, relative);
    squares += relative * relative;
    ++both;
  }
  error.wrong_pixels = wrong_pixels;
  if (both != 0) error.depth_error_rms = std::sqrt(squares / static_cast<double>(both));

  double color_squares = 0;
  uint64_t channels = 0;
  for (size_t i = 0; i < picture.pixels.size(); ++i) {
    if (i % 4 == 3) continue;  // alpha
    const double difference = static_cast<double>(picture.pixels[i]) - static_cast<double>(reference.pixels[i]);
    color_squares += difference * difference;
    ++channels;
  }
  const double mean = channels == 0 ? 0 : color_squares / static_cast<double>(channels);
  error.psnr_db = mean == 0 ? std::numeric_limits<double>::infinity() : 10 * std::log10(255.0 * 255.0 / mean);
  return error;
}

}  // namespace scree::lab
