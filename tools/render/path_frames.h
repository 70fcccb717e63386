// The frames of a path that are drawn, and the names of their files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "format/result.h"

namespace scree::tools {

/// Every parts-th frame of [first, end), from first + part on. Parts chosen like this take about equally long.
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
};

/// The rank below `ranks` to whose host frame `index` of `frames` frames belongs. A rank has runs of about eight
/// neighbouring frames or more, because a GPU draws faster if the camera has moved little. All ranks have as many runs,
/// so that hosts share the parts of a path that take longer. Ranks take turns in the order 0 1 2, 2 1 0, so that none
/// has the longer frames each time if the time of frames grows along the path. `frames`: at most 2^32, `ranks`: at most
/// 2^20.
uint32_t rank_of_frame(uint64_t index, uint64_t frames, uint64_t ranks);

/// Parses "0:600" (frames 0 to 599), "3/8" (the third of eight shares, counted from 1), or both, "0:600,3/8". Errors
/// kUsage.
Result<FrameRange> parse_frame_range(std::string_view text);

/// A file name that contains the frame's number: %d, or %05d for leading zeros up to 5 digits (1 to 19 are possible);
/// %% is a %.
class FramePattern {
 public:
  /// Errors kUsage name the option: not exactly one number, or another use of %.
  static Result<FramePattern> parse(std::string_view option, const std::string& text);
  std::string name(uint64_t frame) const;

 private:
  std::string before_, after_;
  size_t digits_ = 1;
};

}  // namespace scree::tools
