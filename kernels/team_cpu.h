// One CPU thread as a team of one lane, and the backend that hands out such teams. Compiled once per instruction set.
#pragma once

#include "kernels/backend_cpu.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Vertices of a chunk projected before its triangles are drawn: each once, in a loop that the compiler makes vectors
/// of.
template <bool kOrthographic>
inline void project_range(const ChunkReader& reader, const Transform& transform, const FrameView& view, uint32_t first,
                          uint32_t count, ScreenVertex* out) {
  constexpr uint32_t kRun = 256;
  float dx[kRun];
  float dy[kRun];
  float dz[kRun];
  for (uint32_t start = 0; start < count; start += kRun) {
    const uint32_t n = min_of(kRun, count - start);
    if (!reader.float32 && reader.narrow && reader.stride <= 57) {
      // One load holds the three codes of a vertex. A stride of 0 has no stream, not even its slack.
      const uint32_t shift_y = reader.bits[0];
      const uint32_t shift_z = reader.bits[0] + reader.bits[1];
      const uint64_t mask_x = (uint64_t{1} << reader.bits[0]) - 1;
      const uint64_t mask_y = (uint64_t{1} << reader.bits[1]) - 1;
      const uint64_t mask_z = (uint64_t{1} << reader.bits[2]) - 1;
      const int32_t base_x = static_cast<int32_t>(reader.base[0]);
      const int32_t base_y = static_cast<int32_t>(reader.base[1]);
      const int32_t base_z = static_cast<int32_t>(reader.base[2]);
      uint64_t bit = uint64_t{first + start} * reader.stride;
      for (uint32_t i = 0; i < n; ++i) {
        uint64_t window = 0;
        if (reader.stride != 0) std::memcpy(&window, reader.positions + (bit >> 3), sizeof window);
        window >>= bit & 7;
        dx[i] = static_cast<float>(base_x + static_cast<int32_t>(window & mask_x));
        dy[i] = static_cast<float>(base_y + static_cast<int32_t>((window >> shift_y) & mask_y));
        dz[i] = static_cast<float>(base_z + static_cast<int32_t>((window >> shift_z) & mask_z));
        bit += reader.stride;
      }
    } else {
      for (uint32_t i = 0; i < n; ++i) {
        float d[3];
        reader.relative(first + start + i, d);
        dx[i] = d[0];
        dy[i] = d[1];
        dz[i] = d[2];
      }
    }
    for (uint32_t i = 0; i < n; ++i) out[start + i] = project<kOrthographic>(transform, view, dx[i], dy[i], dz[i]);
  }
}

class CpuTeam {
 public:
  static constexpr bool kCachesVertices = true;

  explicit CpuTeam(ScreenVertex* scratch) : scratch_(scratch) {}

  static constexpr uint32_t rank() { return 0; }
  static constexpr uint32_t size() { return 1; }

  static uint64_t add(uint64_t* counter, uint64_t value) {
    return __atomic_fetch_add(counter, value, __ATOMIC_RELAXED);
  }

  /// The smaller of the sample and `value` stays. Reads first: most pixels that are drawn again lose.
  static void keep_min(uint64_t* sample, uint64_t value) {
    uint64_t seen = __atomic_load_n(sample, __ATOMIC_RELAXED);
    while (value < seen) {
      if (__atomic_compare_exchange_n(sample, &seen, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) break;
    }
  }

  /// Draws the block from vertices projected once each; false where projecting a triangle's corners is the better way.
  template <bool kOrthographic>
  bool with_projected_vertices(const RasterSmall<kOrthographic>& pass,
                               typename RasterSmall<kOrthographic>::Context& context, const DrawBlock& block,
                               const format::ChunkRecord& chunk) const {
    const ChunkReader& reader = *context.reader;
    if (scratch_ == nullptr) return false;
    uint32_t first = 0;
    uint64_t count = chunk.vertex_count;
    const uint32_t end = block.first_triangle + block.triangle_count;
    if (block.triangle_count != chunk.triangle_count) {
      uint32_t low = UINT32_MAX;
      uint32_t high = 0;
      for (uint32_t i = block.first_triangle; i < end; ++i) {
        uint32_t v[3];
        reader.triangle(i, v);
        low = min_of(low, min_of(v[0], min_of(v[1], v[2])));
        high = max_of(high, max_of(v[0], max_of(v[1], v[2])));
      }
      first = low;
      count = uint64_t{high} - low + 1;
    }
    if (count > kScratchVertices || count > 3 * uint64_t{block.triangle_count}) return false;
    project_range<kOrthographic>(reader, *context.transform, pass.view, first, static_cast<uint32_t>(count), scratch_);
    for (uint32_t i = block.first_triangle; i < end; ++i) {
      uint32_t v[3];
      reader.triangle(i, v);
      pass.draw(*this, context, i, v, scratch_[v[0] - first], scratch_[v[1] - first], scratch_[v[2] - first]);
    }
    return true;
  }

 private:
  ScreenVertex* scratch_;
};

class CpuBackend {
 public:
  explicit CpuBackend(ThreadPool& pool) : pool_(pool) {}

  template <class Pass>
  void for_each(uint64_t count, const Pass& pass) {
    const Bound<Pass> bound{&pass, &pool_};
    uint64_t grain = count / (uint64_t{pool_.size()} * 64);
    grain = min_of<uint64_t>(max_of<uint64_t>(grain, 1), 64);
    pool_.for_each(count, grain, &run<Pass>, &bound);
  }

  template <class T>
  T* allocate(uint64_t count) {
    return count > UINT64_MAX / sizeof(T) ? nullptr : static_cast<T*>(allocate_aligned(count * sizeof(T)));
  }
  void release(void* memory) { release_aligned(memory); }

  Counters* counters() { return &counters_; }
  Counters read_counters() const { return counters_; }
  void write_counters(const Counters& counters) { counters_ = counters; }

 private:
  template <class Pass>
  struct Bound {
    const Pass* pass;
    ThreadPool* pool;
  };

  template <class Pass>
  static void run(const void* context, uint64_t first, uint64_t end, uint32_t thread) {
    const Bound<Pass>& bound = *static_cast<const Bound<Pass>*>(context);
    const CpuTeam team(static_cast<ScreenVertex*>(bound.pool->scratch(thread)));
    for (uint64_t item = first; item < end; ++item) (*bound.pass)(static_cast<uint32_t>(item), team);
  }

  ThreadPool& pool_;
  Counters counters_{};
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
