#include "kernels/cuda/frame/view_batch.h"

#include <algorithm>
#include <new>
#include <utility>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/common/device_array.h"
#include "kernels/cuda/common/occupancy.h"
#include "kernels/cuda/frame/draw_tables.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/frame/view_batch.cuh"

namespace scree::kernels {
namespace {

uint64_t samples_of(const View& view) {
  return uint64_t{view.width} * view.height;
}

}  // namespace

struct CudaViewBatch::Impl {
  using Kernel = void (*)(const BatchFrame);

  static Kernel kernel_of(bool orthographic, bool masked) {
    if (masked) return orthographic ? draw_views<true, true> : draw_views<false, true>;
    return orthographic ? draw_views<true, false> : draw_views<false, false>;
  }

  uint64_t views_at_once(std::span<const View> of) const {
    return std::min<uint64_t>(std::max<uint64_t>(most_samples / samples_of(of[0]), 1), of.size());
  }
  Result<void> open(const SceneView& host);
  Result<void> draw_part(std::span<const View> views, uint64_t first, uint32_t samples_per_side,
                         const LayerTargets& out);

  size_t mask_bytes() const { return scene.masks != nullptr ? kBatchMaskBytes : 0; }

  SceneView scene{};
  uint64_t triangle_count = 0;
  uint64_t most_samples = 0;
  ResidentBlocks resident;
  DeviceArray<ClusterGroup> groups;
  DeviceArray<Triangle> queued;
  DeviceArray<BatchCounters> counters;
  DeviceArray<BatchView> views;  // the batch's
  DeviceArray<uint64_t> samples;
  PinnedBuffer read_stats;
  std::vector<BatchView> host_views;
};

Result<void> CudaViewBatch::Impl::open(const SceneView& host) {
  constexpr const char* kWhat = "allocating the tables of batches";
  triangle_count = host.instance_base[host.instance_count];
  SCREE_TRY(resident.open());
  SCREE_TRY(groups.fill(list_cluster_groups(host), kWhat));
  SCREE_TRY(counters.allocate(1, kWhat));
  SCREE_TRY(read_stats.allocate(sizeof(FrameStats), "allocating pinned memory"));
  uint32_t blocks = 0;
  for (const bool orthographic : {false, true}) {
    const Kernel kernel = kernel_of(orthographic, scene.masks != nullptr);
    SCREE_TRY(allow_shared(kernel, mask_bytes()));
    blocks = std::max(blocks, resident.of(kernel, kBatchThreads, mask_bytes()));
  }
  return queued.allocate(uint64_t{blocks} * kBatchWarps * 2 * kWarpQueue, kWhat);
}

/// Draws views whose samples fit into memory at once. The first is view `first` of the batch.
Result<void> CudaViewBatch::Impl::draw_part(std::span<const View> part, uint64_t first, uint32_t samples_per_side,
                                            const LayerTargets& out) {
  const uint64_t view_samples = samples_of(part[0]);
  const bool orthographic = part[0].orthographic;
  BatchFrame frame{};
  frame.scene = scene;
  frame.size = host_views[first].frame;
  frame.views = views.data() + first;
  frame.groups = groups.data();
  frame.group_count = static_cast<uint32_t>(groups.count());
  frame.work = groups.count() * part.size();
  frame.samples = samples.data();
  frame.picture_samples = view_samples;
  frame.queued = queued.data();
  frame.counters = counters.data();
  static_assert(kBackground == ~uint64_t{0});
  SCREE_TRY(
      cuda_check(cudaMemsetAsync(samples.data(), 0xff, part.size() * view_samples * sizeof(uint64_t)), "clearing"));
  SCREE_TRY(cuda_check(cudaMemsetAsync(&counters.data()->next, 0, sizeof(uint64_t)), "clearing the counters"));
  const Kernel kernel = kernel_of(orthographic, scene.masks != nullptr);
  const auto blocks = static_cast<uint32_t>(std::min<uint64_t>(resident.of(kernel, kBatchThreads, mask_bytes()),
                                                               (frame.work + kBatchWarps - 1) / kBatchWarps));
  kernel<<<blocks, kBatchThreads, mask_bytes()>>>(frame);
  SCREE_TRY(cuda_check(cudaGetLastError(), "starting a batch"));

  const uint32_t width = part[0].width / samples_per_side;
  const auto view_pixels = static_cast<uint32_t>(view_samples / samples_per_side / samples_per_side);
  const auto count = static_cast<uint32_t>(part.size() * view_pixels);
  const auto from = [&]<class T>(T* all) { return all == nullptr ? nullptr : all + first * view_pixels; };
  MakeLayers layers{};
  layers.instance_base = scene.instance_base;
  layers.instance_count = scene.instance_count;
  layers.pixels = {samples.data(), width, samples_per_side};
  layers.out.depth = from(out.depth);
  layers.out.triangle = from(out.triangle);
  layers.out.instance = from(out.instance);
  make_batch_layers<<<(count - 1) / kBatchLayerThreads + 1, kBatchLayerThreads>>>(layers, views.data() + first,
                                                                                  view_pixels, count);
  return cuda_check(cudaGetLastError(), "starting to make the layers of a batch");
}

bool CudaViewBatch::takes(const SceneView& host) {
  const CandidateCounts candidates = count_candidates(host);
  return host.blend_masks == nullptr && candidates.indexed == 0 && candidates.cluster_groups != 0 &&
         candidates.cluster_groups < CudaQueueSizes{}.two_pass_groups;
}

bool CudaViewBatch::pays(std::span<const View> views) {
  return views.size() >= kFewestViews && samples_of(views[0]) <= kMostViewSamples &&
         std::all_of(views.begin(), views.end(),
                     [&](const View& view) { return !view.clips && view.orthographic == views[0].orthographic; });
}

CudaViewBatch::CudaViewBatch(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CudaViewBatch::CudaViewBatch(CudaViewBatch&&) noexcept = default;
CudaViewBatch& CudaViewBatch::operator=(CudaViewBatch&&) noexcept = default;
CudaViewBatch::~CudaViewBatch() = default;

Result<CudaViewBatch> CudaViewBatch::create(const SceneView& host, const SceneView& device, uint64_t most_samples) try {
  auto impl = std::make_unique<Impl>();
  impl->scene = device;
  impl->most_samples = most_samples;
  if (Result<void> opened = impl->open(host); !opened) return opened.error();
  return CudaViewBatch(std::move(impl));
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "out of memory for the tables of batches"};
}

Result<void> CudaViewBatch::reserve(std::span<const View> views) {
  SCREE_TRY(impl_->views.grow(views.size(), "allocating a batch's views"));
  SCREE_TRY(impl_->samples.grow(impl_->views_at_once(views) * samples_of(views[0]), "allocating a batch's samples"));
  try {
    impl_->host_views.reserve(views.size());
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "out of memory for a batch's views"};
  }
  return {};
}

Result<FrameStats> CudaViewBatch::draw(std::span<const View> views, uint32_t samples_per_side,
                                       const LayerTargets& out) {
  Impl& impl = *impl_;
  for (const View& view : views) {
    SCREE_TRY(check_frame(view, impl.triangle_count));
    SCREE_TRY(check_resolve(view, samples_per_side));
  }
  SCREE_TRY(reserve(views));
  impl.host_views.clear();
  for (const View& view : views) impl.host_views.push_back({make_frame_view(view), view.z_near, view.z_far});
  Result<void> done = cuda_check(cudaMemcpyAsync(impl.views.data(), impl.host_views.data(),
                                                 views.size() * sizeof(BatchView), cudaMemcpyHostToDevice),
                                 "copying a batch's views");
  if (done) done = cuda_check(cudaMemsetAsync(impl.counters.data(), 0, sizeof(BatchCounters)), "clearing the counters");
  const uint64_t at_once = impl.views_at_once(views);
  for (uint64_t first = 0; done && first < views.size(); first += at_once)
    done = impl.draw_part(views.subspan(first, std::min(at_once, views.size() - first)), first, samples_per_side, out);
  if (done)
    done = cuda_check(cudaMemcpyAsync(impl.read_stats.data(), &impl.counters.data()->stats, sizeof(FrameStats),
                                      cudaMemcpyDeviceToHost),
                      "reading the counters");
  // Also after an error, so that no kernel writes to the caller's memory afterwards.
  if (const Result<void> waited = cuda_check(cudaStreamSynchronize(nullptr), "drawing a batch"); done) done = waited;
  if (!done) return done.error();
  return *reinterpret_cast<const FrameStats*>(impl.read_stats.data());
}

}  // namespace scree::kernels
