// CudaResolver: runs the passes of pixels.h on the caller's stream, a warp per tile of 8 x 4 pixels.
#include <cuda_runtime.h>

#include <string>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/shade/pixels.cuh"
#include "kernels/cuda/shade/resolve.h"
#include "kernels/shade/ambient_occlusion.h"
#include "kernels/shade/blend.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/stored_colors.h"

namespace scree::kernels {
namespace {

/// Blocks that a multiprocessor should hold. This limits the registers of a pass.
template <class Pass>
inline constexpr uint32_t kResidentBlocks = 6;  // 80 registers per thread
template <bool kOrthographic, ChunkKinds kKinds>
inline constexpr uint32_t kResidentBlocks<Resolve<Shader<kOrthographic, Show::kColor, kKinds>>> = 8;  // 64
template <bool kOrthographic, ChunkKinds kKinds>
inline constexpr uint32_t kResidentBlocks<Resolve<Shader<kOrthographic, Show::kTexture, kKinds>>> = 5;  // 96
template <bool kOrthographic>
inline constexpr uint32_t kResidentBlocks<Resolve<Shader<kOrthographic, Show::kStage>>> = 4;  // 128, for the clipper

template <bool kOrthographic>
inline constexpr uint32_t kResidentBlocks<Resolve<Shader<kOrthographic, Show::kSurface>>> = 4;  // 128

template <class Shader>
inline constexpr uint32_t kResidentBlocks<ShadePart<Shader>> = 4;

template <class Pass>
__global__ void __launch_bounds__(kPixelThreads, kResidentBlocks<Pass>)
    run_pixels(const __grid_constant__ Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, PixelTeam{});
}

/// Makes the transforms of 32 instances per item.
struct MakeTransforms {
  SceneView scene;
  FrameView view;
  Transform* transforms;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const uint64_t i = uint64_t{item} * Team::size() + team.rank();
    if (i >= scene.instance_count) return;
    const format::InstanceRecord& instance = scene.instances[i];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    transforms[i] = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                   mesh.position_encoding == format::PositionEncoding::kFloat32);
  }
};

__global__ void clear_depth_range(DepthRange* range) {
  *range = DepthRange{};
}

}  // namespace

struct CudaResolver::Impl {
  enum Event { kStart, kShading, kEnd, kEventCount };

  Result<void> open() {
    if (tables.data() != nullptr) return {};
    DeviceBuffer made =
        SCREE_TRY(DeviceBuffer::allocate(kRangeOffset + sizeof(DepthRange), "allocating the tables of sRGB"));
    SCREE_TRY(cuda_check(cudaMemcpy(made.data(), &srgb_tables(), sizeof(SrgbTables), cudaMemcpyHostToDevice),
                         "copying the tables of sRGB"));
    tables = std::move(made);
    return {};
  }
  const SrgbTables* srgb() const { return reinterpret_cast<const SrgbTables*>(tables.data()); }
  DepthRange* depth_range() const { return reinterpret_cast<DepthRange*>(tables.data() + kRangeOffset); }

  Result<void> record(Event event, cudaStream_t stream) {
    if (events[event] == nullptr) SCREE_TRY(events[event].make());
    return cuda_check(cudaEventRecord(events[event], stream), "recording a time");
  }

  Result<void> elapsed(Event from, Event to, float& ms) const {
    return cuda_check(cudaEventElapsedTime(&ms, events[from], events[to]), "reading a time");
  }

  template <class Pass>
  static Result<void> run(const Pass& pass, uint32_t count, cudaStream_t stream) {
    return start_items(run_pixels<Pass>, pass, count, stream, "starting a pass of the resolve");
  }

  /// The steps before shading a picture of side * side samples per pixel. Returns the factors of the pixels' light, or
  /// null if `options` requests no occlusion. If buffers grow, cudaFree waits for the stream's earlier work with them.
  Result<const float*> begin(const View& view, uint32_t side, const uint64_t* samples, const ShadeOptions& options,
                             cudaStream_t stream, const ResolveTimes* times) {
    SCREE_TRY(check_resolve(view, side));
    SCREE_TRY(open());
    if (times != nullptr) SCREE_TRY(record(kStart, stream));
    const float* visibility = nullptr;
    if (options.ssao || options.edl) {
      const uint64_t count = uint64_t{view.width / side} * (view.height / side);
      SCREE_TRY(occlusion.reserve(3 * count * sizeof(float), "allocating the occlusion"));
      auto* const depth = reinterpret_cast<float*>(occlusion.data());
      visibility = depth + 2 * count;
      Result<void> started;
      run_occlusion(view, side, samples, options, depth, depth + count, depth + 2 * count,
                    [&](const auto& pass, uint32_t items) {
                      if (started) started = run(pass, items, stream);
                    });
      if (!started) return started.error();
    }
    if (times != nullptr) SCREE_TRY(record(kShading, stream));
    return visibility;
  }

  /// `transforms` of `view` if they are null.
  Result<void> make_transforms(const SceneView& scene, const View& view, const Transform*& made, cudaStream_t stream) {
    if (made != nullptr) return {};
    SCREE_TRY(transforms.reserve(scene.instance_count * sizeof(Transform), "allocating transforms"));
    auto* const all = reinterpret_cast<Transform*>(transforms.data());
    made = all;
    return run(MakeTransforms{scene, make_frame_view(view), all},
               static_cast<uint32_t>((scene.instance_count + 31) / 32), stream);
  }

  Result<void> end(cudaStream_t stream, ResolveTimes* times) {
    if (times == nullptr) return {};
    SCREE_TRY(record(kEnd, stream));
    SCREE_TRY(cuda_check(cudaEventSynchronize(events[kEnd]), "resolving"));
    SCREE_TRY(elapsed(kStart, kShading, times->occlusion_ms));
    return elapsed(kShading, kEnd, times->resolve_ms);
  }

  static constexpr uint64_t kRangeOffset = (sizeof(SrgbTables) + 15) & ~uint64_t{15};

  DeviceBuffer tables;  // of sRGB, followed by the range of depths
  DeviceBuffer transforms;
  DeviceBuffer occlusion;  // three floats per pixel: depth, obscurance, visibility
  DeviceEvent events[kEventCount];
};

CudaResolver::CudaResolver() : impl_(std::make_unique<Impl>()) {}
CudaResolver::CudaResolver(CudaResolver&&) noexcept = default;
CudaResolver& CudaResolver::operator=(CudaResolver&&) noexcept = default;
CudaResolver::~CudaResolver() = default;

Result<void> CudaResolver::resolve(const SceneView& scene, const View& view, uint32_t samples_per_side,
                                   const uint64_t* samples, const Transform* transforms, const ShadeOptions& options,
                                   uint32_t* pixels, cudaStream_t stream, ResolveTimes* times, CudaTextureCache* cache,
                                   std::span<const RowRange> rows) {
  Impl& impl = *impl_;
  const float* const visibility = SCREE_TRY(impl.begin(view, samples_per_side, samples, options, stream, times));
  const uint32_t width = view.width / samples_per_side;
  SCREE_TRY(impl.make_transforms(scene, view, transforms, stream));
  if (options.show == Show::kDepth) {
    clear_depth_range<<<1, 1, 0, stream>>>(impl.depth_range());
    SCREE_TRY(cuda_check(cudaGetLastError(), "clearing the range of depths"));
    SCREE_TRY(impl.run(FindDepthRange{samples, view.width, impl.depth_range()}, view.height, stream));
  }
  const ShadeInputs inputs = make_shade_inputs(scene, view, options, transforms, impl.srgb(), impl.depth_range());
  const RowRange all{0, view.height / samples_per_side};
  if (rows.empty()) rows = {&all, 1};
  for (const RowRange& range : rows) {
    const PixelTiles band{width, range.first, range.end - range.first};
    uint32_t* const out = pixels + uint64_t{range.first} * width;
    if (cache != nullptr && options.show == Show::kTexture) {
      SCREE_TRY(cache->resolve(inputs, band, samples, samples_per_side, visibility, out, stream));
      continue;
    }
    Result<void> started;
    visit_shader<true>(inputs, [&]<class Shader>(const Shader& shader) {
      started = impl.run(
          Resolve<Shader>{shader, band, samples, samples_per_side, visibility, 4, reinterpret_cast<uint8_t*>(out)},
          band.count(), stream);
    });
    if (!started) return started;
  }
  return impl.end(stream, times);
}

void CudaResolver::load(const SceneView& scene, uint32_t samples_per_side, const ShadeOptions& options,
                        bool has_cache) {
  ShadeInputs inputs{};
  inputs.scene = scene;
  inputs.options = options;
  if (has_cache && options.show == Show::kTexture) return CudaTextureCache::load(inputs, samples_per_side);
  visit_shader<true>(inputs, []<class Shader>(const Shader&) { load_kernel(run_pixels<Resolve<Shader>>); });
}

Result<void> CudaResolver::shade_part(const SceneView& scene, const View& view, const uint64_t* samples,
                                      const Transform* transforms, const ShadeOptions& options, float* colors,
                                      cudaStream_t stream, CudaTextureCache* cache) {
  SCREE_TRY(check_frame(view, 0));
  Impl& impl = *impl_;
  SCREE_TRY(impl.open());
  SCREE_TRY(impl.make_transforms(scene, view, transforms, stream));
  const PixelTiles tiles{view.width, 0, view.height};
  const ShadeInputs inputs = make_shade_inputs(scene, view, options, transforms, impl.srgb(), nullptr);
  if (cache != nullptr && options.show == Show::kTexture)
    return cache->shade_part(inputs, tiles, samples, colors, stream);
  Result<void> started;
  visit_shader<true>(inputs, [&]<class Shader>(const Shader& shader) {
    started = impl.run(ShadePart<Shader>{shader, tiles, samples, colors}, tiles.count(), stream);
  });
  return started;
}

Result<void> CudaResolver::resolve_colors(const View& view, uint32_t samples_per_side, const uint64_t* samples,
                                          const float* colors, const float* over, const ShadeOptions& options,
                                          uint32_t* pixels, cudaStream_t stream, ResolveTimes* times) {
  Impl& impl = *impl_;
  const float* const visibility = SCREE_TRY(impl.begin(view, samples_per_side, samples, options, stream, times));
  const PixelTiles tiles{view.width / samples_per_side, 0, view.height / samples_per_side};
  const ShadeInputs in = make_shade_inputs(SceneView{}, view, options, nullptr, impl.srgb(), nullptr);
  const auto run = [&]<class Shader>(const Shader& shader) {
    return impl.run(
        Resolve<Shader>{shader, tiles, samples, samples_per_side, visibility, 4, reinterpret_cast<uint8_t*>(pixels)},
        tiles.count(), stream);
  };
  SCREE_TRY(over != nullptr ? run(BlendedColors{{in, colors}, over}) : run(StoredColors{in, colors}));
  return impl.end(stream, times);
}

}  // namespace scree::kernels
