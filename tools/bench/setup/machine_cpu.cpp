#include "commit.h"
#include "tools/bench/setup/machine.h"

#include <fstream>
#include <string>

namespace scree::bench {

Machine cpu_machine() {
  Machine machine;
  machine.commit = SCREE_COMMIT;
  machine.gpu = "unknown processor";
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);) {
    const size_t colon = line.find(": ");
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    machine.gpu = line.substr(colon + 2);
    break;
  }
  return machine;
}

}  // namespace scree::bench
