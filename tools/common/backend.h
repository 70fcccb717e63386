// What draws: the words of --backend and --device, and what they come to on this machine.
#pragma once

#include <optional>
#include <string>

#include "format/result.h"
#include "runtime/draw/device_list.h"

namespace scree::tools {

enum class BackendChoice { kAuto, kCpu, kCuda };

struct BackendOptions {
  BackendChoice choice = BackendChoice::kAuto;
  std::string device;  // --device; empty: the first GPU that can be used
};

/// `backend`: "auto", "cpu" or "cuda"; `device`: as typed, empty where nothing was. With a device auto is cuda. Errors
/// kUsage: another word, a device that is neither an index nor a UUID, a device for the CPU.
Result<BackendOptions> parse_backend(const std::string& backend, const std::string& device);

/// Makes the GPU that is to draw the thread's current device; nothing where the CPU is to draw. Where kAuto finds no
/// usable GPU one line on stderr says why, unless `quiet`; a program without CUDA says so only where a GPU seems to be
/// there. Errors, of kCuda alone, as runtime::use_gpu().
Result<std::optional<runtime::Gpu>> choose_gpu(const char* command, const BackendOptions& options, bool quiet = false);

/// The line of a fallback: "scree render: warning: the CPU draws: no NVIDIA driver found".
void warn_of_cpu(const char* command, const std::string& reason);

/// "cuda:0 (NVIDIA H200)".
std::string name_of(const runtime::Gpu& gpu);

}  // namespace scree::tools
