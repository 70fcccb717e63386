// Converts a .scree file back to glTF 2.0.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "format/container/container.h"
#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

struct ExportOptions {
  std::string source;                                      // the file that is read: no output may replace it
  format::Existing existing = format::Existing::kReplace;  // of all files of the output
  uint32_t threads = 0;                     // 0: one per processor; the output is the same for any number
  const std::atomic<bool>* stop = nullptr;  // if raised, the export ends with kFile "interrupted"
  std::function<void(uint64_t triangles, uint64_t bytes)> progress;   // done so far; called on the caller's thread
  std::function<void(uint64_t offset, uint64_t bytes)> is_done_with;  // a part that was read; called on any thread
  // Called after the whole file is read, before the output files get their names. Its error becomes that of the export.
  std::function<Result<void>()> check_source;
};

/// The counts of an export.
struct ExportSummary {
  uint64_t primitives = 0;
  uint64_t vertices = 0;   // over the primitives; vertices on chunk borders count once per chunk
  uint64_t triangles = 0;  // over the primitives, not the instances
  uint64_t images = 0;
  bool is_version_3 = false;  // a .glb with lengths of 64 bits
  uint64_t bytes = 0;         // of all files written
};

/// Writes `file` to `path`, which ends in .glb or .gltf (then with its .bin and images beside it). Each mesh becomes
/// one primitive (several if it has 2^32 vertices or more) with its chunks one after another. Vertices are decoded
/// floats, colours the stored RGBA8, and indices have 16 bits if these suffice. Nodes, instances, materials, cameras
/// and scenes keep their order; meshes without triangles are left out. Source triangle numbers are not written, because
/// glTF has no attribute for them. Memory: one decoded chunk per thread, and about 300 bytes per mesh and node. Errors
/// as ChunkReader and GltfWriter, after which no output file is left.
Result<ExportSummary> export_gltf(const format::Container& file, const std::string& path, const ExportOptions& options);

}  // namespace scree::tools
