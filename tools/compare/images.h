// Two pictures: how far their pixels lie apart, in levels and to the eye.
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
  uint64_t differing = 0;   // pixels
  uint32_t max_levels = 0;  // largest difference of a byte
  double psnr = 0;          // decibels over red, green and blue; infinite where no pixel differs
  std::vector<float> flip;  // flip_map()
  double flip_mean = 0;
  double flip_max = 0;
};

/// Reads two PNG or JPEG pictures and compares A with B, which counts as the right one. Pixels that are not opaque are
/// laid over black, in coded values. Errors: those of MappedFile::open and decode_image, the file named; kRange where
/// the sizes differ.
Result<PictureReport> compare_pictures(const std::string& a, const std::string& b, double pixels_per_degree,
                                       uint32_t threads);

/// The same of two pictures of one size in memory. Throws std::bad_alloc.
PictureReport compare_rgb(const RgbView& a, const RgbView& b, double pixels_per_degree, uint32_t threads);

/// Writes the FLIP error of every pixel as a grey: black 0, white 1. Errors kFile.
Result<void> write_flip(const std::string& path, const PictureReport& report,
                        format::Existing existing = format::Existing::kReplace);

}  // namespace scree::compare
