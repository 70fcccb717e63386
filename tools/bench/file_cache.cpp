#include "tools/bench/file_cache.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <new>
#include <span>
#include <vector>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "format/bytes.h"
#include "runtime/direct_file.h"
#include "runtime/first_error.h"
#include "runtime/mapped_file.h"
#include "runtime/parallel.h"
#include "runtime/stopwatch.h"

namespace scree::bench {
namespace {

using runtime::DirectFile;
using runtime::MappedFile;

Error system_error(const std::string& path, const char* doing) {
  return {ErrorCode::kFile, path + ": " + doing + ": " + std::strerror(errno)};
}

}  // namespace

Result<double> cached_share(const std::string& path) {
  const Result<MappedFile> map = MappedFile::open(path);
  if (!map) return map.error();
  if (map->size() == 0) return 0.0;
  const auto page = static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
  const uint64_t pages = (map->size() + page - 1) / page;
  std::vector<unsigned char> states(std::min<uint64_t>(pages, 1 << 18));
  uint64_t cached = 0;
  for (uint64_t first = 0; first < pages; first += states.size()) {
    const uint64_t count = std::min<uint64_t>(states.size(), pages - first);
    void* const address = const_cast<std::byte*>(map->bytes().data() + first * page);
    if (::mincore(address, count * page, states.data()) != 0) return system_error(path, "asking for its cached pages");
    cached += static_cast<uint64_t>(
        std::count_if(states.begin(), states.begin() + static_cast<ptrdiff_t>(count), [](auto s) { return s & 1u; }));
  }
  return static_cast<double>(cached) / static_cast<double>(pages);
}

Result<double> drop_from_cache(const std::string& path) {
  {
    const Result<MappedFile> file = MappedFile::open(path);
    if (!file) return file.error();
    if (file->descriptor() < 0) return 0.0;  // empty
    // Pages that are not written yet cannot be dropped. Where a file system has nothing to sync (EINVAL, EROFS) there
    // are none.
    if (::fsync(file->descriptor()) != 0 && errno != EINVAL && errno != EROFS)
      return system_error(path, "writing it to the disk");
    // Nothing of the map was touched, so that it holds no page.
    if (const int failed = ::posix_fadvise(file->descriptor(), 0, 0, POSIX_FADV_DONTNEED); failed != 0) {
      errno = failed;
      return system_error(path, "dropping it from the page cache");
    }
  }
  return cached_share(path);
}

Result<double> bring_to_cache(const std::string& path) {
  {
    const Result<MappedFile> file = MappedFile::open(path);
    if (!file) return file.error();
    std::vector<std::byte> block(kRawBlockBytes);
    for (uint64_t at = 0; at < file->size();) {
      const ssize_t got = ::pread(file->descriptor(), block.data(), block.size(), static_cast<off_t>(at));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return system_error(path, "reading it");
      if (got == 0) break;  // it has become shorter; whoever loads it says so
      at += static_cast<uint64_t>(got);
    }
  }
  return cached_share(path);
}

Result<RawRead> read_raw(const std::string& path, uint32_t in_flight) {
  const Result<MappedFile> map = MappedFile::open(path);
  if (!map) return map.error();
  if (map->size() == 0) return RawRead{};
  const Result<DirectFile> file = DirectFile::open(*map);
  if (!file) return at(path, file.error());
  RawRead raw;
  raw.bytes = std::min(map->size(), kMostRawBytes);
  const uint64_t blocks = (raw.bytes + kRawBlockBytes - 1) / kRawBlockBytes;
  const auto readers = static_cast<uint32_t>(std::min<uint64_t>(blocks, in_flight));
  try {
    std::vector<runtime::DirectMemory> memory;
    for (uint32_t i = 0; i < readers; ++i) memory.push_back(runtime::direct_memory(kRawBlockBytes));
    runtime::FirstError failure;
    const runtime::Stopwatch watch;
    std::atomic<uint64_t> next{0};
    runtime::parallel_for(readers, readers, [&](uint64_t reader) {
      for (uint64_t i = next++; i < blocks; i = next++) {
        const uint64_t offset = i * kRawBlockBytes;
        const uint64_t bytes = format::align_up(std::min(kRawBlockBytes, raw.bytes - offset), DirectFile::kAlignment);
        if (const auto read = file->read(offset, {memory[reader].get(), bytes}); !read)
          return failure.report(i, read.error());
      }
    });
    raw.seconds = watch.elapsed().wall_ms * 1e-3;
    if (failure.any()) return at(path, failure.error());
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to read it"};
  }
  return raw;
}

}  // namespace scree::bench
