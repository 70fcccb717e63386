#include "tools/common/options/backend.h"

#include <charconv>
#include <cstdio>
#include <system_error>

#include "tools/common/options/options.h"

namespace scree::tools {

Result<BackendOptions> parse_backend(const std::string& backend, const std::string& device, const std::string& gpus) {
  BackendOptions options{.device = device};
  SCREE_TRY(
      parse_choice(backend, "--backend", options.choice,
                   {{"auto", BackendChoice::kAuto}, {"cpu", BackendChoice::kCpu}, {"cuda", BackendChoice::kCuda}}));
  const auto [last, error] = std::from_chars(gpus.data(), gpus.data() + gpus.size(), options.gpus);
  if (gpus == "all")
    options.gpus = runtime::kAllGpus;
  else if (error != std::errc() || last != gpus.data() + gpus.size() || options.gpus < 1 ||
           options.gpus > runtime::kMostGpus)
    return Error{ErrorCode::kUsage, "--gpus: '" + gpus + "' is neither a number from 1 to " +
                                        std::to_string(runtime::kMostGpus) + " nor all"};
  if (options.gpus != 1) {
    if (options.choice == BackendChoice::kCpu)
      return Error{ErrorCode::kUsage, "--gpus and --backend cpu exclude each other"};
    options.choice = BackendChoice::kCuda;
  }
  if (device.empty()) return options;
  if (!runtime::names_gpu(device))
    return Error{ErrorCode::kUsage,
                 "--device: '" + device + "' is neither the index of a GPU nor its UUID, GPU-... (see scree devices)"};
  if (options.choice == BackendChoice::kCpu)
    return Error{ErrorCode::kUsage, "--device and --backend cpu exclude each other"};
  options.choice = BackendChoice::kCuda;
  return options;
}

Result<std::optional<runtime::Gpu>> choose_gpu(const char* command, const BackendOptions& options, bool quiet) {
  if (options.choice == BackendChoice::kCpu) return std::optional<runtime::Gpu>();
  Result<runtime::Gpu> gpu = runtime::use_gpu(options.device);
  if (gpu) return std::optional<runtime::Gpu>(std::move(*gpu));
  if (options.choice == BackendChoice::kCuda) return gpu.error();
  const bool has_cuda = runtime::program_without_gpus().program_cuda != 0;
  if (!quiet && (has_cuda || runtime::seems_to_have_gpu())) warn_of_cpu(command, gpu.error().message);
  return std::optional<runtime::Gpu>();
}

std::string gpu_of_rank(const BackendOptions& options, uint32_t rank_on_host) {
  const bool chooses = options.device.empty() && options.choice != BackendChoice::kCpu && rank_on_host > 0 &&
                       runtime::seems_to_have_gpu();
  if (!chooses) return options.device;
  const Result<runtime::Gpu> gpu = runtime::use_gpu_in_turn(rank_on_host);
  return gpu ? std::to_string(gpu->index) : options.device;
}

void warn_of_cpu(const char* command, const std::string& reason) {
  std::fprintf(stderr, "scree %s: warning: the CPU draws: %s\n", command, reason.c_str());
}

Error with_cpu_advice(Error error) {
  if (error.code == ErrorCode::kDevice && error.message.find("--backend cpu") == std::string::npos)
    error.message += "; --backend cpu draws without a GPU";
  return error;
}

std::string name_of_cpu(uint32_t threads) {
  return "the CPU, " + std::to_string(threads) + (threads == 1 ? " thread" : " threads");
}

std::string name_of(const runtime::Gpu& gpu, uint32_t count) {
  const std::string name = "cuda:" + std::to_string(gpu.index) + " (" + gpu.name + ")";
  return count == 1 ? name : std::to_string(count) + " GPUs, the first " + name;
}

}  // namespace scree::tools
