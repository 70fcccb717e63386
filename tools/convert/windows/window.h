// A run of a primitive's triangles with the vertices they use, read from the source: the unit of work of measure and
// encode. The window size is a constant, so that neither threads nor memory show in the bytes of the output.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/gltf/box.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Triangles a window: large enough that meshoptimizer sees whole neighbourhoods and a window fills several pages,
/// small enough that a thread's scratch memory stays below 64 MiB where no vertex is shared.
inline constexpr uint64_t kWindowTriangles = 262144;

/// What load() found of a window.
class WindowContent {
 public:
  uint64_t triangle_count() const { return indices_.size() / 3; }

  /// From the smallest vertex number that was read to the largest, both counted; below 2^32.
  uint64_t span() const { return span_; }
  uint64_t dropped_degenerate() const { return dropped_degenerate_; }
  uint64_t dropped_nonfinite() const { return dropped_nonfinite_; }

  /// 3 a triangle.
  std::span<const uint32_t> indices() const { return indices_; }

  /// Whether indices() are places in vertices().
  bool is_renumbered() const { return renumber_; }

  /// Numbers of the used vertices in the source, ascending; all used by the triangles that are kept.
  std::span<const uint32_t> vertices() const { return vertices_; }

  /// Whether the vertices lie far from each other in the source, so that their order says nothing of neighbourhood.
  bool is_scattered() const { return is_scattered_; }

  /// 3 a vertex, finite.
  std::span<const float> positions() const { return positions_; }

  /// Places of the kept triangles, 0 the window's first; empty where all are kept.
  std::span<const uint32_t> kept() const { return kept_; }

  /// The number of kept triangle `place` in the source primitive.
  uint64_t source_id(uint64_t place) const {
    const uint64_t read = kept_.empty() ? place : kept_[place];
    return numbers_.empty() ? first_ + read : numbers_[read];
  }

  /// The source's numbers of all triangles that were read, of a sorted copy; else empty.
  std::span<const uint32_t> numbers() const { return numbers_; }

  /// Memory that it takes.
  uint64_t bytes() const;

 protected:
  uint64_t first_ = 0;
  uint64_t span_ = 0;
  uint64_t dropped_degenerate_ = 0;
  uint64_t dropped_nonfinite_ = 0;
  bool renumber_ = false;
  bool is_scattered_ = false;
  std::vector<uint32_t> indices_;
  std::vector<uint32_t> kept_;     // places of the kept triangles; empty where all are
  std::vector<uint32_t> numbers_;  // of a sorted copy
  std::vector<uint32_t> vertices_;
  std::vector<float> positions_;
};

/// A window and, once it is loaded, its triangles. Reused for one window after the other by one thread; load() keeps
/// the memory of its vectors.
class Window : public WindowContent {
 public:
  enum class Find {
    kVertices,   // the vertices only: indices() are left as in the source
    kTriangles,  // indices() are places in vertices()
  };

  /// Reads triangles [first, first + count) of `primitive` with the positions they use. Dropped and counted: triangles
  /// with two equal indices of strips and fans (they are how strips are joined and cover nothing), and with
  /// `drop_nonfinite` those that use a position which is not finite. Errors: those of read_triangles and gather_floats;
  /// kRange for a position that is not finite ("mesh 3 primitive 0: vertex 5: position (nan, 0, 1) is not finite").
  Result<void> load(const Primitive& primitive, uint64_t first, uint64_t count, bool drop_nonfinite, Find find);

  /// The two halves of load(): between them vertices(), span() and dropped_degenerate() are known, and nothing of the
  /// vertices has been read.
  Result<void> load_triangles(const Primitive& primitive, uint64_t first, uint64_t count, Find find);
  Result<void> load_positions(const Primitive& primitive, bool drop_nonfinite);

  /// Keeps of every class of equal vertices the first: `firsts` has, for each of vertices(), the place of the first
  /// equal one, which may be its own. Triangles stay as many and in their order. After load() with kTriangles.
  void merge(std::span<const uint32_t> firsts);

  /// Gives what was loaded away, without memory that it does not need; takes what another window gave.
  WindowContent release();
  void restore(WindowContent content) { static_cast<WindowContent&>(*this) = std::move(content); }

 private:
  Result<void> read_positions(const Primitive& primitive);
  void drop_degenerate();
  void find_vertices(bool renumber);
  void find_by_bitmap(uint32_t lo, uint64_t span, bool renumber);
  void keep_triangles(const std::vector<bool>& keep);
  Result<void> check_positions(const Primitive& primitive, bool drop_nonfinite);

  std::vector<uint32_t> places_;  // of a vertex number in vertices_
  std::vector<uint64_t> used_;    // a bit a vertex number
  std::vector<uint32_t> ranks_;   // vertices before each word of used_
  std::vector<uint64_t> pairs_;   // (vertex number, corner) of wide windows
  std::vector<uint64_t> sorted_;
};

/// Reads `accessor` at ascending vertex numbers into `out` (components a vertex): one read where they are neighbours.
Result<void> read_vertices(const Accessor& accessor, std::span<const uint32_t> ascending, std::vector<float>& out);

}  // namespace scree::convert
