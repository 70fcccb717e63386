// Boxes of points.
#pragma once

#include <array>
#include <span>

namespace scree::convert {

/// The smallest and the largest coordinates of a list of points, 3 floats each; {+inf, -inf} if there are none.
struct Box {
  std::array<float, 3> lo{};
  std::array<float, 3> hi{};
};
Box empty_box();
Box box_of(std::span<const float> positions);  // finite; 0 and -0 are equal, and the first one counts
void grow(Box& box, const Box& other);
/// Whether all of `box` lies in `outer`.
bool inside(const Box& box, const Box& outer);
double diagonal_of(const Box& box);

}  // namespace scree::convert
