// The CPU backend, which runs passes on threads. This part is the same for every instruction set; team.h is compiled
// for each.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "kernels/blend.h"
#include "kernels/cpu/passes.h"
#include "kernels/frame.h"
#include "kernels/shade/srgb.h"
#include "kernels/shade/texel_pager.h"

namespace scree::kernels {

/// 64-byte aligned and uninitialised; null if no memory is left. Not inline: both instruction sets share it.
void* allocate_aligned(uint64_t bytes);
void release_aligned(void* memory);

/// Memory that grows.
class Scratch {
 public:
  Scratch() = default;
  ~Scratch() { release_aligned(memory_); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  /// At least `bytes`, aligned to 64; null if no memory is left. Does not keep the contents.
  void* room(uint64_t bytes);

 private:
  void* memory_ = nullptr;
  uint64_t bytes_ = 0;
};

/// Threads that wait for work. The calling thread is thread 0 and works too.
class ThreadPool {
 public:
  /// `threads`: at least 1. There are fewer if the system refuses a thread.
  explicit ThreadPool(uint32_t threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  uint32_t size() const;

  /// Calls run(context, first, end, thread) over 0 .. count - 1 in shares of `grain`, and returns when all are done.
  using Run = void (*)(const void* context, uint64_t first, uint64_t end, uint32_t thread);
  void for_each(uint64_t count, uint64_t grain, Run run, const void* context);

  /// Memory that only `thread` uses.
  Scratch& scratch(uint32_t thread);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

enum class InstructionSet { kBaseline, kAvx2 };

/// The fastest instruction set of this machine.
InstructionSet best_instruction_set();

/// draw_cpu() with all the parameters that must not change its result. For tests.
Result<FrameStats> draw_cpu_with(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads, InstructionSet set, const QueueSizes& sizes);

/// The tiles that one round of shading finishes.
struct TileRound {
  const UnfinishedTile* tiles;  // null: all pixels of all tiles
  uint32_t count;
  UnfinishedTile* left;  // the tiles with pixels that lacked texels; room for all; null if none can be missing
};

/// The functions that passes.cpp defines for each instruction set.
/// - draw returns false if memory ran out. `peeled`: Target::peeled. `clear`: clears the samples first.
/// - resolve and shade_part return the number of tiles in round.left.
/// - end_layer returns the number of samples that show the layer.
struct CpuPasses {
  bool (*draw)(ThreadPool& pool, const SceneView& scene, const View& view, uint64_t* samples, const uint64_t* peeled,
               bool clear, const QueueSizes& sizes, FrameStats& stats);
  uint32_t (*resolve)(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side,
                      const uint64_t* samples, const ShadeOptions& options, const SrgbTables& srgb,
                      const float* visibility, uint32_t channels, uint8_t* pixels, const TileRound& round);
  uint32_t (*shade_part)(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
                         const ShadeOptions& options, const SrgbTables& srgb, float* colors, const TileRound& round);
  void (*resolve_colors)(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples,
                         const float* colors, const float* over, const ShadeOptions& options, const SrgbTables& srgb,
                         const float* visibility, uint32_t channels, uint8_t* pixels);
  void (*occlude)(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples,
                  const ShadeOptions& options, float* depth, float* open, float* visibility);
  void (*layers)(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side, const uint64_t* samples,
                 const LayerTargets& out);
  void (*begin_layer)(ThreadPool& pool, const BlendTargets& at, bool is_first);
  uint64_t (*end_layer)(ThreadPool& pool, const BlendTargets& at);
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
