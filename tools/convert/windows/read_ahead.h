// Starts the kernel's read-ahead of the data that will be measured next, so that the disk is busy while all threads
// compute.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// A thread that requests windows in order, up to a number of bytes ahead of the measured ones. The data go to the page
/// cache. No thread waits for them, and the results do not depend on them. A window's vertices are assumed to have the
/// same relative position among all vertices as its triangles among all triangles.
class ReadAhead {
 public:
  /// `windows` (primitive, first and count are used) and `scene` must outlive this. `attributes`: attributes will be
  /// read too; `normals`: including normals.
  ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, uint64_t most_bytes, bool attributes,
            bool normals);
  ~ReadAhead();
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  /// Reports that all windows before number `window` are measured.
  void reached(uint64_t window);

 private:
  void run();
  uint64_t ask(const WindowPlan& window) const;

  const SourceScene& scene_;
  const std::vector<WindowPlan>& windows_;
  const uint64_t most_bytes_;
  const bool attributes_;
  const bool normals_;
  std::mutex lock_;
  std::condition_variable changed_;
  uint64_t reached_ = 0;
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace scree::convert
