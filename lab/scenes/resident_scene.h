// A scene in device memory with its records readable on the host too: generated there, or copied from a .scree file.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/check.h"
#include "kernels/scene_view.h"
#include "lab/scenes/scene_tables.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/scene/scene.h"

namespace scree::lab {

class ResidentScene {
 public:
  /// Makes the scene on the current device. Errors kDevice (a CUDA call failed; a scene that does not fit, with both
  /// sizes), kRange (make_tables).
  static Result<ResidentScene> generate(const synth::Scene& scene, const Encoding& encoding);
  /// Brings `scene`, which it keeps, to the device. Errors as runtime::CudaScene::upload.
  static Result<ResidentScene> upload(runtime::Scene scene, uint32_t threads);

  /// Records on the host; its pages are there only where an uploaded scene had them, else null.
  const kernels::SceneView& host() const { return host_; }
  const kernels::SceneView& device() const { return device_; }
  /// The boxes of a generated scene's chunks; empty for a file.
  std::span<const ChunkBox> boxes() const {
    return tables_ ? std::span<const ChunkBox>(tables_->boxes) : std::span<const ChunkBox>();
  }
  /// Indices and positions, or clusters.
  uint64_t geometry_bytes() const { return geometry_bytes_; }
  uint64_t unique_triangles() const;
  uint64_t drawn_triangles() const { return host_.instance_base[host_.instance_count]; }
  /// Of records and pages.
  uint64_t device_bytes() const { return device_bytes_; }

  /// Of uploaded files.
  const runtime::Scene& file() const { return *file_; }
  runtime::Scene& file() { return *file_; }
  const runtime::UploadStats& upload_stats() const { return uploaded_.stats(); }

  /// The pages, copied back: for tests. The pointers of scene views, by page number, lie in `storage`.
  Result<std::vector<const std::byte*>> read_pages(std::vector<std::byte>& storage) const;
  /// Of generated scenes.
  const SceneTables& tables() const { return *tables_; }

 private:
  ResidentScene() = default;
  Result<void> allocate_pages(uint64_t bytes);
  /// Copies each chunk's payload to its place.
  Result<void> copy_payloads(const std::vector<std::vector<std::byte>>& payloads);
  /// Copies the records that host_ shows and the page pointers, and makes device_ of them.
  Result<void> copy_records(const std::vector<const std::byte*>& pages);

  std::unique_ptr<SceneTables> tables_;
  std::unique_ptr<runtime::Scene> file_;
  runtime::CudaScene uploaded_;
  kernels::SceneView host_{};
  kernels::SceneView device_{};
  kernels::DeviceBuffer pages_;
  std::vector<kernels::DeviceBuffer> records_;
  uint64_t geometry_bytes_ = 0;
  uint64_t device_bytes_ = 0;
};

}  // namespace scree::lab
