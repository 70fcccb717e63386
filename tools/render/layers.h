// The layers of a frame beside its 8-bit picture: values per pixel, for .pfm files and channels of an .exr.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/draw/renderer.h"
#include "runtime/scene/scene.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Layers row by row from the top; empty if not requested.
struct FrameLayers {
  std::vector<float> color;      // linear RGBA, premultiplied
  std::vector<float> depth;      // 1 per pixel
  std::vector<float> normals;    // 3
  std::vector<float> uvs;        // 2
  std::vector<uint32_t> ids;     // kIdCount: instance, mesh, material, triangle of the mesh; all ones if there is none
  kernels::BlendCounts blended;  // in `color`
};
inline constexpr uint32_t kIdCount = 4;

/// How a frame's layers are made.
struct LayersOfFrame {
  std::function<Result<void>(runtime::PixelLayer layer, std::span<std::byte> out)> read;  // Frame::read_layer()
  std::function<Result<std::vector<float>>(kernels::BlendCounts& blended)> linear;        // Frame::linear()
};

/// Host memory for the layers and for making and writing them, in addition to the samples.
uint64_t layer_bytes(const RenderOptions& options);

/// Whether `options` request layers that are made from the samples on the host.
bool layers_need_samples(const RenderOptions& options);

/// Makes the layers that `options` request. `is_streamed`: an .exr then has no normals and texture coordinates, unless
/// --layers selects the layers. Errors kUnsupported (more triangles in a mesh than 32 bits count), kMemory, those of
/// `frame`.
Result<FrameLayers> make_layers(const RenderOptions& options, const runtime::Scene& scene, const LayersOfFrame& frame,
                                bool is_streamed);

/// Writes options.output, an .exr. Errors as write_exr().
Result<void> write_exr_layers(const RenderOptions& options, const FrameLayers& layers);

/// Texture coordinates in the form for a .pfm: three values per pixel, the last one 0. Throws std::bad_alloc.
std::vector<float> three_channels(const std::vector<float>& uvs);

}  // namespace scree::tools
