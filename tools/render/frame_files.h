// The files of a film's frames that exist already, when a film is resumed.
#pragma once

#include <cstdint>
#include <string>

#include "format/result.h"
#include "runtime/draw/view_renderer.h"

namespace scree::tools {

struct FrameSize {
  uint32_t width;
  uint32_t height;
  uint32_t samples_per_side;  // of a pixel

  uint64_t pixels() const { return uint64_t{width} * height; }
  uint64_t samples() const { return pixels() * samples_per_side * samples_per_side; }
};

/// Whether a file exists and begins and ends like an output of a frame of this size. `layer`: kColor (a PNG), kDepth (a
/// PFM) or kSamples (a visibility buffer). Error kFile: --resume must not replace it, because it is a frame of another
/// size, or none. The beginning of a file that was lost with the machine's power may be zero.
Result<bool> has_whole_frame(runtime::Layer layer, const std::string& name, const FrameSize& size);

}  // namespace scree::tools
