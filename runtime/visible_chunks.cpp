#include "runtime/visible_chunks.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "kernels/cull.h"
#include "kernels/depth.h"
#include "kernels/vertex.h"
#include "runtime/parallel.h"

namespace scree::runtime {
namespace {

using kernels::FrameView;
using kernels::PixelBox;
using kernels::RelativeBox;
using kernels::Transform;

constexpr uint64_t kInstancesAtATime = 512;

struct OnScreen {
  uint32_t nearest_code;
  PixelBox pixels;
};

uint32_t code_of(double depth, bool orthographic) {
  const auto value = static_cast<float>(std::min(depth, 1.0));
  return orthographic ? kernels::depth_code<true>(value) : kernels::depth_code<false>(value);
}

/// Samples that triangles in the box may cover, and the nearest depth code that they may have there; nothing where that
/// is outside of the picture. Conservative: single precision is off by 2^-21 of a row's terms at most
/// (kernels/transform.h), less than the slack of may_be_seen() that is given here, and a pixel more on each side covers
/// rounding and snapping. A box that reaches the near plane may be anywhere, and so may one that is not finite.
std::optional<OnScreen> bound(const Transform& transform, const FrameView& view, const RelativeBox& box) {
  const OnScreen anywhere{0, {0, 0, view.width - 1, view.height - 1}};
  constexpr double kSlack = 1.0 / (1 << 20);
  const double* rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
  double slack[3];
  for (int r = 0; r < 3; ++r) {
    slack[r] = std::fabs(rows[r][3]);
    for (int i = 0; i < 3; ++i) slack[r] += std::fabs(rows[r][i]) * (std::fabs(box.center[i]) + box.extent[i]);
    slack[r] *= kSlack;
  }
  double low[3] = {INFINITY, INFINITY, INFINITY};  // screen x and y in sub-pixels, w
  double high[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (unsigned corner = 0; corner < 8; ++corner) {
    double at[3];
    for (int r = 0; r < 3; ++r) {
      at[r] = rows[r][3];
      for (int i = 0; i < 3; ++i)
        at[r] += rows[r][i] * (box.center[i] + ((corner >> i & 1u) != 0 ? box.extent[i] : -box.extent[i]));
    }
    const double w = view.orthographic ? 1.0 : at[2];
    // Written so that NaN counts as too near.
    if (!view.orthographic && !(w - slack[2] > 1.0)) return anywhere;
    for (int axis = 0; axis < 2; ++axis) {
      const double place = at[axis] / w;
      const double off = (slack[axis] + (view.orthographic ? 0.0 : std::fabs(place) * slack[2])) /
                         (view.orthographic ? 1.0 : w - slack[2]);
      if (!std::isfinite(place) || !std::isfinite(off)) return anywhere;
      low[axis] = std::min(low[axis], place - off);
      high[axis] = std::max(high[axis], place + off);
    }
    low[2] = std::min(low[2], at[2]);
    high[2] = std::max(high[2], at[2]);
  }
  const int32_t size[2] = {view.width, view.height};
  int32_t first[2];
  int32_t last[2];
  for (int axis = 0; axis < 2; ++axis) {
    const double middle = 0.5 * size[axis];
    const double from = std::floor(low[axis] / kernels::kSubpixels + middle) - 1;
    const double to = std::ceil(high[axis] / kernels::kSubpixels + middle) + 1;
    if (from > size[axis] - 1 || to < 0) return std::nullopt;
    first[axis] = static_cast<int32_t>(std::max(from, 0.0));
    last[axis] = static_cast<int32_t>(std::min(to, size[axis] - 1.0));
  }
  constexpr double kMore = 1.00001;  // more than the roundings of 1 / w
  const double nearest =
      view.orthographic ? high[2] + std::fabs(high[2]) * (kMore - 1) + slack[2] : kMore / (low[2] - slack[2]);
  if (!std::isfinite(nearest)) return anywhere;
  return OnScreen{code_of(nearest, view.orthographic), {first[0], first[1], last[0], last[1]}};
}

}  // namespace

VisibleChunks::VisibleChunks(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads) {
  const FrameView frame = kernels::make_frame_view(view);
  const uint64_t blocks = (scene.instance_count + kInstancesAtATime - 1) / kInstancesAtATime;
  std::vector<std::vector<Place>> found(blocks);
  parallel_for(blocks, threads, [&](uint64_t block) {
    const uint64_t end = std::min((block + 1) * kInstancesAtATime, scene.instance_count);
    for (uint64_t i = block * kInstancesAtATime; i < end; ++i) {
      const format::InstanceRecord& instance = scene.instances[i];
      const format::MeshRecord& mesh = scene.meshes[instance.mesh];
      if (mesh.triangle_count == 0) continue;
      const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
      const Transform transform =
          kernels::make_transform(frame, scene.matrices[instance.matrix], mesh.lattice_exponent, float32);
      if (!kernels::may_be_seen(transform, frame, kernels::mesh_box(mesh, transform))) continue;
      for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
        const RelativeBox box = kernels::vertex_box(mesh, scene.chunks[c], transform);
        if (!kernels::may_be_seen(transform, frame, box)) continue;
        if (const std::optional<OnScreen> on = bound(transform, frame, box))
          found[block].push_back({static_cast<uint32_t>(c), on->nearest_code, on->pixels});
      }
    }
  });

  first_.assign(scene.chunk_count + 1, 0);
  std::vector<uint32_t> nearest(scene.chunk_count, UINT32_MAX);
  std::vector<uint64_t> order;  // nearest depth code, chunk
  for (const std::vector<Place>& places : found) {
    for (const Place& place : places) {
      ++first_[place.chunk + 1];
      nearest[place.chunk] = std::min(nearest[place.chunk], place.nearest_code);
    }
  }
  for (uint64_t c = 0; c < scene.chunk_count; ++c) {
    if (first_[c + 1] != 0) order.push_back(uint64_t{nearest[c]} << 32 | c);
    first_[c + 1] += first_[c];
  }
  places_.resize(first_.back());
  std::vector<uint64_t> next(first_.begin(), first_.end() - 1);
  for (const std::vector<Place>& places : found)
    for (const Place& place : places) places_[next[place.chunk]++] = place;
  std::sort(order.begin(), order.end());
  order_.reserve(order.size());
  for (const uint64_t place : order) order_.push_back(static_cast<uint32_t>(place));
}

bool VisibleChunks::is_hidden(uint32_t chunk, const DepthLevels& depths) const {
  for (uint64_t i = first_[chunk]; i < first_[chunk + 1]; ++i) {
    const Place& place = places_[i];
    const int32_t longest = std::max(place.pixels.x1 - place.pixels.x0, place.pixels.y1 - place.pixels.y0);
    // Squares that are a quarter of the box or larger: at most 5 x 5 of them.
    uint32_t level = depths.first_level;
    while (level < kernels::kPyramidLevels && longest >> level > 3) ++level;
    if (place.nearest_code <= kernels::farthest_code(depths.pyramid, level, place.pixels)) return false;
  }
  return true;
}

}  // namespace scree::runtime
