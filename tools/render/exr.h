// OpenEXR pictures: any number of named channels in one file.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// The type of a channel's values in memory and in the file.
enum class ExrType {
  kHalf,   // floats, stored with 16 bits
  kFloat,  // floats
  kUint,   // uint32_t
};

/// A channel of a picture. `data` points to the value of the first pixel; the next pixel's value is `stride` 32-bit
/// values further. Rows go from the top, without gaps.
struct ExrChannel {
  const char* name;  // "R", "Z", "N.X"
  ExrType type;
  const void* data;
  uint32_t stride;
};

/// Writes channels of width x height pixels, compressed without loss (ZIP). The file stores them in order of their
/// names. Errors kFile, kMemory, kUnsupported (the program was built without OpenEXR).
Result<void> write_exr(const std::string& path, uint32_t width, uint32_t height, std::span<const ExrChannel> channels,
                       format::Existing existing);

/// Returns the kUnsupported of write_exr() in advance, before anything is drawn.
Result<void> check_exr_support();

}  // namespace scree::tools
