// Shared by the readers of the headers of KTX2 and DDS files.
#pragma once

#include <cstdint>
#include <string>

#include "format/blocks/format.h"
#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::runtime {

/// The swizzle of pixels stored as blue, green, red, alpha.
inline constexpr uint16_t kReversedSwizzle =
    format::make_swizzle(format::ChannelSource::kBlue, format::ChannelSource::kGreen, format::ChannelSource::kRed,
                         format::ChannelSource::kAlpha);

/// Makes the errors of one of the two readers. Messages begin with the format's name.
struct BlockHeadErrors {
  const char* kind;     // "KTX2"
  const char* way_out;  // advice for unsupported files

  Error fail(ErrorCode code, const std::string& what) const { return {code, std::string(kind) + ": " + what}; }
  Error not_read(const std::string& what) const { return fail(ErrorCode::kUnsupported, what + ", " + way_out); }
};

/// The little-endian number at `offset`; bytes past the end are 0.
inline uint32_t word_of(ImageFile& file, uint64_t offset) {
  uint32_t value = 0;
  for (uint32_t i = 0; i < 4; ++i) value |= file.byte(offset + i) << 8 * i;
  return value;
}

}  // namespace scree::runtime
