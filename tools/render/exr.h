// OpenEXR pictures: any number of named channels in one file.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// What a channel holds per pixel, and how the file stores it.
enum class ExrType {
  kHalf,   // floats, stored with 16 bits
  kFloat,  // floats
  kUint,   // uint32_t
};

/// A channel of a picture: `data` points at its value of the first pixel, and `stride` values of 32 bits lie from a
/// pixel to the next, rows from the top without gaps.
struct ExrChannel {
  const char* name;  // "R", "Z", "N.X"
  ExrType type;
  const void* data;
  uint32_t stride;
};

/// Writes channels of width x height pixels, compressed without loss (ZIP), in order of their names as the format has
/// it. Errors kFile, kMemory, kUnsupported (the program was
/// built without OpenEXR).
Result<void> write_exr(const std::string& path, uint32_t width, uint32_t height, std::span<const ExrChannel> channels,
                       format::Existing existing);

/// Errors kUnsupported, as write_exr(): for those who would draw first.
Result<void> check_exr_support();

}  // namespace scree::tools
