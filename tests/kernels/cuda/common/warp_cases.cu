#include "tests/kernels/cuda/common/warp_cases.h"

#include <vector>

#include "kernels/cuda/common/device_array.h"
#include "kernels/cuda/common/warp.cuh"

namespace scree::tests {
namespace {

using kernels::DeviceArray;
using kernels::kWarpLanes;

/// The value of lane i in round r: values of all sizes, with sums that overflow.
SCREE_HD uint32_t lane_value(uint32_t lane, uint32_t round) {
  return (lane * 2654435761u + round * 40503u) >> (lane + round) % 32;
}

constexpr uint32_t kRounds = 64;

/// Whether the GPU compiled for has the instructions of compute capability 8.0. Code for an older one uses shuffles in
/// both cases.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ < 800
constexpr bool kHasOne = false;
#else
constexpr bool kHasOne = true;
#endif

template <bool kAsked>
__global__ void join(uint32_t* sums, uint32_t* largest, uint32_t* bits) {
  constexpr bool kOne = kAsked && kHasOne;
  for (uint32_t round = 0; round < kRounds; ++round) {
    const uint32_t value = lane_value(threadIdx.x, round);
    const uint32_t at = round * kWarpLanes + threadIdx.x;
    sums[at] = kernels::sum_of_lanes<kOne>(value);
    largest[at] = kernels::largest_of_lanes<kOne>(value);
    bits[at] = kernels::bits_of_lanes<kOne>(value);
  }
}

constexpr uint32_t kMostPieces = 2 * kWarpLanes;

/// Stages one run after another of `pieces[r]` pieces, as stage 1 does, and copies the staged pieces to `out`.
template <bool kAsync>
__global__ void stage(const uint4* from, const uint32_t* pieces, uint32_t runs, uint4* out) {
  __shared__ uint4 stages[2][kMostPieces];
  kernels::StageCopy<kAsync> copy;
  copy.begin(stages[0], from, pieces[0]);
  copy.commit();
  for (uint32_t run = 0; run < runs; ++run) {
    if (run + 1 < runs) copy.begin(stages[(run + 1) % 2], from + (run + 1) * kMostPieces, pieces[run + 1]);
    copy.commit();
    copy.wait();
    __syncwarp();
    // Each lane reads pieces that another lane copied.
    for (uint32_t i = kWarpLanes - 1 - threadIdx.x; i < pieces[run]; i += kWarpLanes)
      out[run * kMostPieces + i] = stages[run % 2][i];
    __syncwarp();
  }
}

template <class T>
Result<std::vector<T>> read(const DeviceArray<T>& from) {
  std::vector<T> values(from.count());
  if (Result<void> done = kernels::cuda_check(
          cudaMemcpy(values.data(), from.data(), values.size() * sizeof(T), cudaMemcpyDeviceToHost), "reading");
      !done)
    return done.error();
  return values;
}

template <bool kOne>
std::string check_sums_of(const char* way) {
  DeviceArray<uint32_t> device[3];
  for (DeviceArray<uint32_t>& each : device)
    if (Result<void> done = each.allocate(kRounds * kWarpLanes, "a test"); !done) return done.error().message;
  join<kOne><<<1, kWarpLanes>>>(device[0].data(), device[1].data(), device[2].data());
  std::vector<uint32_t> host[3];
  for (int i = 0; i < 3; ++i) {
    Result<std::vector<uint32_t>> values = read(device[i]);
    if (!values) return values.error().message;
    host[i] = std::move(*values);
  }
  for (uint32_t round = 0; round < kRounds; ++round) {
    uint32_t expected[3] = {};
    for (uint32_t lane = 0; lane < kWarpLanes; ++lane) {
      const uint32_t value = lane_value(lane, round);
      expected[0] += value;
      expected[1] = value > expected[1] ? value : expected[1];
      expected[2] |= value;
    }
    for (uint32_t lane = 0; lane < kWarpLanes; ++lane)
      for (int i = 0; i < 3; ++i)
        if (host[i][round * kWarpLanes + lane] != expected[i])
          return std::string(way) + ": round " + std::to_string(round) + ", lane " + std::to_string(lane) +
                 ", result " + std::to_string(i);
  }
  return "";
}

template <bool kAsync>
std::string check_copies_of(const char* way) {
  // Runs of every length, long and short ones side by side.
  std::vector<uint32_t> pieces;
  for (uint32_t i = 1; i <= kMostPieces; ++i) {
    pieces.push_back(i);
    pieces.push_back(kMostPieces + 1 - i);
  }
  const auto runs = static_cast<uint32_t>(pieces.size());
  std::vector<uint4> from(runs * kMostPieces);
  for (uint32_t i = 0; i < from.size(); ++i) from[i] = {i, i ^ 0x5a5a5a5au, 3 * i, ~i};
  for (uint32_t count : {runs, 1u, 2u}) {
    DeviceArray<uint4> in;
    DeviceArray<uint32_t> lengths;
    DeviceArray<uint4> out;
    Result<void> done = in.fill(from, "a test");
    if (done) done = lengths.fill(pieces, "a test");
    if (done) done = out.fill(std::vector<uint4>(from.size()), "a test");
    if (!done) return done.error().message;
    stage<kAsync><<<1, kWarpLanes>>>(in.data(), lengths.data(), count, out.data());
    const Result<std::vector<uint4>> staged = read(out);
    if (!staged) return staged.error().message;
    for (uint32_t i = 0; i < from.size(); ++i) {
      const uint32_t run = i / kMostPieces;
      const uint4 expected = run < count && i % kMostPieces < pieces[run] ? from[i] : uint4{};
      const uint4& found = (*staged)[i];
      if (found.x != expected.x || found.y != expected.y || found.z != expected.z || found.w != expected.w)
        return std::string(way) + ": " + std::to_string(count) + " runs, run " + std::to_string(run) + ", piece " +
               std::to_string(i % kMostPieces);
    }
  }
  return "";
}

}  // namespace

std::string check_lane_sums() {
  const std::string wrong = check_sums_of<true>("one instruction");
  return wrong.empty() ? check_sums_of<false>("shuffles") : wrong;
}

std::string check_stage_copies() {
  const std::string wrong = check_copies_of<true>("past the registers");
  return wrong.empty() ? check_copies_of<false>("through registers") : wrong;
}

}  // namespace scree::tests
