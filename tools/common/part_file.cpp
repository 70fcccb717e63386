#include "tools/common/part_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

namespace scree::tools {
namespace {

// Linux moves at most 2 GiB a call.
constexpr size_t kMaxCallBytes = size_t{1} << 30;

std::string part_name(const std::string& path) {
  return path + ".part";
}

Error system_error(const std::string& path, const char* what) {
  return {ErrorCode::kFile, path + ": " + what + ": " + std::strerror(errno)};
}

}  // namespace

Result<PartFile> PartFile::create(std::string path) {
  PartFile part;
  part.file_ = ::open(part_name(path).c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (part.file_ < 0) return system_error(part_name(path), "cannot create");
  part.path_ = std::move(path);
  return part;
}

PartFile::PartFile(PartFile&& other) noexcept
    : file_(std::exchange(other.file_, -1)), path_(std::exchange(other.path_, {})) {}

PartFile& PartFile::operator=(PartFile&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(path_, other.path_);
  return *this;
}

PartFile::~PartFile() {
  if (file_ >= 0) ::close(file_);
  if (!path_.empty()) ::unlink(part_name(path_).c_str());
}

Result<void> PartFile::write_at(uint64_t offset, std::span<const std::byte> bytes) const {
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(file_, bytes.data(), std::min(bytes.size(), kMaxCallBytes), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return system_error(part_name(path_), "cannot write");
    offset += static_cast<uint64_t>(written);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return {};
}

Result<void> PartFile::read_at(uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const ssize_t got = ::pread(file_, out.data(), std::min(out.size(), kMaxCallBytes), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return system_error(part_name(path_), "cannot read back");
    if (got == 0) return Error{ErrorCode::kFile, part_name(path_) + ": shorter than what was written to it"};
    offset += static_cast<uint64_t>(got);
    out = out.subspan(static_cast<size_t>(got));
  }
  return {};
}

Result<void> PartFile::resize(uint64_t bytes) const {
  if (::ftruncate(file_, static_cast<off_t>(bytes)) != 0) return system_error(part_name(path_), "cannot resize");
  return {};
}

Result<void> PartFile::close() {
  if (::close(std::exchange(file_, -1)) != 0) return system_error(part_name(path_), "cannot close");
  return {};
}

Result<void> PartFile::commit() {
  if (file_ >= 0) {
    Result<void> closed = close();
    if (!closed) return closed;
  }
  if (std::rename(part_name(path_).c_str(), path_.c_str()) != 0) return system_error(path_, "cannot rename to it");
  path_.clear();
  return {};
}

}  // namespace scree::tools
