// One thread block per chunk. Compiled without contraction of floating-point operations, so that the vertices equal the
// host's bit for bit.
#include <cuda_runtime.h>

#include "lab/scenes/chunk_fill.h"
#include "lab/scenes/generate_kernels.h"

namespace scree::lab {
namespace {

constexpr uint32_t kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    find_boxes(const synth::MeshRecipe* meshes, const ChunkPlan* plans, ChunkBox* boxes) {
  __shared__ ChunkBox shared[kThreads];
  const ChunkPlan plan = plans[blockIdx.x];
  const synth::MeshRecipe mesh = meshes[plan.mesh];
  const float infinity = __int_as_float(0x7f800000);
  ChunkBox box{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
  for (uint32_t vertex = threadIdx.x; vertex < chunk_vertices(mesh, plan); vertex += kThreads) {
    const synth::Float3 p = chunk_position(mesh, plan, vertex);
    const float parts[3] = {p.x, p.y, p.z};
    for (int axis = 0; axis < 3; ++axis) {
      box.lo[axis] = fminf(box.lo[axis], parts[axis]);
      box.hi[axis] = fmaxf(box.hi[axis], parts[axis]);
    }
  }
  shared[threadIdx.x] = box;
  for (uint32_t half = kThreads / 2; half != 0; half /= 2) {
    __syncthreads();
    if (threadIdx.x >= half) continue;
    for (int axis = 0; axis < 3; ++axis) {
      ChunkBox& mine = shared[threadIdx.x];
      const ChunkBox& other = shared[threadIdx.x + half];
      mine.lo[axis] = fminf(mine.lo[axis], other.lo[axis]);
      mine.hi[axis] = fmaxf(mine.hi[axis], other.hi[axis]);
    }
  }
  if (threadIdx.x == 0) boxes[blockIdx.x] = shared[0];
}

__global__ void __launch_bounds__(kThreads)
    fill(const synth::MeshRecipe* recipes, const ChunkPlan* plans, const format::MeshRecord* meshes,
         const format::ChunkRecord* chunks, const std::byte* const* pages) {
  const ChunkPlan plan = plans[blockIdx.x];
  const synth::MeshRecipe recipe = recipes[plan.mesh];
  const format::MeshRecord& mesh = meshes[plan.mesh];
  const format::ChunkRecord& chunk = chunks[blockIdx.x];
  // The pages are writable memory of this program; the types of the drawing code make them const.
  std::byte* payload = const_cast<std::byte*>(pages[chunk.page]) + chunk.offset;
  for (uint32_t group = threadIdx.x; group < quad_groups(chunk); group += kThreads)
    fill_indices(recipe, plan, chunk, group, payload);
  for (uint32_t group = threadIdx.x; group < vertex_groups(chunk); group += kThreads)
    fill_positions(recipe, plan, mesh, chunk, group, payload);
}

}  // namespace

cudaError_t launch_chunk_boxes(const synth::MeshRecipe* recipes, const ChunkPlan* plans, uint32_t count,
                               ChunkBox* boxes) {
  if (count != 0) find_boxes<<<count, kThreads>>>(recipes, plans, boxes);
  return cudaGetLastError();
}

cudaError_t launch_fill_chunks(const synth::MeshRecipe* recipes, const ChunkPlan* plans, uint32_t count,
                               const format::MeshRecord* meshes, const format::ChunkRecord* chunks,
                               const std::byte* const* pages) {
  if (count != 0) fill<<<count, kThreads>>>(recipes, plans, meshes, chunks, pages);
  return cudaGetLastError();
}

}  // namespace scree::lab
