// Many copies within a GPU's memory by one kernel. The copy engines take half a microsecond per copy, and per byte four
// times as long as this kernel.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "format/result.h"

namespace scree::kernels {

/// Both addresses are multiples of 16; `bytes` is rounded up to one.
struct DeviceCopy {
  const std::byte* from;
  std::byte* to;
  uint64_t bytes;
};

/// Queues the copies on `stream`, in any order: none may write memory that another reads or writes. Errors kDevice,
/// with `what`.
Result<void> copy_on_device(std::span<const DeviceCopy> copies, cudaStream_t stream, const char* what);

}  // namespace scree::kernels
