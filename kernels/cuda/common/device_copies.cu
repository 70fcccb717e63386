#include <algorithm>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/common/device_copies.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kThreads = 256;
constexpr uint32_t kBlocks = 8;                     // per piece
constexpr uint64_t kMostBytes = uint64_t{1} << 20;  // per piece
constexpr uint32_t kMostPieces =
    (4096 - 16) / sizeof(DeviceCopy);  // per launch: the most that fits into a kernel's arguments

struct Pieces {
  uint32_t count = 0;
  DeviceCopy piece[kMostPieces];
};

/// One row of blocks per piece.
__global__ void __launch_bounds__(kThreads) copy_pieces(const __grid_constant__ Pieces pieces) {
  const DeviceCopy& piece = pieces.piece[blockIdx.y];
  const auto* const from = reinterpret_cast<const uint4*>(piece.from);
  auto* const to = reinterpret_cast<uint4*>(piece.to);
  const uint64_t count = (piece.bytes + sizeof(uint4) - 1) / sizeof(uint4);
  for (uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x; i < count; i += uint64_t{kBlocks} * kThreads)
    to[i] = from[i];
}

}  // namespace

Result<void> copy_on_device(std::span<const DeviceCopy> copies, cudaStream_t stream, const char* what) {
  Pieces pieces;
  const auto launch = [&]() -> Result<void> {
    copy_pieces<<<dim3(kBlocks, pieces.count), kThreads, 0, stream>>>(pieces);
    pieces.count = 0;
    return cuda_check(cudaGetLastError(), what);
  };
  for (const DeviceCopy& copy : copies) {
    for (uint64_t done = 0; done < copy.bytes; done += kMostBytes) {
      pieces.piece[pieces.count++] = {copy.from + done, copy.to + done, std::min(copy.bytes - done, kMostBytes)};
      if (pieces.count < kMostPieces) continue;
      SCREE_TRY(launch());
    }
  }
  return pieces.count != 0 ? launch() : Result<void>();
}

}  // namespace scree::kernels
