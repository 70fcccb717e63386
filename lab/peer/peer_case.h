// Measures a peer on a view that scree has drawn.
#pragma once

#include <cstdint>
#include <vector>

#include "format/result.h"
#include "lab/peer/peer.h"
#include "lab/report/case_result.h"

namespace scree::lab {

/// scree's frame of a generated scene with float32 positions, and its case.
struct ScreePicture {
  kernels::View view;
  std::vector<uint64_t> samples;
  CaseResult result;
};

/// A case for each PeerDrawing: times up to `frames` frames after `warmup`, as many as bench::timed_frames() has time
/// for, and compares the last one with `picture`. `peer` must have loaded `scene`. Errors of look(), draw() and ids().
Result<std::vector<CaseResult>> measure_peer(Peer& peer, const synth::Scene& scene, const ScreePicture& picture,
                                             uint32_t frames, uint32_t warmup);

}  // namespace scree::lab
