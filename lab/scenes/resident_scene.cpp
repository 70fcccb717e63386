#include "lab/scenes/resident_scene.h"

#include <algorithm>
#include <thread>

#include "lab/scenes/clustered.h"
#include "lab/scenes/generate.h"
#include "tools/common/options/options.h"

namespace scree::lab {

using kernels::cuda_check;
using kernels::DeviceBuffer;

Result<ResidentScene> ResidentScene::generate(const synth::Scene& scene, const Encoding& encoding) {
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const std::vector<ChunkBox> boxes = SCREE_TRY(chunk_boxes_cuda(scene, plans));
  SceneTables tables = SCREE_TRY(make_tables(scene, plans, boxes, encoding));
  std::vector<std::vector<std::byte>> payloads;
  if (encoding.clustered) {
    ClusteredScene clustered =
        SCREE_TRY(encode_clustered(scene, plans, std::move(tables), std::max(1u, std::thread::hardware_concurrency())));
    tables = std::move(clustered.tables);
    payloads = std::move(clustered.payloads);
  }
  ResidentScene resident;
  resident.tables_ = std::make_unique<SceneTables>(std::move(tables));
  resident.host_ = resident.tables_->view(nullptr);
  resident.geometry_bytes_ = resident.tables_->geometry_bytes;
  SCREE_TRY(resident.allocate_pages(resident.tables_->arena_bytes));
  SCREE_TRY(resident.copy_records(resident.tables_->page_pointers(resident.pages_.data())));
  if (encoding.clustered) {
    SCREE_TRY(resident.copy_payloads(payloads));
    return resident;
  }
  SCREE_TRY(fill_chunks_cuda(scene, plans, resident.device_.meshes, resident.device_.chunks, resident.device_.pages));
  return resident;
}

Result<ResidentScene> ResidentScene::upload(runtime::Scene scene, uint32_t threads) {
  ResidentScene resident;
  resident.file_ = std::make_unique<runtime::Scene>(std::move(scene));
  resident.host_ = resident.file_->view();
  resident.uploaded_ = SCREE_TRY(runtime::CudaScene::upload(*resident.file_, 0, 0, threads));
  resident.device_ = resident.uploaded_.view();
  resident.device_bytes_ = resident.uploaded_.arena_bytes();
  const runtime::DrawnPages& drawn = resident.file_->drawn_pages();
  std::vector<bool> is_drawn(drawn.container().pages().size());
  for (uint64_t i = 0; i < drawn.size(); ++i) is_drawn[drawn.page(i)] = true;
  const kernels::SceneView& host = resident.host_;
  for (uint64_t i = 0; i < host.chunk_count; ++i) {
    if (is_drawn[host.chunks[i].page])
      resident.geometry_bytes_ += lab::geometry_bytes(host.meshes[host.chunks[i].mesh], host.chunks[i]);
  }
  return resident;
}

Result<void> ResidentScene::allocate_pages(uint64_t bytes) {
  size_t free_bytes = 0;
  size_t total_bytes = 0;
  SCREE_TRY(cuda_check(cudaMemGetInfo(&free_bytes, &total_bytes), "querying the free device memory"));
  if (bytes > free_bytes)
    return Error{ErrorCode::kDevice, "the scene takes " + tools::format_bytes(bytes) + " of device memory, but " +
                                         tools::format_bytes(free_bytes) + " are free; a smaller --scale needs less"};
  pages_ = SCREE_TRY(DeviceBuffer::allocate(std::max<uint64_t>(bytes, 1), "allocating the scene"));
  device_bytes_ += bytes;
  return cuda_check(cudaMemset(pages_.data(), 0, bytes), "clearing the scene's pages");
}

Result<void> ResidentScene::copy_payloads(const std::vector<std::vector<std::byte>>& payloads) {
  for (size_t i = 0; i < payloads.size(); ++i) {
    const format::ChunkRecord& chunk = tables_->chunks[i];
    std::byte* const to = pages_.data() + tables_->page_offset[chunk.page] + chunk.offset;
    SCREE_TRY(cuda_check(cudaMemcpy(to, payloads[i].data(), payloads[i].size(), cudaMemcpyHostToDevice),
                         "copying a chunk to the device"));
  }
  return {};
}

Result<void> ResidentScene::copy_records(const std::vector<const std::byte*>& pages) {
  device_ = host_;
  Result<void> result;
  const auto copy = [&]<class T>(const T*& to, const T* from, uint64_t count) {
    to = nullptr;
    if (!result || count == 0) return;
    Result<DeviceBuffer> buffer = DeviceBuffer::allocate(count * sizeof(T), "allocating the scene's records");
    if (!buffer) {
      result = buffer.error();
      return;
    }
    result = cuda_check(cudaMemcpy(buffer->data(), from, count * sizeof(T), cudaMemcpyHostToDevice),
                        "copying the scene's records");
    to = reinterpret_cast<const T*>(buffer->data());
    device_bytes_ += count * sizeof(T);
    records_.push_back(std::move(*buffer));
  };
  copy(device_.meshes, host_.meshes, host_.mesh_count);
  copy(device_.chunks, host_.chunks, host_.chunk_count);
  copy(device_.instances, host_.instances, host_.instance_count);
  copy(device_.instance_base, host_.instance_base, host_.instance_count + 1);
  copy(device_.matrices, host_.matrices, host_.matrix_count);
  copy(device_.materials, host_.materials, host_.material_count);
  const std::byte* const* table = pages.data();
  copy(device_.pages, table, pages.size());
  copy(device_.textures, host_.textures, host_.texture_count);  // without texels, so textures are drawn white
  return result;
}

uint64_t ResidentScene::unique_triangles() const {
  std::vector<bool> drawn(host_.mesh_count);
  uint64_t triangles = 0;
  for (uint64_t i = 0; i < host_.instance_count; ++i) {
    const uint32_t mesh = host_.instances[i].mesh;
    if (!drawn[mesh]) triangles += host_.meshes[mesh].triangle_count;
    drawn[mesh] = true;
  }
  return triangles;
}

Result<std::vector<const std::byte*>> ResidentScene::read_pages(std::vector<std::byte>& storage) const {
  storage.resize(tables_->arena_bytes);
  SCREE_TRY(cuda_check(cudaMemcpy(storage.data(), pages_.data(), storage.size(), cudaMemcpyDeviceToHost),
                       "reading the pages"));
  return tables_->page_pointers(storage.data());
}

}  // namespace scree::lab
