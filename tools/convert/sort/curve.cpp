#include "tools/convert/sort/curve.h"

#include <cstddef>

namespace scree::convert {

Box box_of_most(const Box& all, std::vector<CurveSample>& samples) {
  if (samples.empty()) return all;
  Box most = all;
  const size_t outer = samples.size() / 64;
  for (size_t axis = 0; axis < 3; ++axis) {
    const auto at = [&](size_t place) {
      const auto nth = samples.begin() + static_cast<std::ptrdiff_t>(place);
      std::nth_element(samples.begin(), nth, samples.end(),
                       [&](const CurveSample& a, const CurveSample& b) { return a.point[axis] < b.point[axis]; });
      return double{nth->point[axis]};
    };
    const double lo = at(outer), hi = at(samples.size() - 1 - outer);
    const double wider = (hi - lo) / 16;
    most.lo[axis] = static_cast<float>(std::max(double{all.lo[axis]}, lo - wider));
    most.hi[axis] = static_cast<float>(std::min(double{all.hi[axis]}, hi + wider));
  }
  return most;
}

}  // namespace scree::convert
