// What a conversion is told: the options, which of them exclude each other, and how they are typed.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "format/layout.h"
#include "format/result.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/images/images.h"
#include "tools/convert/plan/pixel_bound.h"

namespace scree::convert {

enum class Encoding {
  kIndexed,    // chunks of one list of vertices and indices
  kClustered,  // chunks of clusters; where positions are float32, indexed all the same
};

enum class Grid {
  kMesh,   // every mesh has the finest step its own extent allows
  kScene,  // all meshes under one world matrix have the finest step any of them needs
};

struct ConvertOptions {
  std::string input;                                       // .gltf or .glb
  std::string output;                                      // empty: the input with the extension .scree
  format::Existing existing = format::Existing::kReplace;  // of `output`

  // Options that shape the bytes.
  bool float32 = false;         // positions as they are, instead of:
  uint32_t position_bits = 16;  // 8 to 24 an axis
  double max_error = 0;         // model units, an axis; above 0 it picks each mesh's step, or keeps its floats, instead
  PixelBound pixel_bound;       // pixels above 0: picks the step of each mesh, or keeps its floats, instead of both
  Grid grid = Grid::kMesh;
  Order order = Order::kFifo;
  Encoding encoding = Encoding::kClustered;
  tools::ClusterEffort clusters = tools::ClusterEffort::kFast;  // where clustered
  uint64_t chunk_triangles = format::kMaxChunkTriangles;        // 1 and up; 0: every mesh is one chunk and one window
  int zstd_level = 0;                                           // 0 (raw pages) to 22
  bool normals = false;
  bool source_ids = false;
  bool drop_nonfinite = false;
  bool weld = true;     // vertices that are equal in all that is stored of them are stored once a chunk
  bool share = true;    // equal meshes, textures and materials are stored once
  std::string exclude;  // ImportOptions::exclude
  ImageOptions images;

  // Options that do not.
  uint32_t threads = 0;                 // at most; 0: one per processor
  uint64_t memory = uint64_t{2} << 30;  // bytes that the process may take; fewer threads work where it is short
  bool allow_outside = false;           // reads files of the source outside its folder
  bool resume = false;    // goes on with the .part of an earlier run where it fits, and leaves one that is not finished
  // Where `shards` is above 0: only share `shard` of so many, counted from 0, for merge().
  uint32_t shard = 0;
  uint32_t shards = 0;
  bool progress = false;  // a line on stderr where that is a terminal
  // Called by the caller's thread, five times a second at most: `done` of the `total` things of a stage.
  std::function<void(const std::string& stage, uint64_t done, uint64_t total)> on_progress;
  const std::atomic<bool>* stop = nullptr;  // raised: the conversion ends with kFile "interrupted", nothing is left
                                            // behind but with `resume`
};

/// Whether the error is chosen, and not the bits.
bool bounds_error(const ConvertOptions& options);

/// Errors kUsage: options that exclude each other or are out of range.
Result<void> check_options(const ConvertOptions& options);

/// The options that shape the bytes, as they are typed.
std::string describe_options(const ConvertOptions& options);

}  // namespace scree::convert
