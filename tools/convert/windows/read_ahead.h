// Asks the kernel for what will be measured next, so that the disk is busy while all threads compute.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// A thread that asks for windows in their order, up to a number of bytes ahead of those that were measured. What is
/// asked for comes into the page cache; nobody need wait for it, and where it does not come nothing changes. A window's
/// vertices are taken to lie among all as its triangles do.
class ReadAhead {
 public:
  /// `windows` (primitive, first, count are read) and `scene` outlive it. `attributes`: they will be read as well;
  /// `normals`: these too.
  ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, uint64_t most_bytes, bool attributes,
            bool normals);
  ~ReadAhead();
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  /// All windows before number `window` are measured.
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
