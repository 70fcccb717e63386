#include "tools/gltf/box.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace scree::convert {

Box empty_box() {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  return {{kInf, kInf, kInf}, {-kInf, -kInf, -kInf}};
}

namespace {

/// Grows `box` by as many of the vertices as possible, four at a time. Returns the number of floats it has used.
size_t grow_by_fours(Box& box, std::span<const float> positions) {
  using Floats4 = float __attribute__((vector_size(16)));
  if (positions.size() < 12) return 0;
  Floats4 lo[3], hi[3];  // every element has an axis of its own
  std::memcpy(lo, positions.data(), sizeof lo);
  std::memcpy(hi, positions.data(), sizeof hi);
  size_t i = 12;
  for (; i + 12 <= positions.size(); i += 12) {
    for (size_t k = 0; k < 3; ++k) {
      Floats4 four;
      std::memcpy(&four, &positions[i + 4 * k], sizeof four);
      lo[k] = four < lo[k] ? four : lo[k];
      hi[k] = four > hi[k] ? four : hi[k];
    }
  }
  for (size_t k = 0; k < 12; ++k) {
    box.lo[k % 3] = std::min(box.lo[k % 3], lo[k / 4][k % 4]);
    box.hi[k % 3] = std::max(box.hi[k % 3], hi[k / 4][k % 4]);
  }
  return i;
}

}  // namespace

Box box_of(std::span<const float> positions) {
  Box box = empty_box();
  for (size_t i = grow_by_fours(box, positions); i < positions.size(); ++i) {
    box.lo[i % 3] = std::min(box.lo[i % 3], positions[i]);
    box.hi[i % 3] = std::max(box.hi[i % 3], positions[i]);
  }
  for (size_t axis = 0; axis < 3; ++axis) {
    if (box.lo[axis] != 0 && box.hi[axis] != 0) continue;
    size_t first = axis;  // 0 and -0 are equal; the first one counts
    while (positions[first] != 0) first += 3;
    if (box.lo[axis] == 0) box.lo[axis] = positions[first];
    if (box.hi[axis] == 0) box.hi[axis] = positions[first];
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
