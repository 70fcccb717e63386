// The box of points, which handles several points at a time.
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/catch.h"
#include "tools/gltf/box.h"

using namespace scree::convert;

TEST_CASE("the box of points equals that of a loop over them, including the sign of zeros", "[gltf]") {
  std::mt19937 random(1);
  const float values[] = {0.0f, -0.0f, 1.5f, -2.0f, std::numeric_limits<float>::denorm_min()};
  for (int round = 0; round < 20000; ++round) {
    std::vector<float> points(3 * (random() % 14));
    const uint32_t kinds = 1 + static_cast<uint32_t>(random() % 5);  // few kinds give boxes that end at a zero
    for (float& value : points) value = values[random() % kinds];
    Box expected = empty_box();
    for (size_t i = 0; i < points.size(); ++i) {
      expected.lo[i % 3] = std::min(expected.lo[i % 3], points[i]);
      expected.hi[i % 3] = std::max(expected.hi[i % 3], points[i]);
    }
    const Box box = box_of(points);
    REQUIRE(box.lo == expected.lo);
    REQUIRE(box.hi == expected.hi);
    for (size_t axis = 0; axis < 3; ++axis) {
      REQUIRE(std::signbit(box.lo[axis]) == std::signbit(expected.lo[axis]));
      REQUIRE(std::signbit(box.hi[axis]) == std::signbit(expected.hi[axis]));
    }
  }
}
