// What is written of a frame beside its 8-bit picture: layers of numbers, as .pfm files and as channels of an .exr.
#pragma once

#include <cstdint>
#include <vector>

#include "format/result.h"
#include "runtime/draw/renderer.h"
#include "runtime/scene/scene.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Row by row from the top; empty where they are not asked for.
struct FrameLayers {
  std::vector<float> color;    // linear RGBA, premultiplied
  std::vector<float> depth;    // 1 a pixel
  std::vector<float> normals;  // 3
  std::vector<float> uvs;      // 2
  std::vector<uint32_t> ids;   // kIdCount: instance, mesh, material, triangle of the mesh; all ones where there is none
  kernels::BlendCounts blended;  // in `color`
};
inline constexpr uint32_t kIdCount = 4;

/// Host memory that they take, with what making and writing them takes beside the samples.
uint64_t layer_bytes(const RenderOptions& options);

/// Whether `options` want layers that are made of the samples on the host.
bool layers_need_samples(const RenderOptions& options);

/// What `options` ask for. `is_streamed`: normals and texture coordinates are left out of an .exr then, unless it is
/// --layers that asks for them. Errors kUnsupported (more triangles in a mesh than 32 bits count), those of
/// Frame::layer() and Frame::linear().
Result<FrameLayers> make_layers(const RenderOptions& options, const runtime::Scene& scene, const runtime::Frame& frame,
                                bool is_streamed);

/// Writes options.output, an .exr. Errors as write_exr().
Result<void> write_exr_layers(const RenderOptions& options, const runtime::Frame& frame, const FrameLayers& layers);

/// Texture coordinates as a .pfm has them: three a pixel, the last 0. Throws std::bad_alloc.
std::vector<float> three_channels(const std::vector<float>& uvs);

}  // namespace scree::tools
