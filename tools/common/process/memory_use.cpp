#include "tools/common/process/memory_use.h"

#include <malloc.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <string_view>

namespace scree::tools {

// getrusage() is not used, because its peak includes the memory of the parent process at the start.
MemoryUse memory_use() {
  MemoryUse use;
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    char name[32] = {};
    unsigned long long kibibytes = 0;
    if (std::sscanf(line.c_str(), "%31[A-Za-z]: %llu kB", name, &kibibytes) != 2) continue;
    const std::string_view key = name;
    const uint64_t bytes = uint64_t{kibibytes} * 1024;
    if (key == "VmHWM") use.peak = bytes;
    if (key == "RssAnon" || key == "RssShmem") use.anonymous += bytes;
    if (key == "RssFile") use.file = bytes;
  }
  return use;
}

uint64_t peak_anonymous(const MemoryUse& before) {
  const MemoryUse now = memory_use();
  return std::max(now.anonymous, now.peak - std::min(now.peak, before.file));
}

void reset_peak() {
  std::ofstream("/proc/self/clear_refs") << 5;
}

uint64_t available_memory() {
  std::ifstream info("/proc/meminfo");
  for (std::string line; std::getline(info, line);) {
    unsigned long long kibibytes = 0;
    if (std::sscanf(line.c_str(), "MemAvailable: %llu kB", &kibibytes) == 1) return uint64_t{kibibytes} * 1024;
  }
  return 0;
}

void trim_heap() {
  malloc_trim(0);
}

}  // namespace scree::tools
