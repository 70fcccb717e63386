// Writes generated scenes as glTF: the measured scenes A, B, C and D, the slope of stones, the forest, panes of glass,
// and two scenes with the counts of Zorah.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "format/container/part_file.h"
#include "format/result.h"
#include "tools/synth/scenes.h"

namespace scree::synth {

struct SynthOptions {
  // "A", "B", "C", "D", "slope", "forest", "panes", "panes-textured", "zorah" or "zorah-textured"
  std::string scene;
  std::string output;  // .gltf or .glb; may be empty with `checks`, which then writes no file
  double scale = 1;    // 0 < scale <= 1: scenes.h, slope.h, forest.h, panes.h, zorah_plan.h
  MeshOrder order = MeshOrder::kRow;
  bool normals = false;  // A to D: NORMAL of the surface, from central differences (one-sided at a blob's face edges)
  bool uvs = false;      // A to D: TEXCOORD_0, with every grid as the unit square, and a texture
  bool gpu_instancing =
      false;            // EXT_mesh_gpu_instancing (float TRS; bit-exact matrices for A, B and D) instead of a node each
  bool checks = false;  // A to D: compute the sums
  bool json = false;    // prints the report as JSON
  uint32_t threads = 0;  // 0: one per processor; the output does not depend on it
  uint32_t seed = 1;     // slope and forest only
  // Slope, forest, panes-textured: texels per side, a power of two from 64 to 8192; unset: 1024, for the forest 4096.
  std::optional<uint32_t> texture_size;
  format::Existing existing = format::Existing::kReplace;  // for all files of the output
  const std::atomic<bool>* stop = nullptr;                 // if set, writing ends with kFile "interrupted"
  bool progress = false;                                   // A to D: a line on stderr if that is a terminal
};

struct SynthReport {
  uint64_t unique_triangles = 0;
  uint64_t drawn_triangles = 0;
  uint64_t vertices = 0;
  uint64_t instances = 0;
  uint64_t file_bytes = 0;
  uint64_t position_sum = 0;  // sum of check_term over all position floats
  uint64_t index_sum = 0;     // the same over all indices
};

/// Makes the scene and writes it. Memory: about 2 MiB per thread, 200 bytes per instance, and 5 bytes per texel of the
/// forest; for zorah see zorah.h. Errors kUsage (options that contradict each other), kFile, kRange (a .glb past 4
/// GiB), after which no file is left on the disk.
Result<SynthReport> synthesize(const SynthOptions& options);

/// Writes scene A, B, C or D; a part of synthesize().
Result<SynthReport> write_scene(const Scene& scene, const SynthOptions& options);

}  // namespace scree::synth
