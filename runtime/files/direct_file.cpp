#include "runtime/files/direct_file.h"

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <string>
#include <utility>

#include <fcntl.h>
#include <unistd.h>

namespace scree::runtime {
namespace {

/// The requests are well formed, so EINVAL and EFAULT mean that the file system or the memory does not support direct
/// reads.
bool is_unsupported(int number) {
  return number == EINVAL || number == EFAULT || number == EOPNOTSUPP;
}

Error read_error(int number) {
  return {is_unsupported(number) ? ErrorCode::kUnsupported : ErrorCode::kFile,
          std::string("cannot read past the page cache: ") + std::strerror(number)};
}

}  // namespace

Result<DirectFile> DirectFile::open(const MappedFile& map) {
  // By now the name may refer to another file, so this opens the descriptor's file.
  const std::string link = "/proc/self/fd/" + std::to_string(map.descriptor());
  DirectFile file;
  file.size_ = map.size();
  file.descriptor_ = ::open(link.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECT);
  if (file.descriptor_ < 0) {
    const int number = errno;
    // Without /proc the file cannot be opened like this.
    return read_error(number == ENOENT ? EINVAL : number);
  }
  return Result<DirectFile>(std::move(file));
}

DirectFile::DirectFile(DirectFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_) {}

DirectFile& DirectFile::operator=(DirectFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  return *this;
}

DirectFile::~DirectFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

Result<void> DirectFile::read(uint64_t offset, std::span<std::byte> out) const {
  assert(offset % kAlignment == 0 && out.size() % kAlignment == 0);
  assert(reinterpret_cast<uintptr_t>(out.data()) % kAlignment == 0);
  const uint64_t end = std::min<uint64_t>(offset + out.size(), size_);
  for (uint64_t at = offset; at < end;) {
    // Linux moves at most 0x7ffff000 bytes per call. A read that stopped early ended on a multiple of the alignment.
    const uint64_t part = std::min<uint64_t>(offset + out.size() - at, uint64_t{1} << 30);
    const ssize_t got = ::pread(descriptor_, out.data() + (at - offset), part, static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return read_error(errno);
    at += static_cast<uint64_t>(got);
    if (got == 0 || (at < end && at % kAlignment != 0)) return ends_early(at, size_);
  }
  return {};
}

}  // namespace scree::runtime
