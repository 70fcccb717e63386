#include "tools/gltf/box.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace scree::convert {

Box empty_box() {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  return {{kInf, kInf, kInf}, {-kInf, -kInf, -kInf}};
}

Box box_of(std::span<const float> positions) {
  Box box = empty_box();
  for (size_t i = 0; i + 2 < positions.size(); i += 3) {
    for (size_t axis = 0; axis < 3; ++axis) {
      box.lo[axis] = std::min(box.lo[axis], positions[i + axis]);
      box.hi[axis] = std::max(box.hi[axis], positions[i + axis]);
    }
  }
  return box;
}

void grow(Box& box, const Box& other) {
  for (size_t axis = 0; axis < 3; ++axis) {
    box.lo[axis] = std::min(box.lo[axis], other.lo[axis]);
    box.hi[axis] = std::max(box.hi[axis], other.hi[axis]);
  }
}

bool inside(const Box& box, const Box& outer) {
  for (size_t axis = 0; axis < 3; ++axis)
    if (box.lo[axis] < outer.lo[axis] || box.hi[axis] > outer.hi[axis]) return false;
  return true;
}

double diagonal_of(const Box& box) {
  double sum = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    const double side = static_cast<double>(box.hi[axis]) - static_cast<double>(box.lo[axis]);
    sum += side * side;
  }
  return std::sqrt(sum);
}

}  // namespace scree::convert
