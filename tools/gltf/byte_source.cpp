#include "tools/gltf/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <utility>

#include "format/bytes.h"
#include "format/fail.h"
#include "runtime/files/file_state.h"
#include "tools/common/jobs/stage_rates.h"

namespace scree::convert {
namespace {

// Half of the usual limit of open files. The other half is for everything else that the process opens.
constexpr int kKeptDescriptors = 512;
std::atomic<int> kept_descriptors{0};

std::atomic<uint64_t> bytes_read{0};
std::atomic<uint64_t> nanoseconds_read{0};

Error file_error(const std::string& path, int number) {
  return {ErrorCode::kFile, path + ": " + std::strerror(number)};
}

// O_NONBLOCK: opening a FIFO must not wait for a writer. It has no effect on regular files.
int open_read_only(const std::string& path) {
  return ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
}

class FileSource final : public ByteSource {
 public:
  FileSource(std::string path, int descriptor, const struct stat& status)
      : path_(std::move(path)), descriptor_(descriptor), first_(status) {}
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;
  ~FileSource() override {
    if (descriptor_ < 0) return;
    ::close(descriptor_);
    --kept_descriptors;
  }

  uint64_t size() const override { return static_cast<uint64_t>(first_.st_size); }
  const std::string& path() const override { return path_; }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override { return read(offset, out, false); }
  Result<void> read_alone(uint64_t offset, std::span<std::byte> out) const override { return read(offset, out, true); }

  void will_need(uint64_t offset, uint64_t bytes) const override {
    if (offset >= size()) return;
    bytes = std::min(bytes, size() - offset);
    const int descriptor = descriptor_ >= 0 ? descriptor_ : open_read_only(path_);
    if (descriptor < 0) return;
    // Per call, Linux reads ahead at most the bytes of one disk request, or of its own read-ahead.
    constexpr uint64_t kPiece = 512 << 10;
    for (uint64_t done = 0; done < bytes; done += kPiece)
      ::posix_fadvise(descriptor, static_cast<off_t>(offset + done), static_cast<off_t>(std::min(kPiece, bytes - done)),
                      POSIX_FADV_WILLNEED);
    if (descriptor != descriptor_) ::close(descriptor);
  }

 private:
  /// Checks that a descriptor refers to the file that was opened first, unchanged. A path may name another file by now.
  Result<void> check_same(int descriptor) const {
    struct stat now {};
    if (::fstat(descriptor, &now) != 0) return file_error(path_, errno);
    if (!runtime::is_one_file(now, first_))
      return Error{ErrorCode::kFile, path_ + ": was replaced by another file while it was being read"};
    if (!runtime::has_same_contents(now, first_))
      return Error{ErrorCode::kFile, path_ + ": was changed while it was being read"};
    return {};
  }

  Result<void> read(uint64_t offset, std::span<std::byte> out, bool is_alone) const {
    SCREE_TRY_AT(path_, check_read(offset, out, size(), "file"));
    const Timed timed(nanoseconds_read, Spent::kReading);
    bytes_read.fetch_add(out.size(), std::memory_order_relaxed);
    // The advice would also hold for others' reads by descriptor_.
    if (descriptor_ >= 0 && !is_alone) return read_from(descriptor_, offset, out);
    const int descriptor = open_read_only(path_);
    if (descriptor < 0) return file_error(path_, errno);
    Result<void> result = check_same(descriptor);
    if (result && is_alone) ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_RANDOM);
    if (result) result = read_from(descriptor, offset, out);
    ::close(descriptor);
    return result;
  }

  Result<void> read_from(int descriptor, uint64_t offset, std::span<std::byte> out) const {
    while (!out.empty()) {
      // Linux moves at most 0x7ffff000 bytes per call.
      const size_t part = std::min<size_t>(out.size(), size_t{1} << 30);
      const ssize_t got = ::pread(descriptor, out.data(), part, static_cast<off_t>(offset));
      if (got < 0) {
        if (errno == EINTR) continue;
        return file_error(path_, errno);
      }
      if (got == 0)
        return fail(ErrorCode::kTruncated, path_, ": ends at byte ", offset, ", but had ", size(),
                    " when it was opened");
      offset += static_cast<uint64_t>(got);
      out = out.subspan(static_cast<size_t>(got));
    }
    return {};
  }

  std::string path_;
  int descriptor_;     // -1: opened for each read
  struct stat first_;  // at the first opening
};

class WindowSource final : public ByteSource {
 public:
  WindowSource(std::shared_ptr<const ByteSource> whole, uint64_t offset, uint64_t size)
      : whole_(std::move(whole)), offset_(offset), size_(size) {}

  uint64_t size() const override { return size_; }
  const std::string& path() const override { return whole_->path(); }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override {
    SCREE_TRY(check_read(offset, out, size_, "chunk"));
    return whole_->read(offset_ + offset, out);
  }

  Result<void> read_alone(uint64_t offset, std::span<std::byte> out) const override {
    SCREE_TRY(check_read(offset, out, size_, "chunk"));
    return whole_->read_alone(offset_ + offset, out);
  }

  void will_need(uint64_t offset, uint64_t bytes) const override { whole_->will_need(offset_ + offset, bytes); }

 private:
  std::shared_ptr<const ByteSource> whole_;
  uint64_t offset_;
  uint64_t size_;
};

class PartSource final : public ByteSource {
 public:
  PartSource(std::shared_ptr<const format::PartFile> file, uint64_t size) : file_(std::move(file)), size_(size) {}

  uint64_t size() const override { return size_; }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override {
    assert(format::range_within(offset, out.size(), size_));
    const Timed timed(nanoseconds_read, Spent::kReading);
    bytes_read.fetch_add(out.size(), std::memory_order_relaxed);
    return file_->read_at(offset, out);
  }

 private:
  std::shared_ptr<const format::PartFile> file_;
  uint64_t size_;
};

class MemorySource final : public ByteSource {
 public:
  explicit MemorySource(std::vector<std::byte> bytes) : bytes_(std::move(bytes)) {}

  uint64_t size() const override { return bytes_.size(); }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override {
    SCREE_TRY(check_read(offset, out, bytes_.size(), "data: URI"));
    if (!out.empty()) std::memcpy(out.data(), bytes_.data() + offset, out.size());
    return {};
  }

 private:
  std::vector<std::byte> bytes_;
};

}  // namespace

Result<void> check_read(uint64_t offset, std::span<const std::byte> out, uint64_t size, const char* what) {
  if (format::range_within(offset, out.size(), size)) return {};
  return fail(ErrorCode::kTruncated, "read of ", out.size(), " bytes at ", offset, ", but the ", what, " has ", size);
}

const std::string& ByteSource::path() const {
  static const std::string none;
  return none;
}

Result<std::shared_ptr<const ByteSource>> open_file_source(const std::string& path) {
  const int descriptor = open_read_only(path);
  if (descriptor < 0) return file_error(path, errno);
  struct stat status {};
  if (::fstat(descriptor, &status) != 0) {
    const int number = errno;
    ::close(descriptor);
    return file_error(path, number);
  }
  if (!S_ISREG(status.st_mode)) {
    ::close(descriptor);
    return Error{ErrorCode::kFile, path + ": not a regular file"};
  }
  if (kept_descriptors.fetch_add(1) < kKeptDescriptors)
    return std::shared_ptr<const ByteSource>(std::make_shared<FileSource>(path, descriptor, status));
  --kept_descriptors;
  ::close(descriptor);
  return std::shared_ptr<const ByteSource>(std::make_shared<FileSource>(path, -1, status));
}

ReadTotals read_totals() {
  return {bytes_read.load(std::memory_order_relaxed),
          1e-9 * static_cast<double>(nanoseconds_read.load(std::memory_order_relaxed))};
}

std::shared_ptr<const ByteSource> window_source(std::shared_ptr<const ByteSource> whole, uint64_t offset,
                                                uint64_t size) {
  return std::make_shared<WindowSource>(std::move(whole), offset, size);
}

std::shared_ptr<const ByteSource> part_source(std::shared_ptr<const format::PartFile> file, uint64_t size) {
  return std::make_shared<PartSource>(std::move(file), size);
}

std::shared_ptr<const ByteSource> memory_source(std::vector<std::byte> bytes) {
  return std::make_shared<MemorySource>(std::move(bytes));
}

}  // namespace scree::convert
