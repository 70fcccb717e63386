#include <cuda_pipeline_primitives.h>
#include <cuda_runtime.h>

#include <string>
#include <vector>

#include "kernels/cuda/common/check.h"
#include "tests/emulator/cases.h"

namespace scree::emulator {
namespace {

constexpr uint32_t kThreads = 96;
constexpr uint32_t kBlocks = 5;

/// The errors that a lane of `intrinsics` finds, one bit each.
__global__ void __launch_bounds__(kThreads) intrinsics(uint32_t* wrong, unsigned long long* sums) {
  const uint32_t lane = threadIdx.x % 32;
  const uint32_t thread = blockIdx.x * blockDim.x + threadIdx.x;
  uint32_t bits = 0;
  const auto expect = [&](uint32_t number, bool holds) { bits |= holds ? 0u : 1u << number; };
  expect(0, __shfl_sync(~0u, 3 * lane, 7) == 21);
  expect(1, __shfl_xor_sync(~0u, uint64_t{lane} << 40, 5) == uint64_t{lane ^ 5} << 40);
  expect(2, __shfl_up_sync(~0u, lane, 4) == (lane < 4 ? lane : lane - 4));
  expect(3, __ballot_sync(~0u, lane % 3 == 0) == 0x49249249u);
  expect(4, __match_any_sync(~0u, lane % 4) == 0x11111111u << lane % 4);
  expect(5, __reduce_add_sync(~0u, lane) == 496);
  expect(6, __reduce_max_sync(~0u, lane ^ 21u) == 31);
  expect(7, __reduce_or_sync(~0u, 1u << lane) == ~0u);
  // Each half of the warp synchronises without the other one.
  if (lane < 16) {
    expect(8, __ballot_sync(0xffffu, true) == 0xffffu);
  } else {
    expect(8, __shfl_sync(0xffff0000u, lane, 31) == 31);
    expect(9, __reduce_add_sync(0xffff0000u, 1u) == 16);
  }
  __syncwarp();
  expect(10, __funnelshift_r(0x89abcdefu, 0x01234567u, 8) == 0x6789abcdu);
  expect(11, __funnelshift_rc(0x89abcdefu, 0x01234567u, 40) == 0x01234567u);
  expect(12, __funnelshift_l(0x89abcdefu, 0x01234567u, 8) == 0x23456789u);
  expect(13, __byte_perm(0x33221100u, 0x77665544u, 0x7031) == 0x77003311u);
  expect(14, __vmaxu2(0x0001ffffu, 0x00020001u) == 0x0002ffffu);
  expect(15, __vmins2(0x0001ffffu, 0x00020001u) == 0x0001ffffu && __vsub2(0x00010003u, 0x0002ffffu) == 0xffff0004u);
  expect(16, __fns(0xf0u, 0, 2) == 5);
  expect(17, __ffs(0) == 0 && __ffs(8) == 4 && __popc(0xffu) == 8);
  atomicAdd(sums, uint64_t{thread});
  atomicMax(sums + 1, uint64_t{thread});
  atomicMin(sums + 2, uint64_t{thread});
  expect(18, atomicCAS(sums + 3 + thread, 0ull, 5ull) == 0);
  expect(19, atomicCAS(sums + 3 + thread, 0ull, 6ull) == 5);
  wrong[thread] = bits;
}

__global__ void __launch_bounds__(kThreads) shared_sums(const uint4* from, uint32_t* sums, uint32_t* garbage) {
  extern __shared__ uint4 pieces[];
  __shared__ uint32_t parts[kThreads];
  garbage[blockIdx.x * kThreads + threadIdx.x] = parts[threadIdx.x];
  __pipeline_memcpy_async(pieces + threadIdx.x, from + threadIdx.x, sizeof(uint4));
  __pipeline_commit();
  const uint32_t early = pieces[threadIdx.x].x;
  __pipeline_wait_prior(0);
  parts[threadIdx.x] = early == from[threadIdx.x].x ? 0 : pieces[threadIdx.x].x;
  __syncthreads();
  uint32_t sum = 0;
  for (uint32_t i = 0; i < kThreads; ++i) sum += parts[(i + threadIdx.x) % kThreads];
  sums[blockIdx.x * kThreads + threadIdx.x] = sum;
}

__global__ void add_one(uint32_t* value) {
  ++*value;
}

__global__ void ended_lane() {
  if (threadIdx.x == 3) return;
  __syncwarp();
}
__global__ void other_collective(uint32_t* out) {
  *out = threadIdx.x == 0 ? __ballot_sync(~0u, true) : __shfl_sync(~0u, threadIdx.x, 0);
}
__global__ void foreign_lane(uint32_t* out) {
  if (threadIdx.x < 8) *out = __shfl_sync(0xffu, threadIdx.x, 9);
}
__global__ void not_of_mask() {
  __syncwarp(0xfu);
}
__global__ void stuck() {
  if (threadIdx.x == 0) {
    __syncwarp(0x3u);
  } else {
    __syncthreads();
  }
}

__global__ void overrun(uint32_t* word) {
  word[1] = 1;
}

using Buffer = kernels::DeviceBuffer;

Buffer buffer_of(size_t bytes) {
  Result<Buffer> made = Buffer::allocate(bytes, "for a test");
  if (!made) fail("%s", made.error().message.c_str());
  return std::move(*made);
}

void must(cudaError_t status) {
  if (status != cudaSuccess) fail("%s", cudaGetErrorString(status));
}

std::vector<uint32_t> words_of(const Buffer& buffer) {
  std::vector<uint32_t> words(buffer.bytes() / sizeof(uint32_t));
  must(cudaMemcpy(words.data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost));
  return words;
}

}  // namespace

std::string check_intrinsics() {
  constexpr uint32_t kAll = kThreads * kBlocks;
  Buffer wrong = buffer_of(kAll * sizeof(uint32_t)), sums = buffer_of((3 + kAll) * sizeof(uint64_t));
  must(cudaMemset(sums.data(), 0, sums.bytes()));
  must(cudaMemset(sums.data() + 2 * sizeof(uint64_t), 0xff, sizeof(uint64_t)));
  intrinsics<<<kBlocks, kThreads>>>(reinterpret_cast<uint32_t*>(wrong.data()),
                                    reinterpret_cast<unsigned long long*>(sums.data()));
  must(cudaGetLastError());
  const std::vector<uint32_t> bits = words_of(wrong);
  for (size_t i = 0; i < bits.size(); ++i)
    if (bits[i] != 0) return "thread " + std::to_string(i) + ": bits " + std::to_string(bits[i]);
  const std::vector<uint32_t> found = words_of(sums);
  if (found[0] != kAll * (kAll - 1) / 2 || found[2] != kAll - 1 || found[4] != 0 || found[5] != 0) return "atomics";
  return {};
}

std::string check_shared_memory() {
  constexpr uint32_t kAll = kThreads * kBlocks;
  Buffer from = buffer_of(kThreads * sizeof(uint4)), sums = buffer_of(kAll * sizeof(uint32_t));
  Buffer garbage = buffer_of(kAll * sizeof(uint32_t));
  std::vector<uint4> host(kThreads);
  uint32_t expected = 0;
  for (uint32_t i = 0; i < kThreads; ++i) expected += host[i].x = i * i;
  must(cudaMemcpy(from.data(), host.data(), from.bytes(), cudaMemcpyHostToDevice));
  shared_sums<<<kBlocks, kThreads, kThreads * sizeof(uint4)>>>(reinterpret_cast<const uint4*>(from.data()),
                                                               reinterpret_cast<uint32_t*>(sums.data()),
                                                               reinterpret_cast<uint32_t*>(garbage.data()));
  must(cudaGetLastError());
  for (const uint32_t sum : words_of(sums))
    if (sum != expected) return "a sum of " + std::to_string(sum);
  for (const uint32_t word : words_of(garbage))
    if (word != 0xa5a5a5a5u) return "shared memory that was not garbage";
  return {};
}

std::string check_streams() {
  Buffer value = buffer_of(sizeof(uint32_t));
  auto* const word = reinterpret_cast<uint32_t*>(value.data());
  kernels::PinnedBuffer pinned;
  if (!pinned.allocate(sizeof(uint32_t), "for a test")) return "no pinned memory";
  auto* const seen = reinterpret_cast<uint32_t*>(pinned.data());
  cudaStream_t streams[2];
  for (cudaStream_t& stream : streams) must(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  cudaEvent_t added = nullptr;
  must(cudaEventCreate(&added));
  uint32_t early = 0;
  constexpr uint32_t kTimes = 2048;
  for (uint32_t i = 0; i < kTimes; ++i) {
    must(cudaMemset(word, 0, sizeof(uint32_t)));
    must(cudaDeviceSynchronize());
    *seen = 7;
    add_one<<<1, 1, 0, streams[0]>>>(word);
    must(cudaEventRecord(added, streams[0]));
    must(cudaStreamWaitEvent(streams[1], added));
    must(cudaMemcpyAsync(seen, word, sizeof(uint32_t), cudaMemcpyDeviceToHost, streams[1]));
    early += *seen == 7 ? 1 : 0;
    must(cudaStreamSynchronize(streams[1]));
    if (*seen != 1) return "a copy that did not wait for the event";
  }
  for (cudaStream_t stream : streams) must(cudaStreamDestroy(stream));
  must(cudaEventDestroy(added));
  if (early == 0 || early == kTimes) return "copies that are always done, or never, before they are waited for";
  return {};
}

void make(Mistake mistake) {
  Buffer value = buffer_of(sizeof(uint32_t));
  auto* const word = reinterpret_cast<uint32_t*>(value.data());
  switch (mistake) {
    case Mistake::kEndedLane:
      ended_lane<<<1, 32>>>();
      break;
    case Mistake::kOtherCollective:
      other_collective<<<1, 32>>>(word);
      break;
    case Mistake::kForeignLane:
      foreign_lane<<<1, 32>>>(word);
      break;
    case Mistake::kNotOfMask:
      not_of_mask<<<1, 32>>>();
      break;
    case Mistake::kStuck:
      stuck<<<1, 32>>>();
      break;
    case Mistake::kCopyTooLong:
      must(cudaMemset(word, 0, sizeof(uint32_t) + 1));
      break;
    case Mistake::kOverrun:
      overrun<<<1, 1>>>(word);
      break;
    case Mistake::kSharedTooLong:
      add_one<<<1, 1, size_t{64} * 1024>>>(word);
      must(cudaGetLastError());
      break;
  }
  must(cudaDeviceSynchronize());
}

}  // namespace scree::emulator
