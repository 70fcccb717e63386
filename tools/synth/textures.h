// Procedural stone textures: tileable, and the same bytes for the same size and any number of threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "tools/gltf/write/writer.h"

namespace scree::synth {

enum class TextureKind : uint8_t { kGranite, kSandstone, kSlate, kGround };

/// `size` x `size` sRGB pixels, 3 bytes each, rows top to bottom; `size` is a power of two, at least 32. The texture
/// continues seamlessly across its borders. Source of the colours: invented, after photographs of Alpine scree.
/// Error kFile "interrupted" once `stop` is raised; null: never.
Result<std::vector<uint8_t>> make_texture(TextureKind kind, uint32_t size, uint32_t threads,
                                          const std::atomic<bool>* stop = nullptr);

/// A texture to make, and its name in the document.
struct TextureRecipe {
  std::string name;
  TextureKind kind = TextureKind::kGranite;
  uint32_t size = 512;
  format::ImageCodec codec = format::ImageCodec::kJpeg;
};

/// Makes the texture, stores it and returns its index in the document (repeating, trilinear). `stop`: as above.
Result<uint32_t> add_texture(tools::GltfWriter& writer, const TextureRecipe& recipe, uint32_t threads,
                             const std::atomic<bool>* stop);

}  // namespace scree::synth
