#include "tools/render/layers.h"

#include <cstdio>
#include <new>
#include <string>
#include <utility>

#include "tools/render/exr.h"

namespace scree::tools {
namespace {

using runtime::Layer;

uint64_t pixels_of(const RenderOptions& options) {
  return uint64_t{options.camera.width} * options.camera.height;
}

template <class T>
Result<std::vector<T>> read(const RenderOptions& options, const ReadLayer& frame, Layer layer) {
  std::vector<T> values(pixels_of(options) * runtime::bytes_of(layer) / sizeof(T));
  SCREE_TRY(frame(layer, std::as_writable_bytes(std::span(values))));
  return values;
}

Result<std::vector<uint32_t>> make_ids(const RenderOptions& options, const runtime::Scene& scene,
                                       const ReadLayer& frame) {
  const std::vector<int64_t> triangles = SCREE_TRY(read<int64_t>(options, frame, Layer::kTriangle));
  const std::vector<int32_t> instances = SCREE_TRY(read<int32_t>(options, frame, Layer::kInstance));
  const kernels::SceneView& view = scene.view();
  std::vector<uint32_t> ids(kIdCount * instances.size(), UINT32_MAX);
  for (size_t i = 0; i < instances.size(); ++i) {
    if (instances[i] < 0) continue;
    const auto instance = static_cast<uint64_t>(instances[i]);
    const uint32_t mesh = view.instances[instance].mesh;
    const uint64_t triangle = static_cast<uint64_t>(triangles[i]) - view.instance_base[instance];
    if (triangle >= UINT32_MAX)
      return Error{ErrorCode::kUnsupported, "triangle " + std::to_string(triangle) + " of mesh " +
                                                std::to_string(mesh) +
                                                ": channels of an .exr have 32 bits; leave id out of --layers"};
    uint32_t* const out = ids.data() + kIdCount * i;
    out[0] = static_cast<uint32_t>(instance);
    out[1] = mesh;
    out[2] = view.meshes[mesh].material;
    out[3] = static_cast<uint32_t>(triangle);
  }
  static_assert(format::kNone == UINT32_MAX);  // the value for a mesh without a material
  return ids;
}

}  // namespace

bool layers_need_samples(const RenderOptions& options) {
  return options.writes_exr() && options.layers.color;
}

uint64_t layer_bytes(const RenderOptions& options) {
  const uint64_t pixels = pixels_of(options);
  const uint64_t samples = pixels * options.samples_per_side * options.samples_per_side;
  const bool exr = options.writes_exr();
  uint64_t bytes = 0;
  if (exr && options.layers.color)
    bytes += 12 * samples + (16 + 8 + 4) * pixels;  // includes the half floats and occlusion
  if (!options.depth.empty() || (exr && options.layers.depth)) bytes += 4 * pixels;
  if (!options.normals.empty() || (exr && options.layers.normal)) bytes += 12 * pixels;
  if (!options.uvs.empty() || (exr && options.layers.uv)) bytes += 8 * pixels;
  if (!options.uvs.empty()) bytes += 12 * pixels;
  if (exr && options.layers.id) bytes += (4 * kIdCount + 12) * pixels;
  return bytes;
}

Result<FrameLayers> make_layers(const RenderOptions& options, const runtime::Scene& scene, const ReadLayer& frame,
                                bool is_streamed) {
  const bool exr = options.writes_exr();
  const bool with_surface = exr && (!is_streamed || options.layers.are_chosen);
  if (exr && !with_surface && (options.layers.normal || options.layers.uv) && !options.quiet)
    std::fprintf(stderr,
                 "scree render: warning: %s: without the layers normal and uv, which a GPU cannot make while it "
                 "streams chunks; more "
                 "--device-memory or --backend cpu avoids that\n",
                 options.output.c_str());
  FrameLayers out;
  try {
    if (exr && options.layers.color) out.color = SCREE_TRY(read<float>(options, frame, Layer::kLinear));
    if (!options.depth.empty() || (exr && options.layers.depth))
      out.depth = SCREE_TRY(read<float>(options, frame, Layer::kDepth));
    if (!options.normals.empty() || (with_surface && options.layers.normal))
      out.normals = SCREE_TRY(read<float>(options, frame, Layer::kNormal));
    if (!options.uvs.empty() || (with_surface && options.layers.uv))
      out.uvs = SCREE_TRY(read<float>(options, frame, Layer::kUv));
    if (exr && options.layers.id) out.ids = SCREE_TRY(make_ids(options, scene, frame));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for the layers of the picture"};
  }
  return out;
}

Result<void> write_exr_layers(const RenderOptions& options, const FrameLayers& layers) {
  std::vector<ExrChannel> channels;
  const auto add = [&](const auto& values, ExrType type, std::initializer_list<const char*> names) {
    if (values.empty()) return;
    const auto stride = static_cast<uint32_t>(names.size());
    const auto* value = values.data();
    for (const char* const name : names) channels.push_back({name, type, value++, stride});
  };
  add(layers.color, options.layers.float_color ? ExrType::kFloat : ExrType::kHalf, {"R", "G", "B", "A"});
  if (options.layers.depth) add(layers.depth, ExrType::kFloat, {"Z"});
  if (options.layers.normal) add(layers.normals, ExrType::kFloat, {"N.X", "N.Y", "N.Z"});
  if (options.layers.uv) add(layers.uvs, ExrType::kFloat, {"UV.U", "UV.V"});
  add(layers.ids, ExrType::kUint, {"id.instance", "id.mesh", "id.material", "id.triangle"});
  return write_exr(options.output, options.camera.width, options.camera.height, channels, options.existing);
}

std::vector<float> three_channels(const std::vector<float>& uvs) {
  std::vector<float> out(uvs.size() / 2 * 3);
  for (size_t i = 0; i < uvs.size(); ++i) out[i / 2 * 3 + i % 2] = uvs[i];
  return out;
}

}  // namespace scree::tools
