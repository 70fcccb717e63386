// Ways of reading pages for a GPU.
#pragma once

#include <cstdint>

namespace scree::runtime {

/// How pages are read from the file. "Directly" is into the memory from which they are copied to the GPU.
enum class Reading {
  kAuto,      // kDirect for kDirectBytes of pages or more if most are not in the page cache; else kBuffered
  kMapped,    // copied from the map, through the page cache; for pages of textures as kBuffered
  kBuffered,  // by read() through the page cache, directly; as kMapped for compressed pages and for pages larger than a
              // slot
  kDirect,    // past the page cache, directly; as kMapped for pages larger than a slot; as kBuffered if the file system
              // has no direct reads, and for a page of a texture that is read again
};
inline constexpr uint64_t kDirectBytes = uint64_t{256} << 20;

/// The least number of threads that read past the page cache. They mostly wait for the disk, and few requests would
/// leave it idle.
inline constexpr uint32_t kDirectThreads = 8;

}  // namespace scree::runtime
