// One CPU thread as a team of one lane. Compiled once per instruction set; cpu/backend.cpp starts the threads.
#pragma once

#include "kernels/cpu/backend.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Stores the offsets from ChunkReader::base of `count` (at most kVertexRun) vertices from `first` on. The codes of a
/// vertex must lie in one 64-bit load. It is ChunkReader::code() in loops that the compiler vectorises.
inline constexpr uint32_t kVertexRun = 256;
inline void load_codes(const ChunkReader& reader, uint32_t first, uint32_t count, int32_t codes[3][kVertexRun]) {
  // A stream of stride 0 is absent, and so is its slack.
  const uint32_t shift_y = reader.bits[0];
  const uint32_t shift_z = reader.bits[0] + reader.bits[1];
  const uint64_t mask_x = (uint64_t{1} << reader.bits[0]) - 1;
  const uint64_t mask_y = (uint64_t{1} << reader.bits[1]) - 1;
  const uint64_t mask_z = (uint64_t{1} << reader.bits[2]) - 1;
  uint64_t bit = uint64_t{first - reader.first_vertex} * reader.stride;
  for (uint32_t i = 0; i < count; ++i) {
    uint64_t window = 0;
    if (reader.stride != 0) std::memcpy(&window, reader.positions + (bit >> 3), sizeof window);
    window >>= bit & 7;
    codes[0][i] = static_cast<int32_t>(window & mask_x);
    codes[1][i] = static_cast<int32_t>((window >> shift_y) & mask_y);
    codes[2][i] = static_cast<int32_t>((window >> shift_z) & mask_z);
    bit += reader.stride;
  }
  if (!reader.clustered || reader.cluster.predictor.axis == format::kNotPredicted) return;
  // ClusterPredictor::apply() for all of them. The values are validated: only adding the bias wraps, as in the codes'
  // own sum.
  const format::ClusterPredictor predictor = reader.cluster.predictor;
  int32_t* out = codes[predictor.axis];
  const int32_t* u = codes[(predictor.axis + 1) % 3];
  const int32_t* v = codes[(predictor.axis + 2) % 3];
  for (uint32_t i = 0; i < count; ++i) {
    const int32_t slope = (predictor.slope_u * u[i] + predictor.slope_v * v[i]) >> format::kPredictorShift;
    out[i] = static_cast<int32_t>(static_cast<uint32_t>(out[i]) + predictor.bias + static_cast<uint32_t>(slope));
  }
}

/// Projects vertices of a chunk before its triangles are drawn: each vertex once, in a loop that the compiler
/// vectorises.
template <bool kOrthographic>
inline void project_range(const ChunkReader& reader, const Transform& transform, const FrameView& view, uint32_t first,
                          uint32_t count, ScreenVertex* out) {
  constexpr uint32_t kRun = kVertexRun;
  float dx[kRun];
  float dy[kRun];
  float dz[kRun];
  for (uint32_t start = 0; start < count; start += kRun) {
    const uint32_t n = min_of(kRun, count - start);
    if (!reader.float32 && reader.narrow && reader.stride <= 57) {
      int32_t codes[3][kRun];
      load_codes(reader, first + start, n, codes);
      const int32_t base_x = static_cast<int32_t>(reader.base[0]);
      const int32_t base_y = static_cast<int32_t>(reader.base[1]);
      const int32_t base_z = static_cast<int32_t>(reader.base[2]);
      for (uint32_t i = 0; i < n; ++i) {
        dx[i] = static_cast<float>(base_x + codes[0][i]);
        dy[i] = static_cast<float>(base_y + codes[1][i]);
        dz[i] = static_cast<float>(base_z + codes[2][i]);
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

/// Tests on vectors of (x, y, -, flags) whether a triangle of unflagged vertices has an empty pixel_box(). Most
/// triangles of a dense mesh end here.
class BoxTest {
 public:
  explicit BoxTest(const FrameView& view) : last_{view.width - 1, view.height - 1, 0, 0} {}

  bool operator()(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c) const {
    const Vector va = load(a);
    const Vector vb = load(b);
    const Vector vc = load(c);
    const Vector low_ab = va < vb ? va : vb;
    const Vector high_ab = va > vb ? va : vb;
    const Vector low = ((low_ab < vc ? low_ab : vc) + 127) >> 8;
    const Vector high = ((high_ab > vc ? high_ab : vc) - 128) >> 8;
    const Vector zero{};
    const Vector first = low > zero ? low : zero;
    const Vector last = high < last_ ? high : last_;
    const Vector empty = first > last;
    const Vector flags = va | vb | vc;
    return ((empty[0] | empty[1]) != 0) & ((flags[3] & static_cast<int32_t>(kNeedsClip)) == 0);
  }

 private:
  typedef int32_t Vector __attribute__((vector_size(16)));
  static Vector load(const ScreenVertex& vertex) {
    Vector out;
    std::memcpy(&out, &vertex, sizeof out);
    return out;
  }
  Vector last_;
};

/// The float nearest to an edge value. Edge values are below 2^50, so they are exact in double. The conversion uses
/// integer arithmetic on the double's bits, because AVX2 has that for four values at a time but no conversion from
/// int64. The double is then rounded once.
inline float edge_to_float(int64_t edge) {
  constexpr uint64_t kMagicBits = 0x4338000000000000u;  // 1.5 * 2^52
  const uint64_t bits = static_cast<uint64_t>(edge) + kMagicBits;
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return static_cast<float>(value - 6755399441055744.0);
}
inline float edge_to_float(int32_t edge) {
  return static_cast<float>(edge);
}

class CpuTeam {
 public:
  static constexpr bool kCachesVertices = true;
  static constexpr bool kDrawsRuns = true;
  static constexpr bool kMakesTransforms = true;

  /// `alone`: no other thread draws.
  CpuTeam(Scratch* scratch, bool alone) : scratch_(scratch), alone_(alone) {}

  static constexpr uint32_t rank() { return 0; }
  static constexpr uint32_t size() { return 1; }

  static uint64_t add(uint64_t* counter, uint64_t value) {
    return __atomic_fetch_add(counter, value, __ATOMIC_RELAXED);
  }

  static uint64_t load_relaxed(const uint64_t* sample) { return __atomic_load_n(sample, __ATOMIC_RELAXED); }

  /// Keeps the smaller of the sample and `value`. Reads first, because most pixels that are drawn again lose.
  void update_min(uint64_t* sample, uint64_t value) const {
    uint64_t seen = __atomic_load_n(sample, __ATOMIC_RELAXED);
    if (alone_) {
      if (value < seen) *sample = value;
      return;
    }
    while (value < seen) {
      if (__atomic_compare_exchange_n(sample, &seen, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) break;
    }
  }

  /// Draws a fragment of a blended surface. `shown`: MaskPlane::shown(), not 0.
  void draw_blended(const Target&, uint64_t* sample, uint64_t value, uint32_t) const { update_min(sample, value); }

  /// One bit per lane.
  static uint32_t ballot(bool value) { return value ? 1 : 0; }
  /// The value of `lane`.
  static uint64_t share(uint64_t value, uint32_t) { return value; }

  static void atomic_min(uint32_t* place, uint32_t value) {
    uint32_t seen = __atomic_load_n(place, __ATOMIC_RELAXED);
    while (value < seen &&
           !__atomic_compare_exchange_n(place, &seen, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
  }
  static void atomic_max(uint32_t* place, uint32_t value) {
    uint32_t seen = __atomic_load_n(place, __ATOMIC_RELAXED);
    while (value > seen &&
           !__atomic_compare_exchange_n(place, &seen, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
  }

  /// Draws `triangles` triangles of the chunk that context.reader reads, from vertices that are projected once each.
  /// Returns false if it is faster to project each triangle's corners.
  template <bool kOrthographic, bool kMasked>
  bool with_projected_vertices(const RasterSmall<kOrthographic, kMasked>& pass,
                               typename RasterSmall<kOrthographic, kMasked>::Context& context,
                               const format::ChunkRecord& chunk, uint32_t first_triangle, uint32_t triangles) const {
    const ChunkReader& reader = *context.reader;
    if (reader.clustered) return with_projected_cluster(pass, context, first_triangle, triangles);
    uint32_t first = 0;
    uint64_t count = chunk.vertex_count;
    const uint32_t end = first_triangle + triangles;
    if (triangles != chunk.triangle_count) {
      uint32_t low = UINT32_MAX;
      uint32_t high = 0;
      for (uint32_t i = first_triangle; i < end; ++i) {
        uint32_t v[3];
        reader.triangle(i, v);
        low = min_of(low, min_of(v[0], min_of(v[1], v[2])));
        high = max_of(high, max_of(v[0], max_of(v[1], v[2])));
      }
      first = low;
      count = uint64_t{high} - low + 1;
    }
    if (count > 3 * uint64_t{triangles}) return false;
    const ScreenVertex* const vertices =
        projected<kOrthographic>(reader, *context.transform, pass.view, first, static_cast<uint32_t>(count));
    if (vertices == nullptr) return false;
    const BoxTest misses(pass.view);
    if (reader.index_bits != 0 && reader.index_bits <= 19) {
      // One load holds a triangle's three codes.
      const uint32_t bits = reader.index_bits;
      const uint32_t mask = (1u << bits) - 1;
      const uint32_t offset = reader.index_min - first;  // modulo 2^32
      uint64_t bit = uint64_t{first_triangle} * (3 * bits);
      for (uint32_t i = first_triangle; i < end; ++i, bit += 3 * bits) {
        uint64_t window;
        std::memcpy(&window, reader.indices + (bit >> 3), sizeof window);
        window >>= bit & 7;
        const uint32_t codes[3] = {static_cast<uint32_t>(window) & mask, static_cast<uint32_t>(window >> bits) & mask,
                                   static_cast<uint32_t>(window >> (2 * bits)) & mask};
        const ScreenVertex& a = vertices[codes[0] + offset];
        const ScreenVertex& b = vertices[codes[1] + offset];
        const ScreenVertex& c = vertices[codes[2] + offset];
        if (misses(a, b, c)) continue;
        const uint32_t v[3] = {codes[0] + reader.index_min, codes[1] + reader.index_min, codes[2] + reader.index_min};
        pass.draw(*this, context, i, v, a, b, c);
      }
    } else {
      for (uint32_t i = first_triangle; i < end; ++i) {
        uint32_t v[3];
        reader.triangle(i, v);
        pass.draw(*this, context, i, v, vertices[v[0] - first], vertices[v[1] - first], vertices[v[2] - first]);
      }
    }
    return true;
  }

  /// The same for the triangles of a cluster.
  template <bool kOrthographic, bool kMasked>
  bool with_projected_cluster(const RasterSmall<kOrthographic, kMasked>& pass,
                              typename RasterSmall<kOrthographic, kMasked>::Context& context, uint32_t first_triangle,
                              uint32_t triangles) const {
    const ChunkReader& reader = *context.reader;
    const format::ClusterReader& cluster = reader.cluster;
    const uint32_t count = cluster.layout.vertex_count;
    if (count > 3 * triangles) return false;
    const ScreenVertex* const vertices =
        projected<kOrthographic>(reader, *context.transform, pass.view, reader.first_vertex, count);
    if (vertices == nullptr) return false;
    const BoxTest misses(pass.view);
    const uint32_t first = first_triangle - cluster.first_triangle;
    uint32_t largest = first == 0 ? 2 : cluster_largest(cluster, first - 1);
    for (uint32_t i = first; i < first + triangles; ++i) {
      uint32_t back[2];
      largest += cluster_step(cluster, i, back);
      const ScreenVertex& a = vertices[largest];
      const ScreenVertex& b = vertices[largest - back[0]];
      const ScreenVertex& c = vertices[largest - back[1]];
      if (misses(a, b, c)) continue;
      const uint32_t number = reader.first_vertex + largest;
      const uint32_t v[3] = {number, number - back[0], number - back[1]};
      pass.draw(*this, context, cluster.first_triangle + i, v, a, b, c);
    }
    return true;
  }

  /// Draws the covered samples of a box in runs of kRun along its rows. A vectorised loop computes the edges and depth
  /// codes of a run; then each sample is tested. If a row is not a multiple of kRun, its last run overlaps the previous
  /// one: drawing twice does not change the picture.
  template <bool kOrthographic, class Int, class Mask>
  void draw_runs(const Target& target, const Triangle& triangle, const PixelBox& box, int64_t area,
                 const Mask& mask) const {
    constexpr int32_t kRun = 16;
    const Edges<Int> edges = make_edges<Int>(triangle, box.x0, box.y0);
    const DepthPlane plane = make_depth_plane(triangle, area);
    const int32_t width = box.x1 - box.x0 + 1;
    Int along[3][kRun];  // offsets within a run; a short row repeats its last sample
    for (int i = 0; i < 3; ++i) {
      for (int32_t k = 0; k < kRun; ++k) along[i][k] = static_cast<Int>(min_of(k, width - 1)) * edges.step_x[i];
    }
    const int32_t last_run = max_of(width - kRun, 0);
    Int row[3] = {edges.value[0], edges.value[1], edges.value[2]};
    for (int32_t y = box.y0; y <= box.y1; ++y) {
      uint64_t* samples = target.row(y) + box.x0;
      for (int32_t start = 0;;) {
        Int value[3];
        bool outside = false;
        for (int i = 0; i < 3; ++i) {
          value[i] = row[i] + static_cast<Int>(start) * edges.step_x[i];
          outside = outside | (max_of<Int>(value[i], value[i] + along[i][kRun - 1]) < 0);
        }
        if (!outside) {
          uint32_t codes[kRun];
          for (int32_t k = 0; k < kRun; ++k) {
            const Int value0 = value[0] + along[0][k];
            const Int value1 = value[1] + along[1][k];
            const Int value2 = value[2] + along[2][k];
            const float depth = depth_of_weights(plane, edge_to_float(value1 + edges.exclusive[1]) * plane.inverse_area,
                                                 edge_to_float(value2 + edges.exclusive[2]) * plane.inverse_area);
            const uint32_t code = depth_code<kOrthographic>(depth);
            codes[k] = (value0 | value1 | value2) >= 0 ? code : UINT32_MAX;
          }
          const int32_t count = min_of(kRun, width);
          for (int32_t k = 0; k < count; ++k) {
            uint64_t* sample = samples + start + k;
            if (codes[k] <= sample_depth_code(__atomic_load_n(sample, __ATOMIC_RELAXED))) {
              const uint64_t drawn = pack_sample(codes[k], triangle.id);
              if constexpr (Mask::kTests) {
                mask.draw(*this, target, drawn < load_relaxed(sample), sample, drawn, box.x0 + start + k, y);
              } else {
                update_min(sample, drawn);
              }
            }
          }
        }
        if (start == last_run) break;
        start = min_of(start + kRun, last_run);
      }
      for (int i = 0; i < 3; ++i) row[i] += edges.step_y[i];
    }
  }

 private:
  /// project_range() into the thread's own memory. Null if no memory is left.
  template <bool kOrthographic>
  const ScreenVertex* projected(const ChunkReader& reader, const Transform& transform, const FrameView& view,
                                uint32_t first, uint32_t count) const {
    auto* const out = static_cast<ScreenVertex*>(scratch_->room(uint64_t{count} * sizeof(ScreenVertex)));
    if (out != nullptr) project_range<kOrthographic>(reader, transform, view, first, count, out);
    return out;
  }

  Scratch* scratch_;
  bool alone_;
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
    const CpuTeam team(&bound.pool->scratch(thread), bound.pool->size() == 1);
    for (uint64_t item = first; item < end; ++item) (*bound.pass)(static_cast<uint32_t>(item), team);
  }

  ThreadPool& pool_;
  Counters counters_{};
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
