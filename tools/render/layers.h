// The layers of a frame beside its 8-bit picture: values per pixel, for .pfm files and channels of an .exr.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/draw/device_view.h"
#include "runtime/scene/scene.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Layers row by row from the top; empty if not requested.
struct FrameLayers {
  std::vector<float> color;    // linear RGBA, premultiplied
  std::vector<float> depth;    // 1 per pixel
  std::vector<float> normals;  // 3
  std::vector<float> uvs;      // 2
  std::vector<uint32_t> ids;   // kIdCount: instance, mesh, material, triangle of the mesh; all ones if there is none
};
inline constexpr uint32_t kIdCount = 4;

/// Makes a layer of a frame, as ViewRenderer::read().
using ReadLayer = std::function<Result<void>(runtime::Layer layer, std::span<std::byte> out)>;

/// Host memory for the layers and for making and writing them, in addition to the samples.
uint64_t layer_bytes(const RenderOptions& options);

/// Whether `options` request layers that are made from the samples on the host.
bool layers_need_samples(const RenderOptions& options);

/// Makes the layers that `options` request. `is_streamed`: an .exr then has no normals and texture coordinates, unless
/// --layers selects the layers. Errors kUnsupported (more triangles in a mesh than 32 bits count), kMemory, those of
/// `frame`.
Result<FrameLayers> make_layers(const RenderOptions& options, const runtime::Scene& scene, const ReadLayer& frame,
                                bool is_streamed);

/// Writes options.output, an .exr. Errors as write_exr().
Result<void> write_exr_layers(const RenderOptions& options, const FrameLayers& layers);

/// Texture coordinates in the form for a .pfm: three values per pixel, the last one 0. Throws std::bad_alloc.
std::vector<float> three_channels(const std::vector<float>& uvs);

}  // namespace scree::tools
