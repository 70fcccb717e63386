// Whether tests that need a GPU can run here.
#pragma once

#include <cstdint>
#include <string>

namespace scree::tests {

/// Whether a GPU can be used. If not, prints the reason with WARN; it has to be the device's error.
bool has_gpu();

/// The least device memory of a streamed scene in bytes, read from the message that refuses less.
uint64_t least_device_memory(const std::string& refusal);

/// While an object exists, the GPUs of its list, such as "9.0,9.0", are emulated. It does not change real GPUs.
class EmulatedGpus {
 public:
  explicit EmulatedGpus(const char* list);
  EmulatedGpus(const EmulatedGpus&) = delete;
  EmulatedGpus& operator=(const EmulatedGpus&) = delete;
  ~EmulatedGpus();
};

/// Whether `count` GPUs can draw together. If not, prints the reason with WARN.
bool has_gpus(uint32_t count);

/// Whether the GPU is emulated (tests/emulator): thousands of times slower, so tests draw less on it.
#if defined(SCREE_EMULATED_CUDA)
inline constexpr bool kEmulatesGpu = true;
#else
inline constexpr bool kEmulatesGpu = false;
#endif

}  // namespace scree::tests
