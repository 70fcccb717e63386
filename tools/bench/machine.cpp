#include "tools/bench/machine.h"

#include <fstream>
#include <string>

#include "commit.h"

namespace scree::bench {

Machine gpu_machine(const runtime::Gpu& gpu) {
  Machine machine{SCREE_COMMIT, gpu.name, {}};
  std::ifstream in("/sys/module/nvidia/version");  // "580.159.03"
  if (in >> machine.driver) return machine;
  const runtime::GpuList list = runtime::list_gpus();
  machine.driver = list.driver.empty() ? "CUDA " + runtime::cuda_version_name(list.driver_cuda) : list.driver;
  return machine;
}

Machine cpu_machine() {
  Machine machine{SCREE_COMMIT, "unknown processor", {}};
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(": ");
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    machine.device = line.substr(colon + 2);
    break;
  }
  return machine;
}

}  // namespace scree::bench
