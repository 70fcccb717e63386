// The CPU backend: passes over threads. This part is the same for every instruction set; team.h is compiled for
// each.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "kernels/blend.h"
#include "kernels/cpu/passes.h"
#include "kernels/frame.h"
#include "kernels/shade/srgb.h"

namespace scree::kernels {

/// Threads that wait for work; the calling thread is thread 0 and works too.
class ThreadPool {
 public:
  /// `threads`: at least 1. Where the system refuses a thread, there are fewer.
  explicit ThreadPool(uint32_t threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  uint32_t size() const;

  /// Calls run(context, first, end, thread) over 0 .. count - 1 in shares of `grain`, and returns when all is done.
  using Run = void (*)(const void* context, uint64_t first, uint64_t end, uint32_t thread);
  void for_each(uint64_t count, uint64_t grain, Run run, const void* context);

  /// Memory for the projected vertices of one chunk, kScratchVertices long, one a thread; null when there is none left.
  void* scratch(uint32_t thread);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

inline constexpr uint64_t kScratchVertices = 3 * 65536;

/// 64-byte aligned, uninitialised; null when there is none left. Not inline: shared by both instruction sets.
void* allocate_aligned(uint64_t bytes);
void release_aligned(void* memory);

enum class InstructionSet { kBaseline, kAvx2 };

/// What this machine runs best.
InstructionSet best_instruction_set();

/// draw_cpu() with everything that must not change its result: for tests.
Result<FrameStats> draw_cpu_with(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads, InstructionSet set, const QueueSizes& sizes);

/// What passes.cpp gives for each instruction set. draw: false when memory ran out; `peeled`: of Target; `clear`:
/// before it. end_layer: the number of samples that show something.
struct CpuPasses {
  bool (*draw)(ThreadPool& pool, const SceneView& scene, const View& view, uint64_t* samples, const uint64_t* peeled,
               bool clear, const QueueSizes& sizes, FrameStats& stats);
  void (*shade)(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
                const ShadeOptions& options, const SrgbTables& srgb, uint32_t first_row, uint32_t row_count,
                float* rgba);
  void (*resolve)(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side, const uint64_t* samples,
                  const ShadeOptions& options, const SrgbTables& srgb, const float* visibility, uint32_t channels,
                  uint8_t* pixels);
  void (*shade_part)(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
                     const ShadeOptions& options, const SrgbTables& srgb, float* colors);
  void (*resolve_colors)(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples,
                         const float* colors, const float* over, const ShadeOptions& options, const SrgbTables& srgb,
                         const float* visibility, uint32_t channels, uint8_t* pixels);
  void (*occlude)(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples,
                  const ShadeOptions& options, float* depth, float* open, float* visibility);
  void (*layers)(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side, const uint64_t* samples,
                 const LayerTargets& out);
  void (*begin_layer)(ThreadPool& pool, const BlendTargets& at, bool is_first);
  uint64_t (*end_layer)(ThreadPool& pool, const BlendTargets& at, bool is_first);
  void (*lay_under)(ThreadPool& pool, const BlendTargets& at);
  void (*find_alphas)(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* layer, float* alphas);
};
namespace isa_baseline {
extern const CpuPasses kPasses;
}
namespace isa_avx2 {
extern const CpuPasses kPasses;
}

}  // namespace scree::kernels
