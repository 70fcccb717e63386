#include "tools/bench/times.h"

#include <algorithm>
#include <cassert>
#include <numeric>
#include <vector>

namespace scree::bench {

Times summarize(std::span<const float> ms) {
  assert(!ms.empty());
  std::vector<double> sorted(ms.begin(), ms.end());
  std::sort(sorted.begin(), sorted.end());
  const size_t middle = sorted.size() / 2;
  Times times;
  times.median = sorted.size() % 2 == 1 ? sorted[middle] : 0.5 * (sorted[middle - 1] + sorted[middle]);
  times.minimum = sorted.front();
  times.worst = sorted.back();
  times.spread = times.worst - times.minimum;
  times.mean = std::accumulate(sorted.begin(), sorted.end(), 0.0) / static_cast<double>(sorted.size());
  return times;
}

}  // namespace scree::bench
