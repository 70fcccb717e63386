// Any JPEG file as an indexed JPEG (spec/codecs.md, indexed JPEG).
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::runtime {

struct IndexedJpeg {
  std::vector<std::byte> bytes;  // what format::open_jpeg_index opens
  std::string note;              // where the file could not be indexed as it is: why, and what was done; else empty
};

inline constexpr int kReencodeQuality = 95;  // of what is decoded and coded anew: CMYK

/// Indexes `file`: as it is where format::encode_jpeg_index takes it, transcoded with the same coefficients where it is
/// progressive, arithmetic or of several scans, coded anew where it is CMYK (kReencodeQuality). Decodes all of it on
/// the way: a file that is damaged or ends early is an error, with the byte. Takes memory for the file's size twice,
/// and what transcode_jpeg and reencode_jpeg say where they are needed. Errors kFormat, kTruncated, kRange,
/// kUnsupported, kMemory. Reentrant.
Result<IndexedJpeg> index_jpeg(std::span<const std::byte> file);

}  // namespace scree::runtime
