// A scene in device memory, generated there or copied from a .scree file. Its records are also on the host.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
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
  /// Uploads `scene` and keeps it. Errors as runtime::CudaScene::upload.
  static Result<ResidentScene> upload(runtime::Scene scene, uint32_t threads);

  /// Records on the host. Page pointers are null, except for an uploaded scene whose pages are in memory.
  const kernels::SceneView& host() const { return host_; }
  const kernels::SceneView& device() const { return device_; }
  /// The boxes of a generated scene's chunks; empty for a file.
  std::span<const ChunkBox> boxes() const {
    return tables_ ? std::span<const ChunkBox>(tables_->boxes) : std::span<const ChunkBox>();
  }
  /// Bytes of indices and positions, or of clusters.
  uint64_t geometry_bytes() const { return geometry_bytes_; }
  uint64_t unique_triangles() const;
  uint64_t drawn_triangles() const { return host_.instance_base[host_.instance_count]; }
  /// Bytes of records and pages.
  uint64_t device_bytes() const { return device_bytes_; }

  /// For uploaded files only.
  const runtime::Scene& file() const { return *file_; }
  runtime::Scene& file() { return *file_; }
  const runtime::UploadStats& upload_stats() const { return uploaded_.stats(); }

  /// Copies the pages back, for tests. The returned pointers, by page number, point into `storage`.
  Result<std::vector<const std::byte*>> read_pages(std::vector<std::byte>& storage) const;
  /// For generated scenes only.
  const SceneTables& tables() const { return *tables_; }

 private:
  ResidentScene() = default;
  Result<void> allocate_pages(uint64_t bytes);
  /// Copies each chunk's payload to its offset in its page.
  Result<void> copy_payloads(const std::vector<std::vector<std::byte>>& payloads);
  /// Copies the records of host_ and the page pointers to the device, and sets device_ to them.
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
