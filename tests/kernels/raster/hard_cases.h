// Scenes that break rasterisers, drawn on the CPU by every path there is and held against the double-precision
// reference of tools/compare; tests/kernels/cuda/test_cuda_scenes.cpp draws the same ones on the GPU.
// docs/results/hard_cases.md has what they gave.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// A scene with the soups its meshes were made of, which are what the reference draws.
struct HardCase {
  SceneBuilder builder;
  std::vector<Soup> soups;          // by mesh
  std::vector<Encoding> encodings;  // likewise
  std::vector<kernels::View> views;

  /// Adds a mesh and returns its number.
  uint32_t mesh(Soup soup, const Encoding& encoding);
  /// The same, drawn once as it is.
  void draw_once(Soup soup, const Encoding& encoding);
  /// Encoding with a material that shows both sides.
  Encoding both_sides(Encoding encoding = {});
};

/// What the pictures of a case are beside the reference's, all views together.
struct Figures {
  uint64_t pixels = 0;
  uint64_t covered = 0;         // by us
  uint64_t reference = 0;       // by the reference
  uint64_t background = 0;      // covered by one and not by the other
  uint64_t other_triangle = 0;  // covered by both, by triangles that do not coincide there
  double depth_error = 0;       // largest, relative, where the triangle is the same

  std::string text() const;
};

/// Draws all views with one thread, with two and queues that must grow, and with either instruction set, requires equal
/// pictures, and compares them with the reference.
Figures judge(HardCase& hard);

/// How often triangles cover pixels, each triangle counted: exact, whatever lies in front of what.
struct CoverCount {
  uint64_t covered = 0;  // pixels that any triangle covers
  uint64_t twice = 0;    // by more than one
  std::vector<bool> is_covered, is_twice;
};

/// What draws a builder's scene; two threads where it is empty.
using Draws =
    std::function<std::vector<uint64_t>(const SceneBuilder&, const kernels::SceneView&, const kernels::View&)>;

/// Draws the scene once for each value of each bit of the triangles' numbers: two triangles differ in a bit, so that a
/// pixel with two of them is covered by both halves of some bit. Indexed chunks only.
CoverCount count_covers(SceneBuilder& builder, const kernels::View& view, const Draws& draws = {});

/// A closed convex mesh: what faces the camera covers each pixel of its picture once, what faces away the same pixels
/// once; what the two count near the outline, where snapping folds triangles over, is noted.
void check_closed(const std::string& name, const Soup& soup, const kernels::View& view, double disc_pixels,
                  const Draws& draws = {});
/// Of a sphere() of radius 1, which has side / 2.2 pixels there.
kernels::View sphere_view(uint32_t side);

/// Notes a case's figure: in the message of a failing check, and as a row in the file that the environment variable
/// SCREE_HARD_CASES names, if any.
void note(const std::string& what, const std::string& figure);

/// Cases that are drawn on both backends, by name.
struct NamedCase {
  const char* name;
  std::function<HardCase()> make;
};
const std::vector<NamedCase>& hard_cases();

/// The case of that name.
HardCase make_hard_case(const std::string& name);

/// The same case with clustered chunks, or with their triangles in indexed ones. Float32 positions are laid on a
/// lattice of 20 bits an axis, so that it is not the case's own picture.
HardCase in_clusters(const HardCase& hard, Clusters clusters);

}  // namespace scree::tests
