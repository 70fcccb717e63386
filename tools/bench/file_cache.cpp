#include "tools/bench/file_cache.h"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <vector>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "runtime/files/mapped_file.h"

namespace scree::bench {
namespace {

using runtime::MappedFile;

constexpr size_t kReadBytes = size_t{4} << 20;

Error system_error(const std::string& path, const char* doing) {
  return {ErrorCode::kFile, path + ": " + doing + ": " + std::strerror(errno)};
}

}  // namespace

Result<double> cached_share(const std::string& path) {
  const MappedFile map = SCREE_TRY(MappedFile::open(path));
  if (map.size() == 0) return 0.0;
  // A non-blocking read would start loading missing pages, so it cannot replace mincore() here.
  if (!map.mincore_is_true())
    return Error{ErrorCode::kUnsupported, path +
                                              ": the system reports its cached pages only to its owner and to users "
                                              "who may write it"};
  const auto page = static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
  const uint64_t pages = (map.size() + page - 1) / page;
  std::vector<unsigned char> states(std::min<uint64_t>(pages, 1 << 18));
  uint64_t cached = 0;
  for (uint64_t first = 0; first < pages; first += states.size()) {
    const uint64_t count = std::min<uint64_t>(states.size(), pages - first);
    void* const address = const_cast<std::byte*>(map.bytes().data() + first * page);
    if (::mincore(address, count * page, states.data()) != 0) return system_error(path, "finding its cached pages");
    cached += static_cast<uint64_t>(
        std::count_if(states.begin(), states.begin() + static_cast<ptrdiff_t>(count), [](auto s) { return s & 1u; }));
  }
  return static_cast<double>(cached) / static_cast<double>(pages);
}

Result<double> drop_from_cache(const std::string& path) {
  {
    const MappedFile file = SCREE_TRY(MappedFile::open(path));
    if (file.descriptor() < 0) return 0.0;  // empty
    // Unwritten pages cannot be dropped. If a file system has nothing to sync (EINVAL, EROFS), there are none.
    if (::fsync(file.descriptor()) != 0 && errno != EINVAL && errno != EROFS)
      return system_error(path, "writing it to the disk");
    // No page of the map was read, so the map keeps no page in the cache.
    if (const int failed = ::posix_fadvise(file.descriptor(), 0, 0, POSIX_FADV_DONTNEED); failed != 0) {
      errno = failed;
      return system_error(path, "dropping it from the page cache");
    }
  }
  return cached_share(path);
}

Result<double> bring_to_cache(const std::string& path) {
  {
    const MappedFile file = SCREE_TRY(MappedFile::open(path));
    std::vector<std::byte> block(kReadBytes);
    for (uint64_t at = 0; at < file.size();) {
      const ssize_t got = ::pread(file.descriptor(), block.data(), block.size(), static_cast<off_t>(at));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return system_error(path, "reading it");
      if (got == 0) break;  // the file has become shorter; loading it will report that
      at += static_cast<uint64_t>(got);
    }
  }
  return cached_share(path);
}

}  // namespace scree::bench
