// Turns any JPEG file into an indexed JPEG (spec/codecs.md, indexed JPEG).
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::convert {

struct IndexedJpeg {
  std::vector<std::byte> bytes;  // for format::open_jpeg_index
  std::string note;              // if the file could not be indexed unchanged: the reason, and what was done; else
                                 // empty
};

inline constexpr int kReencodeQuality = 95;  // for pictures that are decoded and encoded again: CMYK

/// Indexes `file`: unchanged if format::encode_jpeg_index accepts it; transcoded with the same coefficients if it is
/// progressive, arithmetic or of several scans; encoded again if it is CMYK (kReencodeQuality). Decodes the whole file:
/// damage or an early end is an error that names the byte. Takes twice the file's size of memory, and the memory of
/// transcode_jpeg or reencode_jpeg if it calls them. Errors kFormat, kTruncated, kRange, kUnsupported, kMemory.
/// Reentrant.
Result<IndexedJpeg> index_jpeg(std::span<const std::byte> file);

}  // namespace scree::convert
