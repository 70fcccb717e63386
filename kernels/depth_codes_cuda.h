// A level of the depth pyramid, for a host that asks what is hidden.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "format/result.h"

namespace scree::kernels {

/// The level that find_depth_codes() makes: a code for 8 x 8 samples.
inline constexpr uint32_t kDepthCodesLevel = 3;

/// The farthest depth code of every square of that level (depth_pyramid.h), row by row, from `samples` of width x
/// height; all in device memory, queued on `stream`. Errors kDevice.
Result<void> find_depth_codes(const uint64_t* samples, uint32_t width, uint32_t height, uint32_t* codes,
                              cudaStream_t stream);

}  // namespace scree::kernels
