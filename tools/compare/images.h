// Compares two pictures: differences of bytes, PSNR and FLIP.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"
#include "tools/compare/flip.h"

namespace scree::compare {

struct PictureReport {
  uint32_t width = 0;
  uint32_t height = 0;
  uint64_t differing = 0;    // pixels
  uint64_t other_alpha = 0;  // pixels whose alpha differs, which all other numbers ignore
  uint32_t max_levels = 0;   // largest difference of a byte
  double psnr = 0;           // decibels over red, green and blue; infinite if no pixel differs
  std::vector<float> flip;   // flip_map()
  double flip_mean = 0;
  double flip_max = 0;
};

/// Reads two PNG or JPEG pictures and compares A with B, which counts as right. Pixels that are not opaque are blended
/// over black, in sRGB codes; other_alpha counts where this hides a difference. Errors name the file: those of
/// MappedFile::open and decode_image; kRange if the sizes differ.
Result<PictureReport> compare_pictures(const std::string& a, const std::string& b, double pixels_per_degree,
                                       uint32_t threads);

/// The same for two pictures of the same size in memory. Throws std::bad_alloc.
PictureReport compare_rgb(const RgbView& a, const RgbView& b, double pixels_per_degree, uint32_t threads);

/// Writes the FLIP error of every pixel as a grey: black 0, white 1. Errors kFile.
Result<void> write_flip(const std::string& path, const PictureReport& report,
                        format::Existing existing = format::Existing::kReplace);

}  // namespace scree::compare
