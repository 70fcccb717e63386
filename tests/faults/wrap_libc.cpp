// The calls of the C library and of std::filesystem that may fail or stop half way, and operator new. CMakeLists.txt
// repeats the list of names, because a test compares it with the program's calls.
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
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

/// The number of bytes that a call for `size` bytes transfers: half if this call stops early. Linux does that for
/// signals, full disks and network file systems. Direct I/O stops at the end of a block.
size_t moved(const char* what, const void* site, int file, size_t size) {
  constexpr size_t kBlock = 4096;
  const bool is_direct = (::fcntl(file, F_GETFL) & O_DIRECT) != 0;
  const size_t half = is_direct ? size / 2 / kBlock * kBlock : size / 2;
  return half != 0 && fails(Kind::kShort, what, site) ? half : size;
}

}  // namespace

extern "C" {

/// A call that fails by setting errno to `error` and returning `failed`.
#define SCREE_WRAP(type, name, error, failed, parameters, arguments)           \
  type __real_##name parameters;                                               \
  type __wrap_##name parameters {                                              \
    if (fails(Kind::kFile, #name, SCREE_SITE)) return errno = (error), failed; \
    return __real_##name arguments;                                            \
  }

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
  const int done = __real_close(file);  // Linux closes the file in any case
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

/// For reads of cached pages alone. EOPNOTSUPP: a kernel or a file system without RWF_NOWAIT.
SCREE_WRAP(ssize_t, preadv2, EOPNOTSUPP, -1, (int file, const iovec* parts, int count, off_t offset, int flags),
           (file, parts, count, offset, flags))

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

SCREE_WRAP(int, ftruncate, EIO, -1, (int file, off_t size), (file, size))
SCREE_WRAP(int, fsync, EIO, -1, (int file), (file))
SCREE_WRAP(int, flock, ENOLCK, -1, (int file, int operation), (file, operation))
SCREE_WRAP(int, fstat, EIO, -1, (int file, struct stat* out), (file, out))
SCREE_WRAP(int, stat, EACCES, -1, (const char* path, struct stat* out), (path, out))
SCREE_WRAP(int, lstat, EACCES, -1, (const char* path, struct stat* out), (path, out))
SCREE_WRAP(int, rename, EIO, -1, (const char* from, const char* to), (from, to))
/// EINVAL: a file system without RENAME_NOREPLACE; the program then uses link().
SCREE_WRAP(int, renameat2, EINVAL, -1,
           (int from_folder, const char* from, int to_folder, const char* to, unsigned flags),
           (from_folder, from, to_folder, to, flags))
SCREE_WRAP(int, fchmod, EPERM, -1, (int file, mode_t mode), (file, mode))
SCREE_WRAP(int, link, EPERM, -1, (const char* from, const char* to), (from, to))
SCREE_WRAP(int, unlink, EIO, -1, (const char* path), (path))
SCREE_WRAP(int, access, EACCES, -1, (const char* path, int mode), (path, mode))
SCREE_WRAP(char*, realpath, EIO, nullptr, (const char* path, char* out), (path, out))
SCREE_WRAP(void*, mmap, ENOMEM, MAP_FAILED, (void* at, size_t size, int protection, int flags, int file, off_t offset),
           (at, size, protection, flags, file, offset))

int __real_munmap(void* at, size_t size);
int __wrap_munmap(void* at, size_t size) {
  const int done = __real_munmap(at, size);  // Linux unmaps in any case
  if (fails(Kind::kFile, "munmap", SCREE_SITE)) return errno = ENOMEM, -1;
  return done;
}

SCREE_WRAP(int, madvise, EAGAIN, -1, (void* at, size_t size, int advice), (at, size, advice))

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

SCREE_WRAP(int, mincore, EAGAIN, -1, (void* at, size_t size, unsigned char* out), (at, size, out))
SCREE_WRAP(FILE*, fopen, EMFILE, nullptr, (const char* path, const char* mode), (path, mode))
SCREE_WRAP(int, fflush, ENOSPC, EOF, (FILE * file), (file))
SCREE_WRAP(long, sysconf, EINVAL, -1, (int name), (name))
#undef SCREE_WRAP

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
