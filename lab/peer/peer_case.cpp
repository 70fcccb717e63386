#include "lab/peer/peer_case.h"

#include <algorithm>
#include <span>
#include <utility>

#include "format/container/checksum.h"

namespace scree::lab {
namespace {

/// The columns that apply to a peer's frame too; the others stay empty.
CaseResult begin_case(const Peer& peer, PeerDrawing drawing, const CaseResult& scree) {
  return {.scene = scree.scene,
          .order = scree.order,
          .scale = scree.scale,
          .positions = scree.positions,
          .indices = peer_name(drawing),
          .view = scree.view,
          .width = scree.width,
          .height = scree.height,
          .samples_per_side = scree.samples_per_side,
          .unique_triangles = scree.unique_triangles,
          .drawn_triangles = scree.drawn_triangles,
          .geometry_bytes = peer.geometry_bytes(),
          .device_bytes = peer.device_bytes()};
}

Result<void> measure(Peer& peer, PeerDrawing drawing, uint32_t frames, uint32_t warmup, CaseResult& result) {
  std::vector<float> walls;
  const auto draw_one = [&]() -> Result<float> {
    const Peer::Ms ms = SCREE_TRY(peer.draw(drawing));
    walls.push_back(ms.wall);
    return ms.gpu;
  };
  const std::vector<float> times = SCREE_TRY(bench::timed_frames(frames, warmup, draw_one));
  result.frames = static_cast<uint32_t>(times.size());
  result.raster = summarize(times);
  result.wall = summarize(std::span(walls).last(times.size()));
  result.frame = *result.wall;
  return {};
}

}  // namespace

Result<std::vector<CaseResult>> measure_peer(Peer& peer, const synth::Scene& scene, const ScreePicture& picture,
                                             uint32_t frames, uint32_t warmup) {
  const kernels::FrameStats stats = SCREE_TRY(peer.look(picture.view));
  std::vector<CaseResult> results;
  for (const PeerDrawing drawing : {PeerDrawing::kIndexed, PeerDrawing::kPulled}) {
    CaseResult result = begin_case(peer, drawing, picture.result);
    result.stats = stats;
    SCREE_TRY(measure(peer, drawing, frames, warmup, result));
    const std::vector<uint64_t> ids = SCREE_TRY(peer.ids());
    result.covered_samples = static_cast<uint64_t>(
        std::count_if(ids.begin(), ids.end(), [](uint64_t id) { return id != kernels::kIdMask; }));
    result.picture = format::checksum(std::as_bytes(std::span(ids)));
    result.peer =
        PeerComparison{compare_coverage(scene, picture.view, picture.samples, ids), picture.result.drawing().median};
    results.push_back(std::move(result));
  }
  return results;
}

}  // namespace scree::lab
