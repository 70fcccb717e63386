// Reads whole accessors and primitives of an imported document. The test fails if they cannot be read.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "tests/results.h"
#include "tools/gltf/source.h"

namespace scree::tests {

inline std::vector<float> all_values(const convert::Accessor& accessor) {
  std::vector<float> out(accessor.count * accessor.components);
  must(convert::read_floats(accessor, 0, accessor.count, out));
  return out;
}

/// The same for an attribute that the primitive must have.
inline std::vector<float> all_values(const std::optional<convert::Accessor>& accessor) {
  return all_values(must(accessor));
}

inline std::vector<uint32_t> all_corners(const convert::Primitive& primitive) {
  std::vector<uint32_t> out(3 * primitive.triangle_count());
  must(convert::read_triangles(primitive, 0, primitive.triangle_count(), out));
  return out;
}

/// The accessors that a primitive has, positions first.
inline std::vector<const convert::Accessor*> accessors_of(const convert::Primitive& primitive) {
  std::vector<const convert::Accessor*> out{&primitive.positions};
  for (const auto* const accessor : {&primitive.uv, &primitive.normal, &primitive.color})
    if (*accessor) out.push_back(&**accessor);
  return out;
}

}  // namespace scree::tests
