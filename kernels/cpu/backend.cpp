#include "kernels/cpu/backend.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <limits>
#include <mutex>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "kernels/frame_parts.h"
#include "kernels/shade/layers.h"
#include "kernels/shade/pixels.h"

namespace scree::kernels {

void* allocate_aligned(uint64_t bytes) {
  if (bytes > (uint64_t{1} << 46)) return nullptr;
  return ::operator new (bytes, std::align_val_t{64}, std::nothrow);
}

void release_aligned(void* memory) {
  ::operator delete (memory, std::align_val_t{64});
}

void* Scratch::room(uint64_t bytes) {
  if (bytes > bytes_) {
    release_aligned(memory_);
    bytes_ = std::max(bytes, 2 * bytes_);
    memory_ = allocate_aligned(bytes_);
    if (memory_ == nullptr) bytes_ = 0;
  }
  return memory_;
}

struct ThreadPool::Impl {
  std::vector<std::thread> workers;
  std::vector<Scratch> scratch;  // per thread
  std::mutex mutex;
  std::condition_variable work_ready;
  std::condition_variable work_done;
  uint64_t generation = 0;  // number of the current work, below
  uint32_t working = 0;
  bool stop = false;

  Run run = nullptr;
  const void* context = nullptr;
  uint64_t count = 0;
  uint64_t grain = 1;
  std::atomic<uint64_t> next{0};

  void take_shares(uint32_t thread) {
    for (;;) {
      const uint64_t first = next.fetch_add(grain, std::memory_order_relaxed);
      if (first >= count) return;
      run(context, first, std::min(first + grain, count), thread);
    }
  }

  void work(uint32_t thread) {
    uint64_t seen = 0;
    for (;;) {
      {
        std::unique_lock lock(mutex);
        work_ready.wait(lock, [&] { return stop || generation != seen; });
        if (stop) return;
        seen = generation;
      }
      take_shares(thread);
      std::lock_guard lock(mutex);
      if (--working == 0) work_done.notify_one();
    }
  }
};

ThreadPool::ThreadPool(uint32_t threads) : impl_(std::make_unique<Impl>()) {
  constexpr uint32_t kMostThreads = 1024;
  const uint32_t wanted = std::clamp(threads, 1u, kMostThreads);
  impl_->scratch = std::vector<Scratch>(wanted);
  impl_->workers.reserve(wanted - 1);
  try {
    for (uint32_t i = 1; i < wanted; ++i) impl_->workers.emplace_back([impl = impl_.get(), i] { impl->work(i); });
  } catch (const std::exception&) {
    // The system refused a thread, or memory ran out. Fewer threads draw the same picture.
  }
}

ThreadPool::~ThreadPool() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->work_ready.notify_all();
  for (std::thread& worker : impl_->workers) worker.join();
}

uint32_t ThreadPool::size() const {
  return static_cast<uint32_t>(impl_->workers.size()) + 1;
}

void ThreadPool::for_each(uint64_t count, uint64_t grain, Run run, const void* context) {
  if (count == 0) return;
  // Waking the other threads takes longer than a few items do.
  if (impl_->workers.empty() || count <= grain) {
    run(context, 0, count, 0);
    return;
  }
  {
    std::lock_guard lock(impl_->mutex);
    impl_->run = run;
    impl_->context = context;
    impl_->count = count;
    impl_->grain = grain;
    impl_->next.store(0, std::memory_order_relaxed);
    impl_->working = static_cast<uint32_t>(impl_->workers.size());
    ++impl_->generation;
  }
  impl_->work_ready.notify_all();
  impl_->take_shares(0);
  std::unique_lock lock(impl_->mutex);
  impl_->work_done.wait(lock, [&] { return impl_->working == 0; });
}

Scratch& ThreadPool::scratch(uint32_t thread) {
  return impl_->scratch[thread];
}

InstructionSet best_instruction_set() {
#if defined(SCREE_HAS_AVX2)
  static const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  return avx2 ? InstructionSet::kAvx2 : InstructionSet::kBaseline;
#else
  return InstructionSet::kBaseline;
#endif
}

namespace {

const CpuPasses& passes_for([[maybe_unused]] InstructionSet set) {
#if defined(SCREE_HAS_AVX2)
  if (set == InstructionSet::kAvx2) return isa_avx2::kPasses;
#endif
  return isa_baseline::kPasses;
}

Result<void> check_picture(const View& view, uint64_t values, uint64_t values_a_sample, const char* what) {
  if (view.width < 1 || view.width > kMaxImageSide || view.height < 1 || view.height > kMaxImageSide) {
    return Error{ErrorCode::kRange, "image of " + std::to_string(view.width) + " x " + std::to_string(view.height) +
                                        " samples, but a side is 1 to " + std::to_string(kMaxImageSide)};
  }
  const uint64_t expected = uint64_t{view.width} * view.height * values_a_sample;
  if (values != expected) {
    return Error{ErrorCode::kRange,
                 std::to_string(values) + " " + what + ", but the image has " + std::to_string(expected)};
  }
  return {};
}

Result<void> check_view(const View& view) {
  bool sane =
      view.half_width > 0 && view.half_height > 0 && std::isfinite(view.half_width) && std::isfinite(view.half_height);
  for (int i = 0; i < 3; ++i) {
    sane = sane && std::isfinite(view.eye[i]) && std::isfinite(view.right[i]) && std::isfinite(view.up[i]) &&
           std::isfinite(view.forward[i]);
  }
  if (view.orthographic) {
    sane = sane && std::isfinite(view.z_near) && std::isfinite(view.z_far) && view.z_far > view.z_near;
  } else {
    sane = sane && std::isfinite(view.z_near) && view.z_near > 0;
  }
  bool has_room = true;
  for (int i = 0; i < 3 && view.clips; ++i) {
    has_room = has_room && std::isfinite(view.clip_min[i]) && std::isfinite(view.clip_max[i]) &&
               view.clip_min[i] <= view.clip_max[i];
  }
  if (!has_room)
    return Error{ErrorCode::kRange, "clipping box that is infinite or whose corners are in the wrong order"};
  if (sane) return {};
  return Error{ErrorCode::kRange, "camera with an empty or infinite field of view, position or range of depth"};
}

Error out_of_memory() {
  return {ErrorCode::kMemory, "no memory left for the queues of the frame"};
}

}  // namespace

Result<void> check_frame(const View& view, uint64_t triangle_count) {
  SCREE_TRY(check_picture(view, uint64_t{view.width} * view.height, 1, "samples"));
  SCREE_TRY(check_view(view));
  if (triangle_count > kIdMask) {
    return Error{ErrorCode::kRange,
                 std::to_string(triangle_count) + " drawn triangles, but ids end at " + std::to_string(kIdMask)};
  }
  return {};
}

namespace {

Result<FrameStats> draw_into(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                             const uint64_t* peeled, bool clear, uint32_t threads, InstructionSet set,
                             const QueueSizes& sizes) try {
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  const uint64_t triangles = scene.instance_count == 0 ? 0 : scene.instance_base[scene.instance_count];
  SCREE_TRY(check_frame(view, triangles));
  ThreadPool pool(threads);
  FrameStats stats{};
  if (!passes_for(set).draw(pool, scene, view, samples.data(), peeled, clear, sizes, stats)) return out_of_memory();
  return stats;
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

}  // namespace

Result<FrameStats> draw_cpu_with(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads, InstructionSet set, const QueueSizes& sizes) {
  return draw_into(scene, view, samples, nullptr, true, threads, set, sizes);
}

Result<FrameStats> draw_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples, uint32_t threads) {
  return draw_cpu_with(scene, view, samples, threads, best_instruction_set(), QueueSizes{});
}

Result<FrameStats> draw_part_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads) {
  return draw_into(scene, view, samples, nullptr, false, threads, best_instruction_set(), QueueSizes{});
}

Result<void> draw_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* peeled,
                            uint32_t threads) {
  SCREE_TRY(draw_into(scene, view, {at.drawn, at.sample_count}, peeled, false, threads, best_instruction_set(),
                      QueueSizes{}));
  return {};
}

Result<void> check_resolve(const View& view, uint32_t samples_per_side) {
  if (samples_per_side != 1 && samples_per_side != 2 && samples_per_side != 4)
    return Error{ErrorCode::kRange,
                 std::to_string(samples_per_side) + " samples per side of a pixel, expected 1, 2 or 4"};
  if (view.width % samples_per_side != 0 || view.height % samples_per_side != 0)
    return Error{ErrorCode::kRange, std::to_string(view.width) + " x " + std::to_string(view.height) +
                                        " samples make no whole pixels of " + std::to_string(samples_per_side) +
                                        " per side"};
  return check_frame(view, 0);
}

namespace {

/// Shades all tiles of a picture of `scene`, in rounds if it has paged levels. `run(round)`: as CpuPasses::resolve.
template <class Run>
Result<void> shade_tiles(const SceneView& scene, uint32_t width, uint32_t height, const Run& run) {
  const uint32_t count = PixelTiles{width, 0, height}.count();
  if (scene.pager != nullptr)
    return shade_in_rounds(*scene.pager, count,
                           [&](std::span<const UnfinishedTile> tiles, UnfinishedTile* left) -> Result<uint32_t> {
                             if (tiles.empty()) return run(TileRound{nullptr, count, left});
                             return run(TileRound{tiles.data(), static_cast<uint32_t>(tiles.size()), left});
                           });
  run(TileRound{nullptr, count, nullptr});
  return {};
}

/// Shared by both functions that make finished pixels. `run(pool, visibility)`: `visibility` is null if `options`
/// requests no occlusion.
template <class Run>
Result<void> resolve_with(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                          const ShadeOptions& options, uint32_t channels, std::span<uint8_t> pixels, uint32_t threads,
                          const Run& run) try {
  SCREE_TRY(check_resolve(view, samples_per_side));
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if ((channels != 3 && channels != 4) || pixels.size() != count * channels)
    return Error{ErrorCode::kRange, std::to_string(pixels.size()) + " bytes of " + std::to_string(channels) +
                                        " channels, but the picture has " + std::to_string(count) + " pixels"};
  std::vector<float> visibility;
  if (options.ssao || options.edl) {
    visibility.resize(count);
    SCREE_TRY(occlusion_cpu(view, samples_per_side, samples, options, visibility, threads));
  }
  ThreadPool pool(threads);
  return run(pool, visibility.empty() ? nullptr : visibility.data());
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

}  // namespace

Result<void> resolve_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                         std::span<const uint64_t> samples, const ShadeOptions& options, uint32_t channels,
                         std::span<uint8_t> pixels, uint32_t threads, BlendCounts* blended) {
  BlendCounts counts;
  if (blended != nullptr) *blended = {};
  if (shows_layers(scene, options)) {
    const std::vector<float> over = SCREE_TRY(blend_cpu(scene, view, samples, options, threads, counts));
    if (blended != nullptr) *blended = counts;
    try {
      std::vector<float> colors(3 * samples.size());
      SCREE_TRY(shade_part_cpu(scene, view, samples, options, colors, threads));
      return resolve_colors_cpu(view, samples_per_side, samples, colors, over, options, channels, pixels, threads);
    } catch (const std::bad_alloc&) {
      return out_of_memory();
    }
  }
  return resolve_with(view, samples_per_side, samples, options, channels, pixels, threads,
                      [&](ThreadPool& pool, const float* visibility) {
                        const uint32_t width = view.width / samples_per_side, height = view.height / samples_per_side;
                        return shade_tiles(scene, width, height, [&](const TileRound& round) {
                          return passes_for(best_instruction_set())
                              .resolve(pool, scene, view, samples_per_side, samples.data(), options, srgb_tables(),
                                       visibility, channels, pixels.data(), round);
                        });
                      });
}

Result<void> shade_part_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                            const ShadeOptions& options, std::span<float> colors, uint32_t threads) try {
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  SCREE_TRY(check_picture(view, colors.size(), 3, "values of colours"));
  SCREE_TRY(check_view(view));
  ThreadPool pool(threads);
  return shade_tiles(scene, view.width, view.height, [&](const TileRound& round) {
    return passes_for(best_instruction_set())
        .shade_part(pool, scene, view, samples.data(), options, srgb_tables(), colors.data(), round);
  });
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

Result<void> resolve_colors_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                                std::span<const float> colors, std::span<const float> over, const ShadeOptions& options,
                                uint32_t channels, std::span<uint8_t> pixels, uint32_t threads) {
  SCREE_TRY(check_picture(view, colors.size(), 3, "values of colours"));
  if (!over.empty()) SCREE_TRY(check_picture(view, over.size(), 4, "values of layers"));
  return resolve_with(view, samples_per_side, samples, options, channels, pixels, threads,
                      [&](ThreadPool& pool, const float* visibility) {
                        passes_for(best_instruction_set())
                            .resolve_colors(pool, view, samples_per_side, samples.data(), colors.data(),
                                            over.empty() ? nullptr : over.data(), options, srgb_tables(), visibility,
                                            channels, pixels.data());
                        return Result<void>();
                      });
}

Result<void> shade_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* samples,
                             const ShadeOptions& options, uint32_t threads) try {
  const uint64_t count = at.sample_count;
  SCREE_TRY(shade_part_cpu(scene, view, {samples, count}, options, {at.colors, 3 * count}, threads));
  ThreadPool pool(threads);
  passes_for(best_instruction_set()).find_alphas(pool, scene, view, samples, at.alphas);
  return {};
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

Result<std::vector<float>> blend_cpu(const View& view, std::span<const uint64_t> samples, uint32_t most,
                                     const LayerSource& source, uint32_t threads, BlendCounts& counts) try {
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  std::vector<uint64_t> drawn(samples.size());
  std::vector<uint64_t> layer(samples.size());
  std::vector<float> colors(3 * samples.size());
  std::vector<float> alphas(samples.size());
  std::vector<float> over(4 * samples.size());
  const BlendTargets at{static_cast<uint32_t>(samples.size()),
                        samples.data(),
                        drawn.data(),
                        layer.data(),
                        colors.data(),
                        alphas.data(),
                        over.data()};
  const CpuPasses& passes = passes_for(best_instruction_set());
  ThreadPool pool(threads);
  const Result<void> done = draw_layers(
      at, most, source, counts,
      [&](bool is_first) {
        passes.begin_layer(pool, at, is_first);
        return Result<void>();
      },
      [&] { return Result<uint64_t>(passes.end_layer(pool, at)); },
      [&] {
        passes.lay_under(pool, at);
        return Result<void>();
      });
  if (!done) return done.error();
  return over;
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

Result<std::vector<float>> blend_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                                     const ShadeOptions& options, uint32_t threads, BlendCounts& counts) {
  const SceneView blended = blended_view(scene);
  const LayerSource source{
      [&](const BlendTargets& at, const uint64_t* peeled) {
        return draw_layer_cpu(blended, view, at, peeled, threads);
      },
      [&](const BlendTargets& at) { return shade_layer_cpu(blended, view, at, at.layer, options, threads); }};
  return blend_cpu(view, samples, options.blend_layers, source, threads, counts);
}

Result<void> occlusion_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                           const ShadeOptions& options, std::span<float> visibility, uint32_t threads) try {
  SCREE_TRY(check_resolve(view, samples_per_side));
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (visibility.size() != count)
    return Error{ErrorCode::kRange, std::to_string(visibility.size()) + " factors, but the picture has " +
                                        std::to_string(count) + " pixels"};
  std::fill(visibility.begin(), visibility.end(), 1.0f);
  std::vector<float> depth(count);
  std::vector<float> open(options.ssao ? count : 0);
  ThreadPool pool(threads);
  passes_for(best_instruction_set())
      .occlude(pool, view, samples_per_side, samples.data(), options, depth.data(), open.data(), visibility.data());
  return {};
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

Result<void> layers_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                        std::span<const uint64_t> samples, const LayerTargets& out, uint32_t threads) try {
  SCREE_TRY(check_resolve(view, samples_per_side));
  SCREE_TRY(check_picture(view, samples.size(), 1, "samples"));
  ThreadPool pool(threads);
  passes_for(best_instruction_set()).layers(pool, scene, view, samples_per_side, samples.data(), out);
  return {};
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

SrgbTables make_srgb_tables() {
  const auto decode = [](double code) {
    return static_cast<float>(code <= 0.04045 ? code / 12.92 : std::pow((code + 0.055) / 1.055, 2.4));
  };
  SrgbTables tables;
  for (uint32_t i = 0; i < 256; ++i) {
    tables.linear[i] = decode(i / 255.0);
    tables.first_light[i] = i == 0 ? 0.0f : decode((i - 0.5) / 255.0);
  }
  tables.first_light[256] = std::numeric_limits<float>::infinity();
  uint32_t code = 0;
  for (uint32_t i = 0; i <= SrgbTables::kBuckets; ++i) {
    while (tables.first_light[code + 1] <= static_cast<float>(i) / SrgbTables::kBuckets) ++code;
    tables.bucket_code[i] = static_cast<uint8_t>(code);
  }
  return tables;
}

const SrgbTables& srgb_tables() {
  static const SrgbTables tables = make_srgb_tables();
  return tables;
}

Hit find_triangle(const SceneView& scene, uint64_t triangle_id) {
  return locate_triangle(scene, triangle_id);
}

double depth_of_code(const View& view, uint32_t depth_code) {
  return distance_of_code(depth_code, view.orthographic, view.z_near, view.z_far);
}

}  // namespace scree::kernels
