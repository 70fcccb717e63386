// FLIP: how visible the difference of two pictures is when a person flips between them. Own implementation from P.
// Andersson, J. Nilsson, T. Akenine-Moeller, M. Oskarsson, K. Astroem, M. D. Fairchild, "FLIP: A Difference Evaluator
// for Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020 (the low-dynamic-range variant). Means
// and maxima agree with the authors' program within 0.00002 (tests/tools/compare/test_flip.cpp).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::compare {

/// Pixels per degree of the visual field in the paper: at 0.7 m from a screen that is 0.7 m and 3840 pixels wide.
inline constexpr double kPixelsPerDegree = 67.02064327658225;

/// An opaque picture: 3 bytes per pixel, sRGB, rows top to bottom.
struct RgbView {
  uint32_t width = 0;
  uint32_t height = 0;
  std::span<const uint8_t> rgb;
};

/// The error of every pixel, 0 (invisible) to 1, rows top to bottom. Both pictures must have the same size, at least 1
/// x 1; `pixels_per_degree` > 0. The result is symmetric in the pictures, and the same for any number of threads. Takes
/// about 60 bytes per pixel; throws std::bad_alloc.
std::vector<float> flip_map(const RgbView& test, const RgbView& reference, double pixels_per_degree, uint32_t threads);

}  // namespace scree::compare
