// Prepares the data that will be measured next. The kernel reads them, so that the disk is busy while all threads
// compute. Compressed views, which only one thread at a time can unpack first, are unpacked by threads of their own.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "tools/common/jobs/prepare_ahead.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The data of this many bytes of windows are prepared ahead of the newest window that is being measured.
struct AheadBytes {
  uint64_t files = 0;     // read into the page cache
  uint64_t unpacked = 0;  // unpacked, as far as their views are compressed
};

/// The number of threads that unpack ahead, half of them indices and half positions, beside `threads` that measure. A
/// few threads seldom wait for each other.
constexpr uint32_t unpacking_threads(uint32_t threads) {
  return threads < 6 ? 0 : threads < 12 ? 2 : 4;
}

/// Threads that prepare windows in order. No thread waits for them, and the results do not depend on them. A window's
/// vertices are assumed to have the same relative position among all vertices as its triangles among all triangles.
class ReadAhead {
 public:
  /// `windows` (primitive, first and count are used) and `scene` must outlive this. `threads`: that measure.
  /// `attributes`: attributes will be read too; `normals`: including normals.
  ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, const AheadBytes& bytes, uint32_t threads,
            bool attributes, bool normals);

  /// Reports that a thread begins to measure window number `window`. Any thread may call it.
  void begun(uint64_t window);

 private:
  using Prepare = std::function<void(const WindowPlan&)>;

  void start(uint64_t most_bytes, Prepare prepare);
  template <class Visit>
  void visit(const WindowPlan& window, const Visit& visit) const;
  uint64_t bytes_of(const WindowPlan& window) const;

  const SourceScene& scene_;
  const std::vector<WindowPlan>& windows_;
  const bool attributes_;
  const bool normals_;
  std::vector<std::unique_ptr<PrepareAhead>> threads_;
};

}  // namespace scree::convert
