// A run of a primitive's triangles with the vertices they use, read from the source. Measuring and encoding work window
// by window. The window size is a constant, so that the output does not depend on threads or memory.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/common/jobs/raw_vector.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Triangles per window: large enough that the order of triangles covers whole neighbourhoods and a window fills
/// several pages, and small enough that a thread's scratch memory stays below 64 MiB if no vertex is shared.
inline constexpr uint64_t kWindowTriangles = 262144;

/// Up to this many vertex numbers from the smallest to the largest, a window finds its vertices by a bitmap (12 MiB
/// with the ranks). Beyond that it sorts them, which is 3 times as slow.
inline constexpr uint64_t kBitmapSpan = uint64_t{1} << 26;

/// Up to this many, a window of `corners` corners has a table with an entry for each vertex number instead.
constexpr uint64_t most_table_span(uint64_t corners) {
  return corners + 1024;
}

/// The content of a window after load().
class WindowContent {
 public:
  uint64_t triangle_count() const { return indices_.size() / 3; }

  /// From the smallest read vertex number to the largest, both included; below 2^32.
  uint64_t span() const { return span_; }
  uint64_t dropped_degenerate() const { return dropped_degenerate_; }
  uint64_t dropped_nonfinite() const { return dropped_nonfinite_; }

  /// 3 per triangle.
  std::span<const uint32_t> indices() const { return indices_; }

  /// Whether indices() refer to vertices().
  bool is_renumbered() const { return renumber_; }

  /// Source numbers of the used vertices, ascending; the kept triangles use all of them.
  std::span<const uint32_t> vertices() const { return vertices_; }

  /// Whether the vertices lie far apart in the source, so that neighbours in number need not be neighbours in space.
  bool is_scattered() const { return is_scattered_; }

  /// 3 per vertex, finite.
  std::span<const float> positions() const { return positions_; }

  /// Indices of the kept triangles in the window; empty if all are kept.
  std::span<const uint32_t> kept() const { return kept_; }

  /// The number of kept triangle `place` in the source primitive.
  uint64_t source_id(uint64_t place) const {
    const uint64_t read = kept_.empty() ? place : kept_[place];
    return numbers_.empty() ? first_ + read : numbers_[read];
  }

  /// For a sorted copy: the source's numbers of all triangles that were read; else empty.
  std::span<const uint32_t> numbers() const { return numbers_; }

 protected:
  uint64_t first_ = 0;
  uint64_t span_ = 0;
  uint64_t dropped_degenerate_ = 0;
  uint64_t dropped_nonfinite_ = 0;
  bool renumber_ = false;
  bool is_scattered_ = false;
  RawVector<uint32_t> indices_;
  std::vector<uint32_t> kept_;     // indices of the kept triangles; empty if all are kept
  std::vector<uint32_t> numbers_;  // for a sorted copy
  RawVector<uint32_t> vertices_;
  RawVector<float> positions_;
};

/// A window and, once it is loaded, its triangles. A thread reuses it for one window after another; load() keeps the
/// memory of its vectors.
class Window : public WindowContent {
 public:
  enum class Find {
    kVertices,   // the vertices only: indices() are the source's
    kTriangles,  // indices() refer to vertices()
  };

  /// Reads triangles [first, first + count) of `primitive` with the positions they use. Two kinds of triangles are
  /// dropped and counted: triangles of strips and fans with two equal indices (they join strips and cover nothing), and
  /// with `drop_nonfinite` triangles with a non-finite position. Errors of read_triangles and gather_floats; kRange for
  /// a non-finite position ("mesh 3 primitive 0: vertex 5: position (nan, 0, 1) is not finite").
  Result<void> load(const Primitive& primitive, uint64_t first, uint64_t count, bool drop_nonfinite, Find find);

  /// The two halves of load(). After the first one vertices(), span() and dropped_degenerate() are set, and no vertex
  /// has been read.
  Result<void> load_triangles(const Primitive& primitive, uint64_t first, uint64_t count, Find find);
  Result<void> load_positions(const Primitive& primitive, bool drop_nonfinite);

  /// Keeps the first vertex of every class of equal ones. `firsts`: for each of vertices(), the index of the first
  /// equal one, which may be its own. The number and order of triangles stay the same. Called after load() with
  /// kTriangles.
  void merge(std::span<const uint32_t> firsts);

  /// release() moves the content out and frees unneeded memory; it then takes at most most_released_bytes(). restore()
  /// takes over the content of another window.
  uint64_t most_released_bytes() const;
  WindowContent release();
  void restore(WindowContent content) { static_cast<WindowContent&>(*this) = std::move(content); }

 private:
  Result<void> read_positions(const Primitive& primitive);
  void drop_degenerate();
  void find_vertices(bool renumber);
  void find_by_bitmap(uint32_t lo, uint64_t span, bool renumber);
  void keep_triangles(const std::vector<bool>& keep);
  Result<void> check_positions(const Primitive& primitive, bool drop_nonfinite);

  std::vector<uint8_t> is_used_;  // by vertex number: 1 if a triangle uses it
  std::vector<uint32_t> places_;  // by vertex number: index in vertices_
  std::vector<uint64_t> used_;    // a bit per vertex number
  std::vector<uint32_t> ranks_;   // number of vertices before each word of used_
  std::vector<uint64_t> pairs_;   // (vertex number, corner) for wide windows
  std::vector<uint64_t> sorted_;
};

/// Reads `accessor` at ascending vertex numbers into `out` (`components` floats per vertex); one read for adjacent
/// numbers.
Result<void> read_vertices(const Accessor& accessor, std::span<const uint32_t> ascending, std::vector<float>& out);
/// The same into `out`, which has that size already.
Result<void> read_vertices(const Accessor& accessor, std::span<const uint32_t> ascending, std::span<float> out);

}  // namespace scree::convert
