// Scenes that break rasterisers, drawn on the CPU by every path and compared with the double-precision reference of
// tools/compare. tests/kernels/cuda/frame/test_cuda_scenes.cpp draws the same scenes on the GPU. Results:
// docs/results/hard_cases.md.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// A scene, with the soups that its meshes were made from, which the reference draws.
struct HardCase {
  SceneBuilder builder;
  std::vector<Soup> soups;          // by mesh
  std::vector<Encoding> encodings;  // likewise
  std::vector<kernels::View> views;

  /// Adds a mesh and returns its number.
  uint32_t mesh(Soup soup, const Encoding& encoding);
  /// As above, with one instance without a transform.
  void draw_once(Soup soup, const Encoding& encoding);
  /// Encoding with a double-sided material.
  Encoding both_sides(Encoding encoding = {});
};

/// Comparison of a case's pictures with the reference, summed over all views.
struct Figures {
  uint64_t pixels = 0;
  uint64_t covered = 0;         // by scree
  uint64_t reference = 0;       // by the reference
  uint64_t background = 0;      // covered by one and not by the other
  uint64_t other_triangle = 0;  // covered by both, by triangles that do not coincide there
  double depth_error = 0;       // largest, relative, where the triangle is the same

  std::string text() const;
};

/// Draws all views with one thread, with two threads and queues that must grow, and with both instruction sets.
/// Requires equal pictures and compares them with the reference.
Figures judge(HardCase& hard);

/// How often triangles cover pixels, counting each triangle exactly, regardless of depth.
struct CoverCount {
  uint64_t covered = 0;  // pixels that any triangle covers
  uint64_t twice = 0;    // pixels that more than one covers
  std::vector<bool> is_covered, is_twice;
};

/// A function that draws a builder's scene. If empty: the CPU with two threads.
using Draws =
    std::function<std::vector<uint64_t>(const SceneBuilder&, const kernels::SceneView&, const kernels::View&)>;

/// Draws the scene twice for each bit of the triangles' numbers: the triangles with the bit, and those without it. Two
/// triangles differ in some bit, so a pixel that both cover is covered in both pictures of that bit. Indexed chunks
/// only.
CoverCount count_covers(SceneBuilder& builder, const kernels::View& view, const Draws& draws = {});

/// Checks a closed convex mesh: its front faces cover each pixel of its picture once, and its back faces cover the same
/// pixels once. Differences near the outline, where snapping folds triangles over, are noted.
void check_closed(const std::string& name, const Soup& soup, const kernels::View& view, double disc_pixels,
                  const Draws& draws = {});
/// The view of a sphere() of radius 1, which is side / 2.2 pixels large.
kernels::View sphere_view(uint32_t side);

/// Records a figure of a case: in the message of a failing check, and as a row in the file that the environment
/// variable SCREE_HARD_CASES names, if it is set.
void note(const std::string& what, const std::string& figure);

/// Cases that are drawn on both backends, by name.
struct NamedCase {
  const char* name;
  std::function<HardCase()> make;
};
const std::vector<NamedCase>& hard_cases();

/// The case with this name.
HardCase make_hard_case(const std::string& name);

/// The case with clustered chunks, or with the clusters' triangles in indexed chunks. Float32 positions are moved to a
/// lattice of 20 bits per axis, so the picture differs from the case's own.
HardCase in_clusters(const HardCase& hard, Clusters clusters);

}  // namespace scree::tests
