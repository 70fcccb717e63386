#include "runtime/part_file.h"

#include <cerrno>
#include <cstring>
#include <utility>

#include <unistd.h>

namespace scree::runtime {
namespace {

std::string part_of(const std::string& path) {
  return path + ".part";
}

}  // namespace

Result<PartFile> PartFile::create(const std::string& path) {
  std::FILE* const file = std::fopen(part_of(path).c_str(), "wbe");
  if (file == nullptr) return Error{ErrorCode::kFile, path + ": cannot write: " + std::strerror(errno)};
  return PartFile(path, file);
}

PartFile::PartFile(PartFile&& other) noexcept
    : path_(std::move(other.path_)), file_(std::exchange(other.file_, nullptr)), failure_(other.failure_) {}

PartFile::~PartFile() {
  if (file_ == nullptr) return;
  std::fclose(file_);
  ::unlink(part_of(path_).c_str());
}

bool PartFile::write(const void* bytes, size_t size) {
  if (failure_ != 0) return false;
  if (size == 0 || std::fwrite(bytes, 1, size, file_) == size) return true;
  failure_ = errno != 0 ? errno : EIO;
  return false;
}

Result<void> PartFile::commit() {
  if (std::fflush(file_) != 0 && failure_ == 0) failure_ = errno;
  if (std::fclose(std::exchange(file_, nullptr)) != 0 && failure_ == 0) failure_ = errno;
  if (failure_ == 0 && std::rename(part_of(path_).c_str(), path_.c_str()) != 0) failure_ = errno;
  if (failure_ == 0) return {};
  ::unlink(part_of(path_).c_str());
  return Error{ErrorCode::kFile, path_ + ": cannot write: " + std::strerror(failure_)};
}

}  // namespace scree::runtime
