#include "lab/scenes/generate.h"

#include <algorithm>

#include "kernels/cuda/common/check.h"
#include "lab/scenes/generate_kernels.h"

namespace scree::lab {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;

/// A copy of `items` on the device.
template <class T>
Result<DeviceBuffer> to_device(std::span<const T> items, const char* what) {
  DeviceBuffer buffer = SCREE_TRY(DeviceBuffer::allocate(std::max<uint64_t>(items.size_bytes(), 1), what));
  SCREE_TRY(cuda_check(cudaMemcpy(buffer.data(), items.data(), items.size_bytes(), cudaMemcpyHostToDevice), what));
  return buffer;
}

/// Waits for a launch. `launched`: the status of the launch itself.
Result<void> finish(cudaError_t launched, const char* what) {
  SCREE_TRY(cuda_check(launched, what));
  return cuda_check(cudaDeviceSynchronize(), what);
}

}  // namespace

Result<std::vector<ChunkBox>> chunk_boxes_cuda(const synth::Scene& scene, std::span<const ChunkPlan> plans) {
  std::vector<ChunkBox> boxes(plans.size());
  if (plans.empty()) return boxes;
  DeviceBuffer meshes = SCREE_TRY(to_device(std::span<const synth::MeshRecipe>(scene.meshes), "copying the recipes"));
  DeviceBuffer device_plans = SCREE_TRY(to_device(plans, "copying the chunks' plans"));
  const uint64_t bytes = boxes.size() * sizeof(ChunkBox);
  DeviceBuffer device_boxes = SCREE_TRY(DeviceBuffer::allocate(bytes, "allocating the chunks' boxes"));
  const cudaError_t launched =
      launch_chunk_boxes(reinterpret_cast<const synth::MeshRecipe*>(meshes.data()),
                         reinterpret_cast<const ChunkPlan*>(device_plans.data()), static_cast<uint32_t>(plans.size()),
                         reinterpret_cast<ChunkBox*>(device_boxes.data()));
  SCREE_TRY(finish(launched, "finding the chunks' boxes"));
  SCREE_TRY(cuda_check(cudaMemcpy(boxes.data(), device_boxes.data(), bytes, cudaMemcpyDeviceToHost),
                       "reading the chunks' boxes"));
  return boxes;
}

Result<void> fill_chunks_cuda(const synth::Scene& scene, std::span<const ChunkPlan> plans,
                              const format::MeshRecord* meshes, const format::ChunkRecord* chunks,
                              const std::byte* const* pages) {
  if (plans.empty()) return {};
  DeviceBuffer recipes = SCREE_TRY(to_device(std::span<const synth::MeshRecipe>(scene.meshes), "copying the recipes"));
  DeviceBuffer device_plans = SCREE_TRY(to_device(plans, "copying the chunks' plans"));
  const cudaError_t launched = launch_fill_chunks(reinterpret_cast<const synth::MeshRecipe*>(recipes.data()),
                                                  reinterpret_cast<const ChunkPlan*>(device_plans.data()),
                                                  static_cast<uint32_t>(plans.size()), meshes, chunks, pages);
  return finish(launched, "generating the scene");
}

}  // namespace scree::lab
