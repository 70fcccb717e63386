// The options --backend, --device and --gpus, and the choice of a GPU by them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "format/result.h"
#include "runtime/draw/device_list.h"

namespace scree::tools {

enum class BackendChoice { kAuto, kCpu, kCuda };

struct BackendOptions {
  BackendChoice choice = BackendChoice::kAuto;
  std::string device;  // --device; empty: the first usable GPU
  uint32_t gpus = 1;   // --gpus; runtime::kAllGpus: all
};

/// `backend`: "auto", "cpu" or "cuda". `device`: as typed, or empty; `gpus`: a number or "all". With a device or
/// several GPUs, auto means cuda. Errors kUsage: another value, a device that is neither an index nor a UUID, a device
/// or several GPUs together with the CPU.
Result<BackendOptions> parse_backend(const std::string& backend, const std::string& device,
                                     const std::string& gpus = "1");

/// Chooses the GPU to draw on and makes it the thread's current device. Returns nullopt if the CPU draws. If kAuto
/// finds no usable GPU, one line on stderr gives the reason, unless `quiet`; a program without CUDA prints it only if a
/// GPU seems to be present. Errors, only for kCuda, as runtime::use_gpu().
Result<std::optional<runtime::Gpu>> choose_gpu(const char* command, const BackendOptions& options, bool quiet = false);

/// The `device` of the rank with that number on its host, which takes the GPUs in turn with the other ranks of the host
/// (runtime::use_gpu_in_turn). If each rank has only one visible GPU, it uses that one.
std::string gpu_of_rank(const BackendOptions& options, uint32_t rank_on_host);

/// Prints the warning of a fallback: "scree render: warning: the CPU draws: no NVIDIA driver found".
void warn_of_cpu(const char* command, const std::string& reason);

/// Adds a hint at --backend cpu to an error of the device. Other errors stay unchanged.
Error with_cpu_advice(Error error);

/// "cuda:0 (NVIDIA H200)"; for several GPUs "2 GPUs, the first cuda:0 (NVIDIA H200)".
std::string name_of(const runtime::Gpu& gpu, uint32_t count = 1);

/// "the CPU, 16 threads".
std::string name_of_cpu(uint32_t threads);

}  // namespace scree::tools
