#include <algorithm>

#include "kernels/cuda/common/warp.cuh"
#include "kernels/cuda/cull/visible_chunks.h"
#include "kernels/cull/chunk_screen.h"
#include "kernels/visbuffer.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kFirstLevel = CudaVisibleChunks::kFirstLevel;
constexpr uint32_t kSide = 1u << kFirstLevel;
constexpr uint32_t kWarps = 4;  // per block
constexpr uint32_t kLanes = 32;

/// One warp per square; a lane reads two of its samples.
__global__ void __launch_bounds__(kLanes* kWarps)
    fill_first_level(const __grid_constant__ DepthPyramid pyramid, const uint64_t* samples) {
  const auto width = static_cast<uint32_t>(pyramid.width);
  const auto height = static_cast<uint32_t>(pyramid.height);
  const auto across = static_cast<uint32_t>(pyramid.across(kFirstLevel));
  const uint32_t square = blockIdx.x * kWarps + threadIdx.x / kLanes;
  if (square >= across * static_cast<uint32_t>(pyramid.down(kFirstLevel))) return;
  const uint32_t lane = threadIdx.x % kLanes;
  const uint32_t x = square % across * kSide + lane % kSide;
  uint32_t farthest = 0;
  for (uint32_t y = square / across * kSide + lane / kSide, i = 0; i < 2; ++i, y += kLanes / kSide)
    if (x < width && y < height) farthest = max_of(farthest, sample_depth_code(samples[uint64_t{y} * width + x]));
  farthest = largest_of_lanes(farthest);
  if (lane == 0) pyramid.row(kFirstLevel, 0)[square] = farthest;
}

/// Uses one block.
__global__ void __launch_bounds__(1024) fill_other_levels(const __grid_constant__ DepthPyramid pyramid) {
  for (uint32_t level = kFirstLevel + 1; level <= kPyramidLevels; ++level) {
    fill_level(pyramid, level, static_cast<int32_t>(threadIdx.x), static_cast<int32_t>(blockDim.x));
    __syncthreads();
  }
}

/// Calls `use(chunk, find)` for the chunks of every instance that may be seen; find(bounds) is find_chunk_bounds().
/// Each row of blocks has one warp per instance. A warp takes 32 consecutive chunks, and then the next 32 that no other
/// row takes.
template <class Use>
__device__ void look_at_chunks(const SceneView& scene, const FrameView& view, const Use& use) {
  const uint64_t number = uint64_t{blockIdx.x} * kWarps + threadIdx.x / kLanes;
  if (number >= scene.instance_count || is_omitted(view, number)) return;
  const format::InstanceRecord& instance = scene.instances[number];
  const format::MeshRecord& mesh = scene.meshes[instance.mesh];
  const uint64_t first = uint64_t{blockIdx.y} * kLanes + threadIdx.x % kLanes;
  if (mesh.triangle_count == 0 || first >= mesh.chunk_count || !draws_mesh(scene, mesh)) return;
  const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                             mesh.position_encoding == format::PositionEncoding::kFloat32);
  if (!may_be_drawn(transform, view, mesh_box(mesh, transform))) return;
  for (uint64_t i = first; i < mesh.chunk_count; i += uint64_t{gridDim.y} * kLanes) {
    const uint64_t chunk = mesh.first_chunk + i;
    use(chunk,
        [&](ScreenBounds& bounds) { return find_chunk_bounds(mesh, scene.chunks[chunk], transform, view, bounds); });
  }
}

__global__ void __launch_bounds__(kLanes* kWarps)
    find_nearest_codes(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                       uint32_t* nearest) {
  look_at_chunks(scene, view, [&](uint64_t chunk, const auto& find) {
    ScreenBounds bounds;
    if (find(bounds)) atomicMin(nearest + chunk, bounds.nearest_code);
  });
}

/// As find_nearest_codes(), but only with the instances that the pyramid does not hide.
__global__ void __launch_bounds__(kLanes* kWarps)
    find_shown_codes(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                     const __grid_constant__ DepthPyramid pyramid, const uint32_t* nearest, uint32_t* shown) {
  look_at_chunks(scene, view, [&](uint64_t chunk, const auto& find) {
    ScreenBounds bounds;
    if (shown[chunk] == nearest[chunk]) return;  // it cannot become nearer, or is not in the view
    if (find(bounds) && bounds.nearest_code < shown[chunk] && !is_occluded_by_pyramid(pyramid, kFirstLevel, bounds))
      atomicMin(shown + chunk, bounds.nearest_code);
  });
}

}  // namespace

uint64_t CudaVisibleChunks::device_bytes(const SceneView& scene) {
  return 2 * scene.chunk_count * sizeof(uint32_t);
}

Result<void> CudaVisibleChunks::open(const SceneView& host, const SceneView& device) {
  scene_ = device;
  uint64_t pairs = 0;  // of an instance and one of its chunks
  for (uint64_t i = 0; i < host.instance_count; ++i) pairs += host.meshes[host.instances[i].mesh].chunk_count;
  // As many rows as the mean instance can use. So a few instances of many chunks keep the GPU busy, and many instances
  // of few chunks start few idle warps.
  constexpr uint64_t kMostRows = 1024;
  const uint64_t instances = std::max<uint64_t>(host.instance_count, 1);
  blocks_ = dim3(static_cast<uint32_t>((instances - 1) / kWarps + 1),
                 static_cast<uint32_t>(std::clamp<uint64_t>(pairs / instances / kLanes, 1, kMostRows)));
  const char* const what = "allocating the list of chunks";
  const uint64_t count = host.chunk_count;
  SCREE_TRY(nearest_.reserve(count * sizeof(uint32_t), what));
  SCREE_TRY(shown_.reserve(count * sizeof(uint32_t), what));
  SCREE_TRY(read_nearest_.allocate(count * sizeof(uint32_t), "allocating pinned memory"));
  return read_shown_.allocate(count * sizeof(uint32_t), "allocating pinned memory");
}

Result<std::span<const uint32_t>> CudaVisibleChunks::find_nearest(const View& view, bool draws_blended) {
  scene_.draws_blended = draws_blended;
  frame_ = make_frame_view(view);
  // Allocated now, because no kernel is running for which the allocation would wait.
  const uint64_t codes = lay_out(pyramid_, frame_.width, frame_.height, kFirstLevel);
  SCREE_TRY(codes_.reserve(codes * sizeof(uint32_t), "allocating the depths"));
  pyramid_.codes = reinterpret_cast<uint32_t*>(codes_.data());
  const uint64_t bytes = scene_.chunk_count * sizeof(uint32_t);
  auto* const nearest = reinterpret_cast<uint32_t*>(nearest_.data());
  SCREE_TRY(cuda_check(cudaMemsetAsync(nearest, 0xff, bytes, nullptr), "clearing the list of chunks"));
  find_nearest_codes<<<blocks_, kLanes * kWarps>>>(scene_, frame_, nearest);
  SCREE_TRY(cuda_check(cudaGetLastError(), "listing chunks"));
  SCREE_TRY(cuda_check(cudaMemcpy(read_nearest_.data(), nearest, bytes, cudaMemcpyDeviceToHost), "listing chunks"));
  return std::span(reinterpret_cast<const uint32_t*>(read_nearest_.data()), scene_.chunk_count);
}

Result<void> CudaVisibleChunks::start_finding_shown(const uint64_t* samples) {
  const uint64_t bytes = scene_.chunk_count * sizeof(uint32_t);
  auto* const shown = reinterpret_cast<uint32_t*>(shown_.data());
  SCREE_TRY(cuda_check(cudaMemsetAsync(shown, 0xff, bytes, nullptr), "clearing the list of chunks"));
  const auto squares = static_cast<uint32_t>(pyramid_.across(kFirstLevel) * pyramid_.down(kFirstLevel));
  fill_first_level<<<(squares - 1) / kWarps + 1, kLanes * kWarps>>>(pyramid_, samples);
  fill_other_levels<<<1, 1024>>>(pyramid_);
  find_shown_codes<<<blocks_, kLanes * kWarps>>>(scene_, frame_, pyramid_,
                                                 reinterpret_cast<const uint32_t*>(nearest_.data()), shown);
  SCREE_TRY(cuda_check(cudaGetLastError(), "finding hidden chunks"));
  return cuda_check(cudaMemcpyAsync(read_shown_.data(), shown, bytes, cudaMemcpyDeviceToHost, nullptr),
                    "finding hidden chunks");
}

}  // namespace scree::kernels
