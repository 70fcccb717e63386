// Whether what needs a GPU can be tested here.
#pragma once

#include <cstdint>
#include <string>

namespace scree::tests {

/// Says with WARN why where it cannot; that has to be the device's error.
bool has_gpu();

/// The bytes of device memory that a streamed scene takes at least, from the message that refuses it fewer.
uint64_t least_device_memory(const std::string& refusal);

/// Whether it is the emulated one (tests/emulator): thousands of times slower, so that tests draw less on it.
#if defined(SCREE_EMULATED_CUDA)
inline constexpr bool kEmulatesGpu = true;
#else
inline constexpr bool kEmulatesGpu = false;
#endif

}  // namespace scree::tests
