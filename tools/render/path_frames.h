// Which frames of a path are drawn, and the names of their files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "format/result.h"

namespace scree::tools {

/// Every parts-th frame of [first, end), from first + part on: as near to each other in cost as parts of a path can be.
struct FrameRange {
  uint64_t first = 0;
  uint64_t end = UINT64_MAX;  // UINT64_MAX: the path's end
  uint64_t part = 0;          // below `parts`
  uint64_t parts = 1;

  uint64_t count() const {
    const uint64_t frames = end - first;
    return frames > part ? (frames - part - 1) / parts + 1 : 0;
  }
  /// `index`: below count().
  uint64_t frame(uint64_t index) const { return first + part + index * parts; }
  /// Part `index` of `count` of these frames.
  FrameRange share(uint64_t index, uint64_t count) const { return {first, end, part + parts * index, parts * count}; }
};

/// "0:600", "3/8" or "0:600,3/8": frames 0 to 599, and the third of eight shares of them, which count from 1. Errors
/// kUsage.
Result<FrameRange> parse_frame_range(std::string_view text);

/// A file name with the frame's number in it: %d, or %05d with zeros in front up to so many digits (1 to 19); %% is a
/// %.
class FramePattern {
 public:
  /// Errors kUsage, with the name of the option: not exactly one number, another use of %.
  static Result<FramePattern> parse(std::string_view option, const std::string& text);
  std::string name(uint64_t frame) const;

 private:
  std::string before_, after_;
  size_t digits_ = 1;
};

}  // namespace scree::tools
