// The calls of the C library that may fail or stop half way, those of std::filesystem, and operator new. CMakeLists.txt
// has the list of names too, where a test compares it with the program's calls.
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <new>
#include <system_error>

#include "tests/faults/faults.h"

namespace fs = std::filesystem;

using scree::faults::fails;
using scree::faults::Kind;

#define SCREE_SITE __builtin_return_address(0)

namespace {

/// The number of bytes of `size` that a call transfers: half if this call stops early. Linux does that for signals,
/// full disks and network file systems. Direct I/O stops on whole blocks.
size_t moved(const char* what, const void* site, int file, size_t size) {
  constexpr size_t kBlock = 4096;
  const bool is_direct = (::fcntl(file, F_GETFL) & O_DIRECT) != 0;
  const size_t half = is_direct ? size / 2 / kBlock * kBlock : size / 2;
  return half != 0 && fails(Kind::kShort, what, site) ? half : size;
}

}  // namespace

extern "C" {

int __real_open(const char* path, int flags, ...);
int __wrap_open(const char* path, int flags, ...) {
  if (fails(Kind::kFile, "open", SCREE_SITE)) return errno = EMFILE, -1;
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = flags & O_CREAT ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  return __real_open(path, flags, mode);
}

int __real_close(int file);
int __wrap_close(int file) {
  const int done = __real_close(file);  // Linux closes it in any case
  if (fails(Kind::kFile, "close", SCREE_SITE)) return errno = EIO, -1;
  return done;
}

ssize_t __real_read(int file, void* out, size_t size);
ssize_t __wrap_read(int file, void* out, size_t size) {
  if (fails(Kind::kFile, "read", SCREE_SITE)) return errno = EIO, -1;
  return __real_read(file, out, moved("read", SCREE_SITE, file, size));
}

ssize_t __real_pread(int file, void* out, size_t size, off_t offset);
ssize_t __wrap_pread(int file, void* out, size_t size, off_t offset) {
  if (fails(Kind::kFile, "pread", SCREE_SITE)) return errno = EIO, -1;
  return __real_pread(file, out, moved("pread", SCREE_SITE, file, size), offset);
}

/// For reads that need cached pages: a kernel or a file system without RWF_NOWAIT.
ssize_t __real_preadv2(int file, const iovec* parts, int count, off_t offset, int flags);
ssize_t __wrap_preadv2(int file, const iovec* parts, int count, off_t offset, int flags) {
  if (fails(Kind::kFile, "preadv2", SCREE_SITE)) return errno = EOPNOTSUPP, -1;
  return __real_preadv2(file, parts, count, offset, flags);
}

ssize_t __real_write(int file, const void* bytes, size_t size);
ssize_t __wrap_write(int file, const void* bytes, size_t size) {
  if (fails(Kind::kFile, "write", SCREE_SITE)) return errno = ENOSPC, -1;
  return __real_write(file, bytes, moved("write", SCREE_SITE, file, size));
}

ssize_t __real_pwrite(int file, const void* bytes, size_t size, off_t offset);
ssize_t __wrap_pwrite(int file, const void* bytes, size_t size, off_t offset) {
  if (fails(Kind::kFile, "pwrite", SCREE_SITE)) return errno = ENOSPC, -1;
  return __real_pwrite(file, bytes, moved("pwrite", SCREE_SITE, file, size), offset);
}

int __real_ftruncate(int file, off_t size);
int __wrap_ftruncate(int file, off_t size) {
  if (fails(Kind::kFile, "ftruncate", SCREE_SITE)) return errno = EIO, -1;
  return __real_ftruncate(file, size);
}

int __real_fsync(int file);
int __wrap_fsync(int file) {
  if (fails(Kind::kFile, "fsync", SCREE_SITE)) return errno = EIO, -1;
  return __real_fsync(file);
}

int __real_flock(int file, int operation);
int __wrap_flock(int file, int operation) {
  if (fails(Kind::kFile, "flock", SCREE_SITE)) return errno = ENOLCK, -1;
  return __real_flock(file, operation);
}

int __real_fstat(int file, struct stat* out);
int __wrap_fstat(int file, struct stat* out) {
  if (fails(Kind::kFile, "fstat", SCREE_SITE)) return errno = EIO, -1;
  return __real_fstat(file, out);
}

int __real_stat(const char* path, struct stat* out);
int __wrap_stat(const char* path, struct stat* out) {
  if (fails(Kind::kFile, "stat", SCREE_SITE)) return errno = EACCES, -1;
  return __real_stat(path, out);
}

int __real_lstat(const char* path, struct stat* out);
int __wrap_lstat(const char* path, struct stat* out) {
  if (fails(Kind::kFile, "lstat", SCREE_SITE)) return errno = EACCES, -1;
  return __real_lstat(path, out);
}

int __real_rename(const char* from, const char* to);
int __wrap_rename(const char* from, const char* to) {
  if (fails(Kind::kFile, "rename", SCREE_SITE)) return errno = EIO, -1;
  return __real_rename(from, to);
}

/// EINVAL: a file system without RENAME_NOREPLACE, for which link() is the replacement.
int __real_renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags);
int __wrap_renameat2(int from_folder, const char* from, int to_folder, const char* to, unsigned flags) {
  if (fails(Kind::kFile, "renameat2", SCREE_SITE)) return errno = EINVAL, -1;
  return __real_renameat2(from_folder, from, to_folder, to, flags);
}

int __real_fchmod(int file, mode_t mode);
int __wrap_fchmod(int file, mode_t mode) {
  if (fails(Kind::kFile, "fchmod", SCREE_SITE)) return errno = EPERM, -1;
  return __real_fchmod(file, mode);
}

int __real_link(const char* from, const char* to);
int __wrap_link(const char* from, const char* to) {
  if (fails(Kind::kFile, "link", SCREE_SITE)) return errno = EPERM, -1;
  return __real_link(from, to);
}

int __real_unlink(const char* path);
int __wrap_unlink(const char* path) {
  if (fails(Kind::kFile, "unlink", SCREE_SITE)) return errno = EIO, -1;
  return __real_unlink(path);
}

int __real_access(const char* path, int mode);
int __wrap_access(const char* path, int mode) {
  if (fails(Kind::kFile, "access", SCREE_SITE)) return errno = EACCES, -1;
  return __real_access(path, mode);
}

char* __real_realpath(const char* path, char* out);
char* __wrap_realpath(const char* path, char* out) {
  if (fails(Kind::kFile, "realpath", SCREE_SITE)) return errno = EIO, nullptr;
  return __real_realpath(path, out);
}

void* __real_mmap(void* at, size_t size, int protection, int flags, int file, off_t offset);
void* __wrap_mmap(void* at, size_t size, int protection, int flags, int file, off_t offset) {
  if (fails(Kind::kFile, "mmap", SCREE_SITE)) return errno = ENOMEM, MAP_FAILED;
  return __real_mmap(at, size, protection, flags, file, offset);
}

int __real_munmap(void* at, size_t size);
int __wrap_munmap(void* at, size_t size) {
  const int done = __real_munmap(at, size);  // like close()
  if (fails(Kind::kFile, "munmap", SCREE_SITE)) return errno = ENOMEM, -1;
  return done;
}

int __real_madvise(void* at, size_t size, int advice);
int __wrap_madvise(void* at, size_t size, int advice) {
  if (fails(Kind::kFile, "madvise", SCREE_SITE)) return errno = EAGAIN, -1;
  return __real_madvise(at, size, advice);
}

int __real_sync_file_range(int file, off_t offset, off_t size, unsigned int flags);
int __wrap_sync_file_range(int file, off_t offset, off_t size, unsigned int flags) {
  if (fails(Kind::kFile, "sync_file_range", SCREE_SITE)) return -1;
  return __real_sync_file_range(file, offset, size, flags);
}

int __real_posix_fadvise(int file, off_t offset, off_t size, int advice);
int __wrap_posix_fadvise(int file, off_t offset, off_t size, int advice) {
  if (fails(Kind::kFile, "posix_fadvise", SCREE_SITE)) return EIO;
  return __real_posix_fadvise(file, offset, size, advice);
}

int __real_mincore(void* at, size_t size, unsigned char* out);
int __wrap_mincore(void* at, size_t size, unsigned char* out) {
  if (fails(Kind::kFile, "mincore", SCREE_SITE)) return errno = EAGAIN, -1;
  return __real_mincore(at, size, out);
}

FILE* __real_fopen(const char* path, const char* mode);
FILE* __wrap_fopen(const char* path, const char* mode) {
  if (fails(Kind::kFile, "fopen", SCREE_SITE)) return errno = EMFILE, nullptr;
  return __real_fopen(path, mode);
}

int __real_fflush(FILE* file);
int __wrap_fflush(FILE* file) {
  if (fails(Kind::kFile, "fflush", SCREE_SITE)) return errno = ENOSPC, EOF;
  return __real_fflush(file);
}

long __real_sysconf(int name);
long __wrap_sysconf(int name) {
  if (fails(Kind::kFile, "sysconf", SCREE_SITE)) return errno = EINVAL, -1;
  return __real_sysconf(name);
}

/// std::thread::hardware_concurrency(): 0 if it is unknown.
unsigned __real__ZNSt6thread20hardware_concurrencyEv();
unsigned __wrap__ZNSt6thread20hardware_concurrencyEv() {
  if (fails(Kind::kFile, "hardware_concurrency", SCREE_SITE)) return 0;
  return __real__ZNSt6thread20hardware_concurrencyEv();
}

/// The function behind the constructors of file streams, by its name in libstdc++.
std::filebuf* __real__ZNSt13basic_filebufIcSt11char_traitsIcEE4openEPKcSt13_Ios_Openmode(std::filebuf* buffer,
                                                                                         const char* path,
                                                                                         std::ios_base::openmode mode);
std::filebuf* __wrap__ZNSt13basic_filebufIcSt11char_traitsIcEE4openEPKcSt13_Ios_Openmode(std::filebuf* buffer,
                                                                                         const char* path,
                                                                                         std::ios_base::openmode mode) {
  if (fails(Kind::kFile, "filebuf::open", SCREE_SITE)) return nullptr;
  return __real__ZNSt13basic_filebufIcSt11char_traitsIcEE4openEPKcSt13_Ios_Openmode(buffer, path, mode);
}

void* __real_malloc(size_t size);
void* __wrap_malloc(size_t size) {
  if (fails(Kind::kMemory, "malloc", SCREE_SITE, size)) return errno = ENOMEM, nullptr;
  return __real_malloc(size);
}

void* __real_calloc(size_t count, size_t size);
void* __wrap_calloc(size_t count, size_t size) {
  if (fails(Kind::kMemory, "calloc", SCREE_SITE, count * size)) return errno = ENOMEM, nullptr;
  return __real_calloc(count, size);
}

void* __real_realloc(void* block, size_t size);
void* __wrap_realloc(void* block, size_t size) {
  if (fails(Kind::kMemory, "realloc", SCREE_SITE, size)) return errno = ENOMEM, nullptr;
  return __real_realloc(block, size);
}

/// std::thread's constructor, by its name in libstdc++: no thread is available.
void __real__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(void* thread,
                                                                                                  void* state,
                                                                                                  void (*depend)());
void __wrap__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(void* thread,
                                                                                                  void* state,
                                                                                                  void (*depend)()) {
  if (fails(Kind::kMemory, "std::thread", SCREE_SITE))
    throw std::system_error(EAGAIN, std::generic_category(), "Enable multithreading to use std::thread");
  __real__ZNSt6thread15_M_start_threadESt10unique_ptrINS_6_StateESt14default_deleteIS1_EEPFvvE(thread, state, depend);
}

/// A failing call of std::filesystem, by its name in libstdc++.
#define SCREE_WRAP_FILESYSTEM(symbol, what, type, failed, parameters, arguments) \
  type __real_##symbol parameters;                                               \
  type __wrap_##symbol parameters {                                              \
    if (fails(Kind::kFile, what, SCREE_SITE)) {                                  \
      error = std::error_code(EIO, std::generic_category());                     \
      return failed;                                                             \
    }                                                                            \
    return __real_##symbol arguments;                                            \
  }

SCREE_WRAP_FILESYSTEM(_ZNSt10filesystem6statusERKNS_7__cxx114pathERSt10error_code, "filesystem::status",
                      fs::file_status, fs::file_status(fs::file_type::none),
                      (const fs::path& path, std::error_code& error), (path, error))
SCREE_WRAP_FILESYSTEM(_ZNSt10filesystem9file_sizeERKNS_7__cxx114pathERSt10error_code, "filesystem::file_size",
                      uintmax_t, UINTMAX_MAX, (const fs::path& path, std::error_code& error), (path, error))
SCREE_WRAP_FILESYSTEM(_ZNSt10filesystem10equivalentERKNS_7__cxx114pathES3_RSt10error_code, "filesystem::equivalent",
                      bool, false, (const fs::path& a, const fs::path& b, std::error_code& error), (a, b, error))
SCREE_WRAP_FILESYSTEM(_ZNSt10filesystem5spaceERKNS_7__cxx114pathERSt10error_code, "filesystem::space", fs::space_info,
                      (fs::space_info{UINTMAX_MAX, UINTMAX_MAX, UINTMAX_MAX}),
                      (const fs::path& path, std::error_code& error), (path, error))
SCREE_WRAP_FILESYSTEM(_ZNSt10filesystem8absoluteERKNS_7__cxx114pathERSt10error_code, "filesystem::absolute", fs::path,
                      (fs::path()), (const fs::path& path, std::error_code& error), (path, error))
#undef SCREE_WRAP_FILESYSTEM

}  // extern "C"

// Replaced, which the language allows, so that calls from libstdc++ come here too.
namespace {

void* take(size_t size, size_t alignment) {
  if (size == 0) size = 1;
  return alignment == 0 ? __real_malloc(size)
                        : std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
}

void* take_or_throw(size_t size, size_t alignment, const void* site) {
  void* const block = fails(Kind::kMemory, "operator new", site, size) ? nullptr : take(size, alignment);
  if (block == nullptr) throw std::bad_alloc();
  return block;
}

}  // namespace

void* operator new(size_t size) {
  return take_or_throw(size, 0, SCREE_SITE);
}
void* operator new[](size_t size) {
  return take_or_throw(size, 0, SCREE_SITE);
}
void* operator new(size_t size, std::align_val_t alignment) {
  return take_or_throw(size, static_cast<size_t>(alignment), SCREE_SITE);
}
void* operator new[](size_t size, std::align_val_t alignment) {
  return take_or_throw(size, static_cast<size_t>(alignment), SCREE_SITE);
}
void* operator new(size_t size, const std::nothrow_t&) noexcept {
  return fails(Kind::kMemory, "operator new", SCREE_SITE, size) ? nullptr : take(size, 0);
}
void* operator new[](size_t size, const std::nothrow_t&) noexcept {
  return fails(Kind::kMemory, "operator new", SCREE_SITE, size) ? nullptr : take(size, 0);
}
void* operator new(size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  return fails(Kind::kMemory, "operator new", SCREE_SITE, size) ? nullptr : take(size, static_cast<size_t>(alignment));
}
void* operator new[](size_t size, std::align_val_t alignment, const std::nothrow_t&) noexcept {
  return fails(Kind::kMemory, "operator new", SCREE_SITE, size) ? nullptr : take(size, static_cast<size_t>(alignment));
}
void operator delete(void* block) noexcept {
  std::free(block);
}
void operator delete[](void* block) noexcept {
  std::free(block);
}
void operator delete(void* block, size_t) noexcept {
  std::free(block);
}
void operator delete[](void* block, size_t) noexcept {
  std::free(block);
}
void operator delete(void* block, std::align_val_t) noexcept {
  std::free(block);
}
void operator delete[](void* block, std::align_val_t) noexcept {
  std::free(block);
}
void operator delete(void* block, size_t, std::align_val_t) noexcept {
  std::free(block);
}
void operator delete[](void* block, size_t, std::align_val_t) noexcept {
  std::free(block);
}
void operator delete(void* block, const std::nothrow_t&) noexcept {
  std::free(block);
}
void operator delete[](void* block, const std::nothrow_t&) noexcept {
  std::free(block);
}
void operator delete(void* block, std::align_val_t, const std::nothrow_t&) noexcept {
  std::free(block);
}
void operator delete[](void* block, std::align_val_t, const std::nothrow_t&) noexcept {
  std::free(block);
}
