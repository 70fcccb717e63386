#include "format/container/part_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <utility>

namespace scree::format {
namespace {

// Linux moves at most 2 GiB per call.
constexpr size_t kMaxCallBytes = size_t{1} << 30;

// Writing of bytes behind this offset to the disk starts at once. Smaller files may be deleted before they have to.
constexpr uint64_t kFlushedFrom = uint64_t{256} << 20;

// Shorter writes are left to a later one, or to sync(): an entry of a log would cost the disk a whole block.
constexpr ssize_t kLeastFlushed = 4096;

/// Returns false where another program holds the lock. On a file system without locks it returns true: writing is still
/// correct, only not guarded against a second writer.
bool lock(int file) {
  int locked;
  do {
    locked = ::flock(file, LOCK_EX | LOCK_NB);
  } while (locked != 0 && errno == EINTR);
  return locked == 0 || errno != EWOULDBLOCK;
}

/// An open .part. The list is in static memory, because remove_open_parts() may neither allocate nor lock.
struct OpenPart {
  static constexpr int kFree = -1;
  static constexpr int kTaken = -2;  // its name is being written
  std::atomic<int> file{kFree};
  char name[1024];
};
static_assert(std::atomic<int>::is_always_lock_free, "a signal handler may only touch lock-free atomics");

std::array<OpenPart, 64> open_parts;

/// Enters a .part for remove_open_parts(). Does nothing if the list is full or the name too long; the .part then stays
/// behind if the program ends at once.
void note_part(const std::string& name, int file) noexcept {
  if (name.size() >= sizeof(OpenPart::name)) return;
  for (OpenPart& part : open_parts) {
    int expected = OpenPart::kFree;
    if (!part.file.compare_exchange_strong(expected, OpenPart::kTaken)) continue;
    std::copy_n(name.c_str(), name.size() + 1, part.name);
    part.file = file;
    return;
  }
}

/// Called before the file is closed: afterwards another file may have its descriptor.
void forget_part(int file) noexcept {
  for (OpenPart& part : open_parts)
    if (file >= 0 && part.file == file) part.file = OpenPart::kFree;
}

}  // namespace

void remove_open_parts() noexcept {
  for (const OpenPart& part : open_parts) {
    const int file = part.file;
    // Another thread may have renamed the file meanwhile, and another program may have taken over the .part.
    struct stat of_file;
    struct stat of_name;
    if (file >= 0 && ::fstat(file, &of_file) == 0 && ::lstat(part.name, &of_name) == 0 &&
        of_file.st_dev == of_name.st_dev && of_file.st_ino == of_name.st_ino)
      ::unlink(part.name);
  }
}

Error PartFile::error_of(const char* call, int error) const {
  return {ErrorCode::kFile, part_path_ + ": " + call + ": " + std::strerror(error)};
}

std::string PartFile::target_of(const std::string& path) {
  struct stat status;
  if (::lstat(path.c_str(), &status) != 0 || !S_ISLNK(status.st_mode)) return path;
  const std::unique_ptr<char, void (*)(void*)> target(::realpath(path.c_str(), nullptr), std::free);
  return target ? std::string(target.get()) : path;
}

/// Opens and locks the .part, and empties it for Content::kEmpty. A stale .part (of a killed run) is taken over; a
/// .part that a running writer has locked is not.
Result<PartFile> PartFile::create(const std::string& path, Content content, Existing existing) {
  if (path.empty()) return Error{ErrorCode::kFile, "a file without a name cannot be written"};
  PartFile part;
  part.existing_ = existing;
  part.path_ = target_of(path);
  part.part_path_ = part.path_ + ".part";
  struct stat target;
  if (::stat(part.path_.c_str(), &target) == 0) {
    if (!S_ISREG(target.st_mode))
      return Error{ErrorCode::kFile, path + (S_ISDIR(target.st_mode) ? ": is a folder" : ": is not a regular file")};
    part.mode_ = static_cast<int>(target.st_mode & 07777);
  }
  if (existing == Existing::kRefuse && ::lstat(path.c_str(), &target) == 0)
    return Error{ErrorCode::kFile, path + ": exists already"};
  const std::string& name = part.part_path_;
  // Between opening and locking, another writer may have renamed the opened file into place. That file must not be
  // emptied, so the lock counts only while the name still refers to the locked file.
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
    if (!lock(opened)) {
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": another program is writing it"};
    }
    struct stat of_name;
    if (::lstat(name.c_str(), &of_name) == 0 && of_name.st_dev == of_file.st_dev && of_name.st_ino == of_file.st_ino) {
      part.file_ = opened;
      part.is_part_ = true;
      if (content == Content::kEmpty) note_part(name, opened);  // else its content is worth keeping
      if (content == Content::kEmpty && ::ftruncate(opened, 0) != 0) return part.error_of("truncate", errno);
      return part;
    }
    ::close(opened);
  }
  return Error{ErrorCode::kFile, name + ": other programs keep replacing it"};
}

PartFile::PartFile(PartFile&& other) noexcept {
  *this = std::move(other);
}

PartFile& PartFile::operator=(PartFile&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(is_part_, other.is_part_);
  std::swap(is_kept_, other.is_kept_);
  std::swap(is_parked_, other.is_parked_);
  std::swap(has_name_, other.has_name_);
  std::swap(is_refused_, other.is_refused_);
  std::swap(existing_, other.existing_);
  std::swap(mode_, other.mode_);
  std::swap(parked_, other.parked_);
  std::swap(path_, other.path_);
  std::swap(part_path_, other.part_path_);
  return *this;
}

void PartFile::keep() {
  is_kept_ = true;
  forget_part(file_);
}

void PartFile::discard() noexcept {
  if (is_part_ && !is_kept_ && is_parked_) reopen();
  // The name is known to refer to this file only while the lock is held.
  if (std::exchange(is_part_, false) && !is_kept_ && file_ >= 0) ::unlink(part_path_.c_str());
  forget_part(file_);
  if (file_ >= 0) ::close(std::exchange(file_, -1));
}

Result<void> PartFile::write_at(uint64_t offset, std::span<const std::byte> bytes) const {
  if (file_ < 0) return not_open();
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(file_, bytes.data(), std::min(bytes.size(), kMaxCallBytes), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return error_of("write", written < 0 ? errno : ENOSPC);
    // Otherwise the kernel would keep gigabytes back until sync(), which would then wait for the whole file. Only a
    // hint.
    if (is_part_ && offset >= kFlushedFrom && written >= kLeastFlushed)
      ::sync_file_range(file_, static_cast<off_t>(offset), written, SYNC_FILE_RANGE_WRITE);
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

Result<void> PartFile::park() {
  SCREE_TRY(sync());
  struct stat status;
  if (::fstat(file_, &status) != 0) return error_of("stat", errno);
  parked_ = {status.st_dev, status.st_ino, status.st_size, status.st_ctim.tv_sec, status.st_ctim.tv_nsec};
  is_parked_ = true;
  forget_part(file_);
  if (::close(std::exchange(file_, -1)) != 0) return error_of("close", errno);
  return {};
}

/// Opens and locks a parked .part. Returns false if it is gone or another program has touched it.
bool PartFile::reopen() noexcept {
  const int opened = ::open(part_path_.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (opened < 0) return false;
  struct stat file;
  struct stat name;
  const bool is_same =
      lock(opened) && ::fstat(opened, &file) == 0 && ::lstat(part_path_.c_str(), &name) == 0 &&
      parked_ == Parked{name.st_dev, name.st_ino, name.st_size, name.st_ctim.tv_sec, name.st_ctim.tv_nsec} &&
      file.st_dev == name.st_dev && file.st_ino == name.st_ino;
  if (!is_same) {
    ::close(opened);
    return false;
  }
  file_ = opened;
  is_parked_ = false;
  return true;
}

Result<void> PartFile::hide() {
  if (!is_part_) return not_open();
  if (::unlink(part_path_.c_str()) != 0) return error_of("remove", errno);
  is_part_ = false;
  forget_part(file_);
  return {};
}

/// Renames the .part; fails if a file has the name already.
Result<void> PartFile::take_free_name() {
  const auto refused = [&] {
    is_refused_ = true;
    return Error{ErrorCode::kFile, path_ + ": exists already, another program has made it meanwhile"};
  };
  if (::renameat2(AT_FDCWD, part_path_.c_str(), AT_FDCWD, path_.c_str(), RENAME_NOREPLACE) == 0) return {};
  if (errno == EEXIST) return refused();
  if (errno != EINVAL && errno != ENOSYS) return error_of("rename", errno);
  // The file system or the kernel lacks this kind of rename. A hard link also fails if the name exists.
  if (::link(part_path_.c_str(), path_.c_str()) == 0) {
    has_name_ = true;
    if (::unlink(part_path_.c_str()) != 0) return error_of("remove", errno);
    return {};
  }
  if (errno == EEXIST) return refused();
  // The file system has no hard links either (FAT). A file that appears between the next two calls is replaced.
  struct stat status;
  if (::lstat(path_.c_str(), &status) == 0) return refused();
  if (std::rename(part_path_.c_str(), path_.c_str()) != 0) return error_of("rename", errno);
  return {};
}

Result<void> PartFile::take_name() {
  if (existing_ == Existing::kRefuse) return take_free_name();
  // File systems without permissions refuse this; nothing is lost.
  if (mode_ >= 0) (void)::fchmod(file_, static_cast<mode_t>(mode_));
  if (std::rename(part_path_.c_str(), path_.c_str()) != 0) return error_of("rename", errno);
  return {};
}

Result<void> PartFile::commit() {
  if (!is_part_) return not_open();
  if (is_parked_) {
    if (!reopen()) return Error{ErrorCode::kFile, part_path_ + ": another program has changed it meanwhile"};
  } else if (Result<void> synced = sync(); !synced) {
    return synced;
  }
  Result<void> named = take_name();
  has_name_ = has_name_ || named;
  if (has_name_) {
    is_part_ = false;
    forget_part(file_);
  }
  if (!named) return named;
  if (::close(std::exchange(file_, -1)) != 0)
    return Error{ErrorCode::kFile, path_ + ": close: " + std::strerror(errno)};
  return {};
}

}  // namespace scree::format
