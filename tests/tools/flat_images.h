// Pictures of one colour and any size. They are written without being held in memory.
#pragma once

#include <cstdint>
#include <string>

namespace scree::tests {

enum class JpegKind { kBaseline, kProgressive };

/// A mid-grey JPEG of three components without subsampling. `side`: a multiple of 64, below 65536.
std::string flat_jpeg(uint32_t side, JpegKind kind);

/// A black 8-bit grey PNG, in order or interlaced (Adam7).
void write_flat_png(const std::string& path, uint32_t side, bool is_interlaced);

}  // namespace scree::tests
