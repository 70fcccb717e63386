// Whether what needs a GPU can be tested here.
#pragma once

namespace scree::tests {

/// Says with WARN why where it cannot; that has to be the device's error.
bool has_gpu();

/// Whether it is the emulated one (tests/emulator): thousands of times slower, so that tests draw less on it.
#if defined(SCREE_EMULATED_CUDA)
inline constexpr bool kEmulatesGpu = true;
#else
inline constexpr bool kEmulatesGpu = false;
#endif

}  // namespace scree::tests
