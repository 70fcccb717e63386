// The GPUs of this machine, and which of them this program can draw on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::runtime {

struct Gpu {
  int index = 0;  // as CUDA numbers them
  std::string name;
  std::string uuid;  // "GPU-" and 32 hexadecimal digits in groups, as nvidia-smi prints it
  int major = 0;     // of its compute capability
  int minor = 0;
  uint64_t total_bytes = 0;
  uint64_t free_bytes = 0;   // list_gpus() alone fills it in
  std::string why_unusable;  // one line without advice; empty: this program draws on it

  bool is_usable() const { return why_unusable.empty(); }
};

struct GpuList {
  std::vector<Gpu> gpus;
  std::string why_none;  // if there are none: no driver, one too old, no device, a program without CUDA
  std::string driver;    // "580.159.03"; empty if the kernel's module does not give it
  int driver_cuda = 0;   // the newest CUDA that the driver runs, such as 13000; 0: no driver
  int program_cuda = 0;  // the CUDA that this program was built with; 0: none
  std::string code_for;  // the architectures that it has code for: "8.0, 9.0, PTX 9.0"
};

/// Every GPU with its memory. Makes a CUDA context on each (0.2 to 0.5 s), which stays; the current device stays too.
GpuList list_gpus();

/// Makes a GPU the calling thread's current device. `which`: an index, a UUID or the beginning of one that no other GPU
/// shares; empty: the first that this program can draw on. Errors kDevice, without advice: no driver, one too old
/// (found, needed), no device, none by that name, a compute capability below 7.5 (found, needed), no code for it in the
/// program, a CUDA call that failed.
Result<Gpu> use_gpu(std::string_view which = {});

/// As use_gpu(), for process `number` of several on this host: they take the GPUs in turn, several processes a GPU if
/// there are more processes than GPUs. Unusable GPUs are passed over.
Result<Gpu> use_gpu_in_turn(uint32_t number);

inline constexpr uint32_t kMostGpus = 16;  // that draw together
inline constexpr uint32_t kAllGpus = UINT32_MAX;

/// CUDA's numbers of GPUs that draw together: `first`, the current device, and the next usable GPUs, `count` in all;
/// kAllGpus: all of these, kMostGpus at most. Makes a context on each; the current device stays. Errors kDevice: fewer
/// can be used; a CUDA call that failed.
Result<std::vector<int>> gpus_from(int first, uint32_t count);

/// The calling thread's current device; errors as use_gpu().
Result<Gpu> current_gpu();

/// Makes a GPU that use_gpu() returned the calling thread's current device. Errors kDevice: a CUDA call that failed, a
/// program without CUDA.
Result<void> set_current_gpu(int index);

/// Restores, where it ends, the device that was the calling thread's current one, if there is one.
class KeptGpu {
 public:
  KeptGpu();
  KeptGpu(const KeptGpu&) = delete;
  KeptGpu& operator=(const KeptGpu&) = delete;
  ~KeptGpu();

 private:
  int index_ = -1;  // -1: none
};

/// Whether this machine seems to have an NVIDIA GPU, without CUDA: by its driver's device node or entry in /proc.
bool seems_to_have_gpu();

/// The program's side of the list, which needs no driver: program_cuda and code_for.
GpuList program_without_gpus();

// Parts of the above that need no GPU.

/// Whether `word` can name a GPU: an index, or "GPU-" and more characters.
bool names_gpu(std::string_view word);

/// The one of `gpus` that `which`, not empty, names. Errors kDevice: none or several; the message lists the GPUs.
Result<Gpu> find_gpu(std::span<const Gpu> gpus, std::string_view which);

/// CMAKE_CUDA_ARCHITECTURES, with commas, for people: "80-real,90" is "8.0, 9.0, PTX 9.0".
std::string architecture_names(std::string_view cmake_names);

/// The text of a UUID, as Gpu::uuid has it.
std::string uuid_name(std::span<const std::byte, 16> uuid);

/// 13010 is "13.1".
std::string cuda_version_name(int version);

}  // namespace scree::runtime
