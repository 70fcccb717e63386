#include "runtime/files/mapped_file.h"

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <limits>
#include <utility>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include "format/bytes.h"
#include "runtime/files/file_state.h"

namespace scree::runtime {
namespace {

/// Closes a descriptor at the end of its scope unless it is released.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  int release() { return std::exchange(fd_, -1); }

 private:
  int fd_;
};

Error system_error(const std::string& path, const char* doing, int number) {
  const ErrorCode code = number == ENOMEM ? ErrorCode::kMemory : ErrorCode::kFile;
  return {code, path + ": " + doing + ": " + std::strerror(number)};
}

/// A path that opens the same file again, even if its name refers to another file by now.
std::string own_path(int descriptor) {
  return "/proc/self/fd/" + std::to_string(descriptor);
}

uint64_t page_bytes() {
  static const long said = ::sysconf(_SC_PAGESIZE);
  return said > 0 ? static_cast<uint64_t>(said) : 4096;
}

}  // namespace

Error ends_early(uint64_t end, uint64_t size) {
  return {ErrorCode::kFile,
          "ends at byte " + std::to_string(end) + ", but had " + std::to_string(size) + " when it was opened"};
}

Result<MappedFile> MappedFile::open(const std::string& path, Access access) {
  // Without O_NONBLOCK the open of a named pipe would wait for a writer. Regular files ignore the flag.
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) return system_error(path, "cannot open", errno);
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) return system_error(path, "cannot stat", errno);
  if (S_ISDIR(status.st_mode)) return Error{ErrorCode::kFile, path + ": is a folder, expected a file"};
  if (!S_ISREG(status.st_mode)) return Error{ErrorCode::kFile, path + ": is not a regular file"};

  MappedFile mapped;
  mapped.path_ = path;
  const auto size = static_cast<uint64_t>(status.st_size);
  if (size > std::numeric_limits<size_t>::max()) return system_error(path, "cannot map", ENOMEM);
  if (size == 0) return mapped;  // mmap refuses an empty range
  void* const address = ::mmap(nullptr, static_cast<size_t>(size), PROT_READ, MAP_PRIVATE, file.get(), 0);
  if (address == MAP_FAILED) return system_error(path, "cannot map", errno);
  mapped.data_ = static_cast<const std::byte*>(address);
  mapped.size_ = size;
  mapped.opened_ = status;
  mapped.descriptor_ = file.release();
  ::madvise(address, static_cast<size_t>(size), access == Access::kSequential ? MADV_SEQUENTIAL : MADV_NORMAL);
  return mapped;
}

MappedFile::MappedFile(MappedFile&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)),
      size_(std::exchange(other.size_, 0)),
      opened_(other.opened_),
      descriptor_(std::exchange(other.descriptor_, -1)),
      path_(std::move(other.path_)) {}

MappedFile& MappedFile::operator=(MappedFile&& other) noexcept {
  if (this == &other) return *this;
  unmap();
  data_ = std::exchange(other.data_, nullptr);
  size_ = std::exchange(other.size_, 0);
  opened_ = other.opened_;
  descriptor_ = std::exchange(other.descriptor_, -1);
  path_ = std::move(other.path_);
  return *this;
}

MappedFile::~MappedFile() {
  unmap();
}

void MappedFile::unmap() {
  if (data_ != nullptr) ::munmap(const_cast<std::byte*>(data_), static_cast<size_t>(size_));
  data_ = nullptr;
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
}

bool MappedFile::mincore_is_true() const {
  struct stat status {};
  if (descriptor_ < 0 || ::fstat(descriptor_, &status) != 0) return false;
  return ::geteuid() == 0 || ::geteuid() == status.st_uid || ::access(own_path(descriptor_).c_str(), W_OK) == 0;
}

double MappedFile::cached_share() const {
  constexpr uint64_t kSamples = 256;
  // Where mincore() is not reliable, a read with RWF_NOWAIT tests a page. It starts read-ahead if the page is not
  // cached, so it uses its own descriptor with FADV_RANDOM, which limits read-ahead to that page.
  const bool is_probed = descriptor_ >= 0 && !mincore_is_true();
  const Descriptor probe(is_probed ? ::open(own_path(descriptor_).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK) : -1);
  if (is_probed && (probe.get() < 0 || ::posix_fadvise(probe.get(), 0, 0, POSIX_FADV_RANDOM) != 0)) return 1;
  const uint64_t pages = (size_ + page_bytes() - 1) / page_bytes();
  const uint64_t samples = std::min(pages, kSamples);
  uint64_t cached = 0;
  for (uint64_t i = 0; i < samples; ++i) {
    const uint64_t page = i * (pages / samples) + i * (pages % samples) / samples;
    unsigned char state = 0;
    if (is_probed) {
      const iovec one{&state, 1};
      const ssize_t got = ::preadv2(probe.get(), &one, 1, static_cast<off_t>(page * page_bytes()), RWF_NOWAIT);
      if (got < 0 && errno != EAGAIN) return 1;  // this file system does not support RWF_NOWAIT
      cached += got == 1;
      continue;
    }
    void* const address = const_cast<std::byte*>(data_ + page * page_bytes());
    if (::mincore(address, 1, &state) != 0) return 1;
    cached += state & 1u;
  }
  return samples == 0 ? 1 : static_cast<double>(cached) / static_cast<double>(samples);
}

Result<void> MappedFile::read(uint64_t offset, std::span<std::byte> out) const {
  assert(format::range_within(offset, out.size(), size_));
  for (size_t done = 0; done < out.size();) {
    // Linux moves at most 0x7ffff000 bytes per call.
    const size_t part = std::min(out.size() - done, size_t{1} << 30);
    const ssize_t got = ::pread(descriptor_, out.data() + done, part, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Error{ErrorCode::kFile, std::string("cannot read: ") + std::strerror(errno)};
    if (got == 0) return ends_early(offset + done, size_);
    done += static_cast<size_t>(got);
  }
  return {};
}

Result<void> MappedFile::check_unchanged() const {
  if (descriptor_ < 0) return {};  // empty
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0)
    return Error{ErrorCode::kFile, std::string("cannot stat: ") + std::strerror(errno)};
  const auto size = static_cast<uint64_t>(status.st_size);
  if (size < size_) return ends_early(size, size_);
  if (!has_same_contents(status, opened_)) return Error{ErrorCode::kFile, "was changed after it was opened"};
  return {};
}

bool MappedFile::is_shorter() const {
  struct stat status {};
  return descriptor_ >= 0 && ::fstat(descriptor_, &status) == 0 && static_cast<uint64_t>(status.st_size) < size_;
}

void MappedFile::will_need(uint64_t offset, uint64_t size) const {
  if (offset >= size_) return;
  const uint64_t first = offset & ~(page_bytes() - 1);
  const uint64_t last = offset + std::min(size, size_ - offset);
  ::madvise(const_cast<std::byte*>(data_ + first), static_cast<size_t>(last - first), MADV_WILLNEED);
}

void MappedFile::release(uint64_t offset, uint64_t size) const {
  if (offset >= size_) return;
  const uint64_t page = page_bytes();
  const uint64_t end = offset + std::min(size, size_ - offset);
  const uint64_t first = (offset + page - 1) & ~(page - 1);
  const uint64_t last = end == size_ ? end : end & ~(page - 1);  // the file's last page may be partial
  if (first >= last) return;
  ::madvise(const_cast<std::byte*>(data_ + first), static_cast<size_t>(last - first), MADV_DONTNEED);
}

}  // namespace scree::runtime
