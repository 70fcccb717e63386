// Whether tests that need a GPU can run here.
#pragma once

#include <cstdint>
#include <string>

namespace scree::tests {

/// If not, prints the reason with WARN; it has to be the device's error.
bool has_gpu();

/// The least device memory that a streamed scene needs, in bytes, from the message that refuses less.
uint64_t least_device_memory(const std::string& refusal);

/// Whether the GPU is emulated (tests/emulator): thousands of times slower, so tests draw less on it.
#if defined(SCREE_EMULATED_CUDA)
inline constexpr bool kEmulatesGpu = true;
#else
inline constexpr bool kEmulatesGpu = false;
#endif

}  // namespace scree::tests
