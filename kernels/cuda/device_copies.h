// Many copies within a GPU's memory, by a kernel: its copy engines take half a microsecond for each, and four times as
// long for the bytes.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "format/result.h"

namespace scree::kernels {

/// Both on multiples of 16 bytes; `bytes` is rounded up to one.
struct DeviceCopy {
  const std::byte* from;
  std::byte* to;
  uint64_t bytes;
};

/// Queues them on `stream`, in no order: none may write what another reads or writes. Errors kDevice, with `what`.
Result<void> copy_on_device(std::span<const DeviceCopy> copies, cudaStream_t stream, const char* what);

}  // namespace scree::kernels
