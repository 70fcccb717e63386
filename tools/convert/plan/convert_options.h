// The options of a conversion, their checks, and their text form.
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
  kIndexed,    // chunks with one list of vertices and one of indices
  kClustered,  // chunks of clusters; meshes with float32 positions are still indexed
};

enum class Grid {
  kMesh,   // every mesh has the finest step that its own extent allows
  kScene,  // all meshes under one world matrix have the finest step among them
};

/// Options of a conversion or a merge that do not change the bytes of the file.
struct RunOptions {
  std::string output;                                      // of a conversion, empty: the input with extension .scree
  format::Existing existing = format::Existing::kReplace;  // for `output`
  uint32_t threads = 0;                                    // upper limit; 0: one per processor
  uint64_t memory = uint64_t{2} << 30;                     // limit for the process; a low limit allows fewer threads
  bool allow_outside = false;                              // may read files outside the source's folder
  bool progress = false;                                   // a line on stderr if that is a terminal
  const std::atomic<bool>* stop = nullptr;  // if set, the run ends with kFile "interrupted" and leaves no file behind,
                                            // except with ConvertOptions::resume
};

struct ConvertOptions : RunOptions {
  std::string input;  // .gltf or .glb

  // Options that change the bytes of the file.
  bool float32 = false;         // stores positions unchanged; position_bits is then not used
  uint32_t position_bits = 16;  // 8 to 24 per axis
  // If max_error (model units, per axis) or pixel_bound.pixels is above 0, it replaces position_bits: it chooses the
  // step of each mesh, or keeps the mesh's floats.
  double max_error = 0;
  PixelBound pixel_bound;
  Grid grid = Grid::kMesh;
  Order order = Order::kFifo;
  Encoding encoding = Encoding::kClustered;
  tools::ClusterEffort clusters = tools::ClusterEffort::kFast;  // for clustered meshes
  uint64_t chunk_triangles = format::kMaxChunkTriangles;        // at least 1; 0: every mesh is one chunk and one window
  int zstd_level = 0;  // 0 (raw) to 22, for pages of geometry and masks; blocks have ImageOptions::block_zstd_level
  Normals normals = Normals::kAuto;
  bool source_ids = false;
  bool drop_nonfinite = false;
  bool weld = true;     // vertices whose stored values are all equal are stored once per chunk
  bool share = true;    // equal meshes, textures and materials are stored once
  std::string exclude;  // ImportOptions::exclude
  ImageOptions images;

  // Options that do not change the bytes of the file.
  bool resume = false;  // continues the .part of an earlier run if it fits, and leaves an unfinished .part behind
  // If `shards` is above 0: converts only share `shard` of `shards` (counted from 0), for merge().
  uint32_t shard = 0;
  uint32_t shards = 0;
  // Called by the caller's thread, at most five times per second: `done` of `total` items of a stage are done.
  std::function<void(const std::string& stage, uint64_t done, uint64_t total)> on_progress;
  // Called by the caller's thread, with `resume`, once there is a .part that a later run can continue: at the start if
  // an earlier run left one, and when this run begins to write.
  std::function<void()> on_part;
};

/// Whether the options bound the error instead of setting the bits.
bool bounds_error(const ConvertOptions& options);

/// Errors kUsage: options that exclude each other or are out of range.
Result<void> check_options(const ConvertOptions& options);

/// The options that change the output, as text of a command line.
std::string describe_options(const ConvertOptions& options);

}  // namespace scree::convert
