#include "runtime/draw/nccl_group.h"

#include <dlfcn.h>

#include <cuda_runtime_api.h>

#include <algorithm>
#include <string>
#include <thread>
#include <utility>

#include "kernels/cuda/common/check.h"

namespace scree::runtime {

using kernels::cuda_check;

namespace {

// The part of NCCL's interface that is used (docs.nvidia.com/deeplearning/nccl, "NCCL API"): the same in all 2.x.
using Comm = void*;
struct UniqueId {
  char internal[128];
};
constexpr int kSuccess = 0, kInProgress = 7;
constexpr int kUint32 = 3, kUint64 = 5;
constexpr int kMax = 2, kMin = 3;

struct Library {
  int (*ncclGetUniqueId)(UniqueId* id) = nullptr;
  int (*ncclCommInitRank)(Comm* comm, int count, UniqueId id, int rank) = nullptr;
  int (*ncclCommAbort)(Comm comm) = nullptr;
  int (*ncclCommGetAsyncError)(Comm comm, int* state) = nullptr;
  const char* (*ncclGetErrorString)(int code) = nullptr;
  int (*ncclAllReduce)(const void* from, void* to, size_t count, int type, int operation, Comm comm,
                       cudaStream_t stream) = nullptr;
  int (*ncclReduce)(const void* from, void* to, size_t count, int type, int operation, int root, Comm comm,
                    cudaStream_t stream) = nullptr;
};

}  // namespace

struct NcclGroup::Impl {
  Library api;
  Comm comm = nullptr;
  kernels::DeviceEvent queued;

  /// The library stays open: its threads may outlive the connections.
  ~Impl() {
    if (comm != nullptr) (void)api.ncclCommAbort(comm);
  }

  Result<void> open() {
    void* const library = ::dlopen("libnccl.so.2", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      const char* const why = ::dlerror();
      return Error{ErrorCode::kUnsupported, why == nullptr ? "libnccl.so.2 cannot be opened" : why};
    }
    const char* missing = nullptr;
    const auto find = [&]<class Function>(Function*& function, const char* name) {
      function = reinterpret_cast<Function*>(::dlsym(library, name));
      if (function == nullptr) missing = name;
    };
    find(api.ncclGetUniqueId, "ncclGetUniqueId");
    find(api.ncclCommInitRank, "ncclCommInitRank");
    find(api.ncclCommAbort, "ncclCommAbort");
    find(api.ncclCommGetAsyncError, "ncclCommGetAsyncError");
    find(api.ncclGetErrorString, "ncclGetErrorString");
    find(api.ncclAllReduce, "ncclAllReduce");
    find(api.ncclReduce, "ncclReduce");
    if (missing == nullptr) return {};
    return Error{ErrorCode::kUnsupported, std::string("libnccl.so.2 has no ") + missing};
  }

  Result<void> check(int code, const char* what) const {
    if (code == kSuccess || code == kInProgress) return {};
    return Error{ErrorCode::kDevice, std::string("NCCL: ") + what + ": " + api.ncclGetErrorString(code)};
  }
};

NcclGroup::NcclGroup(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NcclGroup::NcclGroup(NcclGroup&&) noexcept = default;
NcclGroup& NcclGroup::operator=(NcclGroup&&) noexcept = default;
NcclGroup::~NcclGroup() = default;

Result<NcclGroup> NcclGroup::open() {
  auto impl = std::make_unique<Impl>();
  SCREE_TRY(impl->open());
  return NcclGroup(std::move(impl));
}

Result<NcclGroup::Id> NcclGroup::make_id() const {
  UniqueId made{};
  SCREE_TRY(impl_->check(impl_->api.ncclGetUniqueId(&made), "making a group's id"));
  return std::to_array(made.internal);
}

Result<void> NcclGroup::connect(const Id& id, uint32_t number, uint32_t count, uint64_t words) {
  UniqueId name{};
  std::copy(id.begin(), id.end(), name.internal);
  SCREE_TRY(
      impl_->check(impl_->api.ncclCommInitRank(&impl_->comm, static_cast<int>(count), name, static_cast<int>(number)),
                   "connecting the ranks"));
  SCREE_TRY(impl_->queued.make(cudaEventDisableTiming));
  kernels::DeviceBuffer room = SCREE_TRY(
      kernels::DeviceBuffer::allocate(std::max<uint64_t>(words, 1) * sizeof(uint64_t), "allocating words to exchange"));
  SCREE_TRY(cuda_check(cudaMemset(room.data(), 0, room.bytes()), "clearing words to exchange"));
  SCREE_TRY(least(reinterpret_cast<uint64_t*>(room.data()), words, nullptr));
  SCREE_TRY(most(reinterpret_cast<uint32_t*>(room.data()), words, 0, nullptr));
  return wait(nullptr);
}

Result<void> NcclGroup::least(uint64_t* words, uint64_t count, void* stream) {
  return impl_->check(
      impl_->api.ncclAllReduce(words, words, count, kUint64, kMin, impl_->comm, static_cast<cudaStream_t>(stream)),
      "joining the samples of all ranks");
}

Result<void> NcclGroup::most(uint32_t* words, uint64_t count, uint32_t root, void* stream) {
  return impl_->check(impl_->api.ncclReduce(words, words, count, kUint32, kMax, static_cast<int>(root), impl_->comm,
                                            static_cast<cudaStream_t>(stream)),
                      "gathering the colours of all ranks");
}

Result<void> NcclGroup::wait(void* stream) {
  SCREE_TRY(cuda_check(cudaEventRecord(impl_->queued, static_cast<cudaStream_t>(stream)), "recording an event"));
  for (;;) {
    const cudaError_t status = cudaEventQuery(impl_->queued);
    const Result<void> reached = cuda_check(status, "exchanging a picture");
    if (status != cudaErrorNotReady) return reached;
    int state = kSuccess;
    Result<void> done = impl_->check(impl_->api.ncclCommGetAsyncError(impl_->comm, &state), "looking for an error");
    if (done) done = impl_->check(state, "exchanging a picture");
    if (!done) {
      (void)impl_->api.ncclCommAbort(std::exchange(impl_->comm, nullptr));
      return done;
    }
    std::this_thread::yield();
  }
}

}  // namespace scree::runtime
