// Prepares the data that will be measured next. The kernel reads them, so that the disk is busy while all threads
// compute. Compressed views, which only one thread at a time can unpack first, are unpacked by threads of their own.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Bytes to prepare ahead of the measured windows.
struct AheadBytes {
  uint64_t files = 0;     // in the page cache
  uint64_t unpacked = 0;  // of compressed indices, and of compressed positions; 0: none are unpacked ahead
};

/// The number of threads that unpack ahead, one for indices and one for positions, beside `threads` that measure. A few
/// threads seldom wait for each other.
constexpr uint32_t unpacking_threads(uint32_t threads) {
  return threads < 6 ? 0 : 2;
}

/// Threads that prepare windows in order. No thread waits for them, and the results do not depend on them. A window's
/// vertices are assumed to have the same relative position among all vertices as its triangles among all triangles.
class ReadAhead {
 public:
  /// `windows` (primitive, first and count are used) and `scene` must outlive this. `attributes`: attributes will be
  /// read too; `normals`: including normals.
  ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, const AheadBytes& bytes, bool attributes,
            bool normals);
  ~ReadAhead();
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  /// Reports that all windows before number `window` are measured.
  void reached(uint64_t window);

 private:
  using Prepare = std::function<uint64_t(const WindowPlan&)>;  // returns the window's bytes

  void start(uint64_t most_bytes, Prepare prepare);
  void run(uint64_t most_bytes, const Prepare& prepare);
  uint64_t ask(const WindowPlan& window) const;

  const SourceScene& scene_;
  const std::vector<WindowPlan>& windows_;
  const bool attributes_;
  const bool normals_;
  std::mutex lock_;
  std::condition_variable changed_;
  uint64_t reached_ = 0;
  bool closing_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace scree::convert
