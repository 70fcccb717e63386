// The measurements of one case: a scene, an encoding, a view.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/frame.h"
#include "lab/peer/coverage.h"
#include "tools/bench/machine.h"
#include "tools/bench/times.h"

namespace scree::lab {

using bench::summarize;
using bench::Times;

/// The machine that a case was measured on.
struct Machine : bench::Machine {
  double copy_gb_per_s = 0;  // device copy, bytes read plus bytes written, 1e9 per second
};

/// Errors of one picture against the same scene in float32.
struct PictureError {
  /// Pixels that show another triangle, or background instead of a triangle. Not counted for clusters, whose triangles
  /// have another order and so other numbers.
  std::optional<uint64_t> wrong_pixels;
  double depth_error_max = 0;  // relative, over the pixels that show a triangle in both
  double depth_error_rms = 0;  // likewise
  double psnr_db = 0;          // of the shaded picture in sRGB codes; infinity for equal pictures
  double position_error = 0;   // largest bound in a mesh record, model units
};

/// A peer's picture beside scree's of the same float32 vertices.
struct PeerComparison {
  Coverage coverage;
  double scree_ms = 0;  // median of scree's frame times
};

struct CaseResult {
  std::string scene;
  std::string order;  // "row", "block" or, for a file, "file"
  double scale = 1;
  std::string positions;  // "16" bits, "float32"; for a file "file"
  std::string indices;    // "packed", "32", "clustered"; for a file "file"; for a peer its name (32 bits)
  std::string view;       // or "path"
  uint32_t width = 0;     // pixels
  uint32_t height = 0;
  uint32_t samples_per_side = 1;
  bool sampleless_test = true;
  std::string culling = "all";  // culling of clusters
  std::string effects = "none";
  uint32_t frames = 0;

  uint64_t unique_triangles = 0;
  uint64_t drawn_triangles = 0;  // all triangles of the scene's instances, before culling
  uint64_t geometry_bytes = 0;   // indices and positions, or clusters
  uint64_t device_bytes = 0;     // pages and records
  kernels::FrameStats stats{};   // of the last frame
  uint64_t covered_samples = 0;
  uint64_t picture = 0;                   // XXH3-64 of the last frame's visibility buffer
  std::optional<uint64_t> touched_bytes;  // indices and positions of the chunks that remain after culling, each chunk
                                          // once

  // Times of the stages, missing if the backend does not time them separately.
  std::optional<Times> clear, cull, small, medium, large, pyramid, second, resolve, occlusion;
  std::optional<Times> raster;    // all stages from culling on, without resolve; compared
  std::optional<Times> wall;      // by the host's clock, from the call to the finished visibility buffer
  std::optional<double> jump_ms;  // for a path: the frame after the jump from its end to its start, measured like
                                  // drawing()
  Times frame;                    // by the host's clock, from the call to a finished picture

  std::optional<PictureError> error;
  std::optional<PeerComparison> peer;  // if a peer drew

  /// The time from which speed is computed.
  const Times& drawing() const { return raster ? *raster : frame; }
  double triangles_per_s() const { return static_cast<double>(drawn_triangles) / (drawing().median * 1e-3); }
  double bytes_per_triangle() const {
    return static_cast<double>(geometry_bytes) / static_cast<double>(unique_triangles);
  }
  uint64_t culled_triangles() const { return drawn_triangles - stats.triangles; }
};

}  // namespace scree::lab
