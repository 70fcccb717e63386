// libnccl.so.2 for processes with emulated GPUs: the functions that runtime/draw/nccl_group.cpp uses. The processes
// exchange through a file in their folder, which each of them maps. The emulated program finds this library by its
// RPATH. An exchange is done at once, after the earlier work of the stream, and not in the background. With
// SCREE_EMULATED_NCCL=connect:1, rank 1 fails to connect. With exchange:1 its exchanges fail. With late:1 they fail
// after the first two, which are a part of connecting; with later:1 after the first three.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cuda_runtime_api.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>

namespace {

constexpr int kSuccess = 0, kSystemError = 2, kInvalidArgument = 4, kRemoteError = 6;
constexpr int kUint32 = 3, kUint64 = 5, kMax = 2, kMin = 3;
constexpr size_t kSlotBytes = size_t{1} << 20;

struct UniqueId {
  char name[128];
};

/// The part that all processes of a group share. A slot of kSlotBytes per process follows.
struct Room {
  std::atomic<uint64_t> arrivals;
};

struct Group {
  int rank = 0, count = 0;
  uint64_t barriers = 0, exchanges = 0;
  std::byte* memory = nullptr;

  size_t bytes() const { return kSlotBytes * (static_cast<size_t>(count) + 1); }
  std::byte* slot(int of) const { return memory + kSlotBytes * (static_cast<size_t>(of) + 1); }

  void wait_for_all() {
    std::atomic<uint64_t>& arrivals = reinterpret_cast<Room*>(memory)->arrivals;
    ++arrivals;
    const uint64_t all = ++barriers * static_cast<uint64_t>(count);
    while (arrivals < all) std::this_thread::yield();
  }

  /// `root`: the only rank that writes. -1: all ranks write.
  template <class T>
  void exchange(const T* from, T* to, size_t words, bool takes_least, int root) {
    constexpr size_t kBand = kSlotBytes / sizeof(T);
    for (size_t first = 0; first < words; first += kBand) {
      const size_t band = std::min(kBand, words - first);
      std::memcpy(slot(rank), from + first, band * sizeof(T));
      wait_for_all();
      for (size_t i = 0; (root < 0 || root == rank) && i < band; ++i) {
        T best = reinterpret_cast<const T*>(slot(0))[i];
        for (int other = 1; other < count; ++other) {
          const T word = reinterpret_cast<const T*>(slot(other))[i];
          best = takes_least ? std::min(best, word) : std::max(best, word);
        }
        to[first + i] = best;
      }
      wait_for_all();
    }
  }
};

bool fails(const char* at, int rank) {
  const char* const wanted = std::getenv("SCREE_EMULATED_NCCL");
  return wanted != nullptr && wanted == std::string(at) + ":" + std::to_string(rank);
}

int exchange(const void* from, void* to, size_t words, int type, int operation, int root, Group* group,
             cudaStream_t stream) {
  ++group->exchanges;
  if (fails("exchange", group->rank) || (group->exchanges > 2 && fails("late", group->rank)) ||
      (group->exchanges > 3 && fails("later", group->rank)))
    return kRemoteError;
  if ((type != kUint32 && type != kUint64) || (operation != kMin && operation != kMax)) return kInvalidArgument;
  if (cudaStreamSynchronize(stream) != cudaSuccess) return kSystemError;
  if (type == kUint32)
    group->exchange(static_cast<const uint32_t*>(from), static_cast<uint32_t*>(to), words, operation == kMin, root);
  else
    group->exchange(static_cast<const uint64_t*>(from), static_cast<uint64_t*>(to), words, operation == kMin, root);
  return kSuccess;
}

}  // namespace

extern "C" {

int ncclGetUniqueId(UniqueId* id) {
  std::snprintf(id->name, sizeof id->name, "nccl-%ld", static_cast<long>(::getpid()));
  return kSuccess;
}

int ncclCommInitRank(void** comm, int count, UniqueId id, int rank) {
  if (fails("connect", rank)) return kSystemError;
  auto* const group = new Group{rank, count};
  const int file = ::open(id.name, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0 || ::ftruncate(file, static_cast<off_t>(group->bytes())) != 0) return kSystemError;
  void* const memory = ::mmap(nullptr, group->bytes(), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  (void)::close(file);
  if (memory == MAP_FAILED) return kSystemError;
  group->memory = static_cast<std::byte*>(memory);
  group->wait_for_all();
  if (rank == 0) (void)::unlink(id.name);
  *comm = group;
  return kSuccess;
}

int ncclCommAbort(Group* group) {
  (void)::munmap(group->memory, group->bytes());
  delete group;
  return kSuccess;
}

int ncclCommGetAsyncError(Group*, int* state) {
  *state = kSuccess;
  return kSuccess;
}

const char* ncclGetErrorString(int code) {
  return code == kRemoteError ? "emulated remote error" : "emulated error";
}

int ncclAllReduce(const void* from, void* to, size_t words, int type, int operation, Group* group,
                  cudaStream_t stream) {
  return exchange(from, to, words, type, operation, -1, group, stream);
}

int ncclReduce(const void* from, void* to, size_t words, int type, int operation, int root, Group* group,
               cudaStream_t stream) {
  return exchange(from, to, words, type, operation, root, group, stream);
}

}  // extern "C"
