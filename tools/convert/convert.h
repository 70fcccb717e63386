// glTF in, .scree out. Memory stays bounded however big the scene is: windows of triangles are measured and then
// encoded, a bounded number of them in flight.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "tools/convert/encode.h"
#include "tools/convert/gltf_source.h"
#include "tools/convert/images.h"
#include "tools/convert/pixel_bound.h"
#include "tools/convert/position_table.h"
#include "tools/convert/stage_rates.h"

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
  std::string input;   // .gltf or .glb
  std::string output;  // empty: the input with the extension .scree

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
  bool resume = false;    // goes on with the .part of an earlier run where it fits, and leaves one that is not finished
  bool progress = false;  // a line on stderr where that is a terminal
  const std::atomic<bool>* stop = nullptr;  // raised: the conversion ends with kFile "interrupted", nothing is left
                                            // behind but with `resume`
};

struct ConvertReport {
  std::string output;
  uint64_t input_bytes = 0;  // of the input and the buffer and image files it names
  uint64_t output_bytes = 0;
  uint64_t meshes = 0;
  uint64_t chunks = 0;
  uint64_t triangles = 0;              // stored
  uint64_t triangles_drawn = 0;        // over all instances of all scenes
  PositionTable positions;             // where an error was asked for
  double position_error = 0;           // largest found, model units, per axis
  double position_error_bound = 0;     // largest stated in a mesh record
  double relative_position_error = 0;  // largest found / diagonal of the mesh's box
  double seconds = 0;
  uint64_t peak_bytes = 0;  // resident and not of a file, of the whole process: RssAnon + RssShmem
  uint32_t threads = 0;     // that encoded
  uint32_t threads_asked = 0;
  uint32_t resumed_pages = 0;       // of an earlier run, that were not made again
  uint64_t dropped_degenerate = 0;  // triangles of strips and fans with two equal indices
  uint64_t dropped_nonfinite = 0;
  uint64_t sorted_triangles = 0;   // of primitives without locality
  uint64_t sort_file_bytes = 0;    // that the temporary file for them takes at most
  uint64_t windows = 0;            // of the meshes that are stored
  uint64_t windows_ahead = 0;      // of them, that were encoded before all were measured
  uint64_t windows_guessed = 0;    // given to be encoded before their own mesh was measured whole
  uint64_t windows_discarded = 0;  // that were encoded in vain: their mesh became another than the source states
  StageRates rates;
  std::vector<std::string> warnings;  // one line each
};

/// Converts. On an error nothing is left at `output` that was not there before; with ConvertOptions::resume there may
/// be an unfinished .part. One that an earlier run left stays as it is where checking or measuring finds the source
/// bad, and is replaced once there is something to be written instead. Errors kUsage (options that exclude each other
/// or are out of range, output is the input), those of import_gltf, measure, check_images, write_images, encode_window
/// and ContainerWriter; kUsage where ConvertOptions::memory is too little, with the least that is needed. The bytes
/// written are the same for any number of threads and any memory.
Result<ConvertReport> convert(const ConvertOptions& options);

/// "read 2.30 GiB/s, measure 493 M triangles/s, ...: encoding limits, 15 of 16 threads (--memory), ...".
std::string describe_work(const ConvertReport& report);

/// "a.glb -> a.scree: 1.41 MiB -> 283 KiB, ratio 5.10, ..." in one line.
std::string describe(const ConvertOptions& options, const ConvertReport& report);

}  // namespace scree::convert
