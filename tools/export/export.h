// A .scree file back to glTF 2.0.
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
  format::Existing existing = format::Existing::kReplace;  // of all files of the output
  uint32_t threads = 0;                     // 0: one a core; the bytes written are the same for any number
  const std::atomic<bool>* stop = nullptr;  // raised: the export ends with kFile "interrupted"
  std::function<void(uint64_t triangles, uint64_t bytes)>
      progress;  // written so far; called by the caller's own thread
  std::function<void(uint64_t offset, uint64_t bytes)> is_done_with;  // a part of the .scree file; called by any thread
  // Asked once all of it is read, before what is written takes its name; an error of it is that of the export.
  std::function<Result<void>()> check_source;
};

/// What was written.
struct ExportSummary {
  uint64_t primitives = 0;
  uint64_t vertices = 0;   // over the primitives; vertices on chunk borders count once a chunk
  uint64_t triangles = 0;  // over the primitives, not the instances
  uint64_t images = 0;
  bool is_version_3 = false;  // a .glb with lengths of 64 bits
  uint64_t bytes = 0;         // of all files written
};

/// Writes `file` to `path`, which ends in .glb or .gltf (then with its .bin and images beside it). Each mesh is one
/// primitive (more where it has 2^32 vertices or more): its chunks one after the other, vertices as decoded floats,
/// colours as the RGBA8 they are stored as, 16-bit indices where they fit. Nodes, instances, materials, cameras and
/// scenes keep their order; meshes without triangles are left out. Source triangle numbers have no place in glTF and
/// are not written. Memory: one decoded chunk a thread, and about 300 bytes a mesh and node. Errors: as ChunkReader and
/// GltfWriter; nothing is left behind then. Source: issue 2, section 6.
Result<ExportSummary> export_gltf(const format::Container& file, const std::string& path, const ExportOptions& options);

}  // namespace scree::tools
