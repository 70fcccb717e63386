// A scene of many large JPEG textures: what decoding them as they are looked at is measured with.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "format/result.h"
#include "tools/synth/scenes.h"

namespace scree::synth {

struct TexturedOptions {
  std::string output;     // .gltf; the textures lie beside it
  uint32_t meshes = 12;   // each with a texture of its own
  uint32_t size = 16384;  // texels a side, a multiple of `stone`, at most 32768
  uint32_t stone = 1024;  // of the pictures that textures are made of; a power of two, at least 32
  uint32_t threads = 0;   // 0: as many as the machine runs at once
};

struct TexturedReport {
  uint64_t triangles = 0;
  uint64_t texture_bytes = 0;  // of the JPEG files
};

/// Writes a terrain of `meshes` square tiles of 2 x 256 x 256 triangles, in rows of five (+z is up), each covered once
/// by its texture: JPEGs of quality 90, 4:2:0, detailed everywhere. The same bytes for any number of threads. Holds all
/// JPEGs. Errors kUsage, kFile, kMemory.
Result<TexturedReport> write_textured(const TexturedOptions& options);

/// From where it is seen: all of it, and near its ground.
std::array<SceneCamera, 2> textured_cameras();

}  // namespace scree::synth
