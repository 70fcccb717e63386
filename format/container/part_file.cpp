#include "format/container/part_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace scree::format {
namespace {

// Linux moves at most 2 GiB a call.
constexpr size_t kMaxCallBytes = size_t{1} << 30;

}  // namespace

Error PartFile::error_of(const char* call, int error) const {
  return {ErrorCode::kFile, part_path_ + ": " + call + ": " + std::strerror(error)};
}

/// Opens, locks and, where that is asked, empties the .part. A stale one (of a run that was killed) is taken over; one
/// that a running writer holds is not.
Result<PartFile> PartFile::create(const std::string& path, Content content) {
  if (path.empty()) return Error{ErrorCode::kFile, "a file without a name cannot be written"};
  struct stat target;
  if (::stat(path.c_str(), &target) == 0 && !S_ISREG(target.st_mode)) {
    return Error{ErrorCode::kFile, path + (S_ISDIR(target.st_mode) ? ": is a folder" : ": is not a regular file")};
  }
  PartFile part;
  part.path_ = path;
  part.part_path_ = path + ".part";
  const std::string& name = part.part_path_;
  // Between opening and locking, another writer may have renamed the file that was opened into place, and it must not
  // be emptied then: the lock counts only while the name still means the locked file.
  for (int attempt = 0; attempt < 100; ++attempt) {
    const int opened = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (opened < 0) return Error{ErrorCode::kFile, name + ": open: " + std::strerror(errno)};
    struct stat of_file;
    if (::fstat(opened, &of_file) != 0) {
      const int error = errno;
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": stat: " + std::strerror(error)};
    }
    if (!S_ISREG(of_file.st_mode)) {
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": is not a regular file"};
    }
    int locked;
    do {
      locked = ::flock(opened, LOCK_EX | LOCK_NB);
    } while (locked != 0 && errno == EINTR);
    // Some file systems have no locks: writing is still right there, only not guarded against a second writer.
    if (locked != 0 && errno == EWOULDBLOCK) {
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": another program is writing it"};
    }
    struct stat of_name;
    if (::lstat(name.c_str(), &of_name) == 0 && of_name.st_dev == of_file.st_dev && of_name.st_ino == of_file.st_ino) {
      part.file_ = opened;
      part.is_part_ = true;
      if (content == Content::kEmpty && ::ftruncate(opened, 0) != 0) return part.error_of("truncate", errno);
      return part;
    }
    ::close(opened);
  }
  return Error{ErrorCode::kFile, name + ": other programs keep replacing it"};
}

PartFile::PartFile(PartFile&& other) noexcept
    : file_(std::exchange(other.file_, -1)),
      is_part_(std::exchange(other.is_part_, false)),
      is_kept_(other.is_kept_),
      path_(std::exchange(other.path_, {})),
      part_path_(std::exchange(other.part_path_, {})) {}

PartFile& PartFile::operator=(PartFile&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(is_part_, other.is_part_);
  std::swap(is_kept_, other.is_kept_);
  std::swap(path_, other.path_);
  std::swap(part_path_, other.part_path_);
  return *this;
}

void PartFile::discard() noexcept {
  // While the lock on it is held, so that it is ours.
  if (std::exchange(is_part_, false) && !is_kept_) ::unlink(part_path_.c_str());
  if (file_ >= 0) ::close(std::exchange(file_, -1));
}

Result<void> PartFile::write_at(uint64_t offset, std::span<const std::byte> bytes) const {
  if (file_ < 0) return not_open();
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(file_, bytes.data(), std::min(bytes.size(), kMaxCallBytes), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return error_of("write", written < 0 ? errno : ENOSPC);
    offset += static_cast<uint64_t>(written);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return {};
}

Result<void> PartFile::read_at(uint64_t offset, std::span<std::byte> out) const {
  if (file_ < 0) return not_open();
  while (!out.empty()) {
    const ssize_t got = ::pread(file_, out.data(), std::min(out.size(), kMaxCallBytes), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return error_of("read back", errno);
    if (got == 0) return Error{ErrorCode::kFile, part_path_ + ": shorter than what was written to it"};
    offset += static_cast<uint64_t>(got);
    out = out.subspan(static_cast<size_t>(got));
  }
  return {};
}

Result<uint64_t> PartFile::size() const {
  if (file_ < 0) return not_open();
  struct stat status;
  if (::fstat(file_, &status) != 0) return error_of("stat", errno);
  return static_cast<uint64_t>(status.st_size);
}

Result<void> PartFile::resize(uint64_t bytes) const {
  if (file_ < 0) return not_open();
  if (::ftruncate(file_, static_cast<off_t>(bytes)) != 0) return error_of("resize", errno);
  return {};
}

Result<void> PartFile::sync() const {
  if (file_ < 0) return not_open();
  while (::fsync(file_) != 0) {
    if (errno != EINTR) return error_of("sync", errno);
  }
  return {};
}

Result<void> PartFile::close() {
  if (file_ < 0) return not_open();
  if (::close(std::exchange(file_, -1)) != 0) return error_of("close", errno);
  return {};
}

Result<void> PartFile::hide() {
  if (!is_part_) return not_open();
  if (::unlink(part_path_.c_str()) != 0) return error_of("remove", errno);
  is_part_ = false;
  return {};
}

Result<void> PartFile::commit() {
  if (!is_part_) return not_open();
  if (std::rename(part_path_.c_str(), path_.c_str()) != 0) return error_of("rename", errno);
  is_part_ = false;
  discard();
  return {};
}

}  // namespace scree::format
