// Loading a .scree file once, by the clock: to all of it resident, and on to the first picture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/files/direct_file.h"
#include "runtime/stream/upload.h"
#include "tools/common/options.h"

namespace scree::bench {

/// Where a scene's pages are drawn from, and how they come there.
enum class LoadWay {
  kMap,            // as the CPU draws: checked where they lie in the file's map, compressed ones unpacked
  kArenaMapped,    // through the ring of runtime/stream/upload.h to one piece of host memory, out of the map
  kArenaBuffered,  // likewise, by read() through the page cache
  kArenaDirect,    // likewise, read past the page cache
  kGpuMapped,      // through the ring to a GPU
  kGpuBuffered,
  kGpuDirect,
  kGpu,  // as the program chooses
};
/// Such as "ring, direct".
const char* load_way_name(LoadWay way);

/// Host memory as a device: touched once, before a clock starts, so that no page faults are measured with it.
class HostArena {
 public:
  /// Errors kMemory: more than `bytes` are not available (MemAvailable), or not to be had.
  static Result<HostArena> allocate(uint64_t bytes);
  std::byte* data() const { return memory_.get(); }
  uint64_t bytes() const { return bytes_; }

 private:
  runtime::DirectMemory memory_;
  uint64_t bytes_ = 0;
};

/// What a load is told.
struct LoadSettings {
  uint32_t threads = 1;
  tools::ImageSize size{1920, 1080};
  std::string view;  // a camera's name; empty: the first, or the default view of a scene without
};

struct TimedLoad {
  double resident_s = 0;      // from opening the file to all pages checked and where they are drawn from
  double first_frame_s = 0;   // on to its first picture, shaded, in host memory
  double resident_cpu_s = 0;  // processor time of the first
  uint64_t file_bytes = 0;
  uint64_t read_bytes = 0;    // of them, without the pages that the scene does not draw
  uint64_t direct_bytes = 0;  // of them, read past the page cache
  uint64_t picture = 0;       // XXH3-64 of the first picture's pixels: the same for all ways of a CPU, and of a GPU
  uint64_t device_bytes = 0;  // of what is resident; of kMap and arenas pages and textures alone
};

/// Bytes that the scene's pages take in an arena; opens the file for it. Errors as Scene::open.
Result<uint64_t> arena_bytes(const std::string& path);

/// Loads the default scene of `path` with its textures. `arena`: arena_bytes() at least, where `way` is one of an
/// arena's. Errors: those of opening, loading, uploading and drawing.
Result<TimedLoad> timed_load(const std::string& path, LoadWay way, const HostArena& arena,
                             const LoadSettings& settings);

}  // namespace scree::bench
