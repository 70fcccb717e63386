// A scene of many large JPEG textures, to measure their decoding on demand.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "format/result.h"
#include "tools/synth/scenes.h"

namespace scree::synth {

struct TexturedOptions {
  std::string output;     // .gltf; the textures lie beside it
  uint32_t meshes = 12;   // each mesh has its own texture
  uint32_t size = 16384;  // texels per side, a multiple of `stone`, at most 32768
  uint32_t stone = 1024;  // side of the pictures that textures consist of; a power of two, at least 32
  uint32_t threads = 0;   // 0: one per processor
};

struct TexturedReport {
  uint64_t triangles = 0;
  uint64_t texture_bytes = 0;  // of the JPEG files
};

/// Writes a terrain of `meshes` square tiles of 2 x 256 x 256 triangles, in rows of five (+z is up). Each tile is
/// covered once by its texture: a JPEG of quality 90, 4:2:0, detailed everywhere. The bytes are the same for any number
/// of threads. Holds all JPEGs in memory. Errors kUsage, kFile, kMemory.
Result<TexturedReport> write_textured(const TexturedOptions& options);

/// The cameras: a view of everything, and one near its ground.
std::array<SceneCamera, 2> textured_cameras();

}  // namespace scree::synth
