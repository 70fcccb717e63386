#include "runtime/scene/camera.h"

#include <algorithm>
#include <cmath>

#include "runtime/scene/scene.h"
#include "tests/runtime/load_scene.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::kernels::View;

namespace {

Result<View> view_of(const Scene& scene, const CameraOptions& options) {
  return make_view(scene, options);
}

/// Coordinates in the picture, which are from -1 to 1 inside, and the distance from the eye's plane.
Vec3 project(const View& view, const Vec3& point) {
  double x = 0, y = 0, z = 0;
  for (size_t i = 0; i < 3; ++i) {
    const double d = point[i] - view.eye[i];
    x += d * view.right[i];
    y += d * view.up[i];
    z += d * view.forward[i];
  }
  const double scale = view.orthographic ? 1 : z;
  return {x / (scale * view.half_width), y / (scale * view.half_height), z};
}

void check_orthonormal(const View& view) {
  const double* const axes[3] = {view.right, view.up, view.forward};
  for (size_t a = 0; a < 3; ++a)
    for (size_t b = 0; b < 3; ++b) {
      const double product = axes[a][0] * axes[b][0] + axes[a][1] * axes[b][1] + axes[a][2] * axes[b][2];
      CHECK(std::abs(product - (a == b ? 1 : 0)) < 1e-12);
    }
  // right x up = -forward: a right-handed frame that looks along its -z.
  CHECK(view.right[0] * view.up[1] - view.right[1] * view.up[0] == Approx(-view.forward[2]).margin(1e-12));
}

/// Two cameras: the perspective "Eye" on node 2, which is translated, rotated about y and scaled, and the orthographic
/// "Flat" on node 3.
SmallScene with_cameras() {
  SmallScene small;
  small.change = [](format::TableSet& tables) {
    tables.cameras.push_back({tables.strings.add("Eye"), format::CameraKind::kPerspective, 1.0, 0, 0.25, 0});
    tables.cameras.push_back({0, format::CameraKind::kOrthographic, 3, 4, 0, 50});
    format::NodeRecord eye = SmallScene::node(tables, "Eye node", 0, format::kNone, 0);
    eye.local[0] = 10;
    eye.local[1] = 2;
    eye.local[4] = std::sqrt(0.5);  // 90 degrees about y: -z becomes -x
    eye.local[6] = std::sqrt(0.5);
    eye.local[7] = eye.local[8] = eye.local[9] = 7;
    tables.nodes.push_back(eye);
    tables.nodes.push_back(SmallScene::node(tables, "Flat", 0, format::kNone, 1));
    tables.nodes[0].local[0] = -1;  // moves both cameras, as their parent
  };
  return small;
}

}  // namespace

TEST_CASE("a camera node gives the view, regardless of its scale", "[camera]") {
  const Scene scene = must_load(with_cameras());
  CameraOptions options{.width = 200, .height = 100};
  for (const char* name : {"Eye", "Eye node", "0"}) {
    options.camera = name;
    const View view = must(view_of(scene, options));
    check_orthonormal(view);
    CHECK_FALSE(view.orthographic);
    CHECK(view.eye[0] == Approx(9));
    CHECK(view.eye[1] == Approx(2));
    CHECK(view.half_height == Approx(std::tan(0.5)));
    CHECK(view.half_width == Approx(2 * std::tan(0.5)));
    CHECK(view.z_near == 0.25);
    const Vec3 ahead = project(view, {4, 2, 0});
    CHECK(ahead[0] == Approx(0).margin(1e-12));
    CHECK(ahead[2] == Approx(5));
    // Looking along -x with y up, -z is on the right.
    CHECK(project(view, {4, 2, -1})[0] == Approx(1 / (5 * 2 * std::tan(0.5))));
    CHECK(project(view, {4, 3, 0})[1] == Approx(1 / (5 * std::tan(0.5))));
  }
  options.fov_degrees = 90;
  CHECK(must(view_of(scene, options)).half_height == Approx(1));
}

TEST_CASE("a camera's rotation is normalised like an instance's", "[camera]") {
  // A file from another writer, in which the node's quaternion has length 3.
  SmallScene small = with_cameras();
  const auto with_units = small.change;
  small.change = [&](format::TableSet& tables) {
    with_units(tables);
    for (format::NodeRecord& node : tables.nodes)
      for (size_t i = 3; i < 7; ++i) node.local[i] *= 3;
  };
  const Scene scaled = must_load(small);
  const Scene scene = must_load(with_cameras());
  for (const char* name : {"Eye", "Flat"}) {
    const CameraOptions options{.camera = name};
    const View view = must(view_of(scaled, options)), expected = must(view_of(scene, options));
    for (size_t i = 0; i < 3; ++i) {
      CHECK(view.forward[i] == Approx(expected.forward[i]).margin(1e-12));
      CHECK(view.up[i] == Approx(expected.up[i]).margin(1e-12));
      CHECK(view.eye[i] == Approx(expected.eye[i]).margin(1e-12));
    }
  }
}

TEST_CASE("the planes of a file's camera lie close to the scene", "[camera]") {
  SmallScene small = with_cameras();
  const auto with_near = small.change;
  small.change = [&](format::TableSet& tables) {
    with_near(tables);
    tables.cameras[0].z_near = 1e-30;
    tables.cameras[1].z_far = 1e9;
    tables.nodes.back().local[2] = 20;  // in front of the scene
  };
  const Scene scene = must_load(small);
  const View flat = must(view_of(scene, {.camera = "Flat"}));
  const WorldBox box = scene.box();
  CHECK(flat.z_near > 0);
  CHECK(flat.z_near < 20 - box.max[2]);
  CHECK(flat.z_far > 20 - box.min[2]);
  CHECK(flat.z_far - flat.z_near < box.max[2] - box.min[2] + 0.1);
  const View near = must(view_of(scene, {.camera = "Eye"}));
  CHECK(near.z_near > 1e-18);
  CHECK(near.z_near < 1e-15);
}

TEST_CASE("an orthographic camera keeps its height", "[camera]") {
  const Scene scene = must_load(with_cameras());
  CameraOptions options{.camera = "Flat", .width = 300, .height = 100};
  const View view = must(view_of(scene, options));
  CHECK(view.orthographic);
  CHECK(view.half_height == 3);
  CHECK(view.half_width == 9);
  CHECK(view.forward[2] == -1);
  CHECK(view.eye[0] == -1);
  options.fov_degrees = 30;
  CHECK_FALSE(view_of(scene, options));
}

TEST_CASE("an up direction without a length or along the view is an error", "[camera]") {
  const Scene scene = must_load(SmallScene{});
  CameraOptions options{.eye = runtime::Vec3{0, 5, 0}, .target = runtime::Vec3{0, 0, 0}};
  CHECK(view_of(scene, options));
  options.up = runtime::Vec3{0, 0, 0};
  check_refusal(view_of(scene, options), {ErrorCode::kUsage, "up has the length 0"});
  options.up = runtime::Vec3{0, -2, 0};
  check_refusal(view_of(scene, options), {ErrorCode::kUsage, "up lies along the direction of view"});
}

TEST_CASE("a missing camera is an error that lists the existing ones", "[camera]") {
  const Scene scene = must_load(with_cameras());
  CameraOptions options{.camera = "7"};
  check_refusal(view_of(scene, options), {ErrorCode::kUsage, "no camera '7', expected one of 0 (Eye), 1 (Flat)"});
  options.camera = "x";
  CHECK(refusal(view_of(must_load(SmallScene{}), options)).message == "no camera 'x', but the scene has no cameras");
}

TEST_CASE("a view from an eye to a target has its up direction at the top", "[camera]") {
  const Scene scene = must_load(SmallScene{});
  CameraOptions options{.eye = Vec3{0, 0, 4}};
  View view = must(view_of(scene, options));
  check_orthonormal(view);
  CHECK(view.forward[2] == -1);  // the middle of the quad
  CHECK(view.half_height == Approx(std::tan(22.5 / 180 * 3.14159265358979)));
  CHECK(view.z_near > 0);
  CHECK(view.z_near < 0.5);

  options.eye = Vec3{1, 2, 3};
  options.target = Vec3{-4, 0, 2};
  options.up = Vec3{0, 0, 5};
  view = must(view_of(scene, options));
  check_orthonormal(view);
  CHECK(view.up[2] > 0.9);
  const Vec3 target = project(view, {-4, 0, 2});
  CHECK(target[0] == Approx(0).margin(1e-12));
  CHECK(target[1] == Approx(0).margin(1e-12));

  options = {};
  options.eye = Vec3{0, 5, 0};  // straight down
  view = must(view_of(scene, options));
  check_orthonormal(view);
  CHECK(view.up[2] == -1);

  options.up = Vec3{0, 1, 0};
  CHECK_FALSE(view_of(scene, options));
  options.up.reset();
  options.target = options.eye;
  CHECK_FALSE(view_of(scene, options));
  options = {};
  options.target = Vec3{};
  CHECK_FALSE(view_of(scene, options));
}

TEST_CASE("the near plane is tiny inside the scene's box, and larger far away", "[camera]") {
  const Scene scene = must_load(SmallScene{});
  CameraOptions options{.eye = Vec3{0.2, 0.2, 0}, .target = Vec3{0, 0, -1}};
  const View inside = must(view_of(scene, options));
  CHECK(inside.z_near < 1e-5);
  CHECK(inside.z_near > 0);
  options.eye = Vec3{0, 0, 1000};
  CHECK(must(view_of(scene, options)).z_near == Approx(10));
}

TEST_CASE("the default view shows the whole scene, tightly and in the middle", "[camera]") {
  for (const double stretch : {1.0, 40.0, 0.01}) {
    const SmallScene small{.change = [&](format::TableSet& tables) {
      tables.matrices[0].rows[0][0] = stretch;
      tables.matrices[0].rows[2][3] = 123;
      tables.matrices.push_back(SmallScene::identity());
      tables.matrices[1].rows[1][3] = 5;
      tables.nodes.push_back(SmallScene::node(tables, "Second", 0, 0, format::kNone));
      tables.instances.push_back({0, 2, 1, 0});
      tables.scenes[0].instance_count = 2;
      tables.scenes[0].triangle_count = 4;
    }};
    const Scene scene = must_load(small);
    for (const auto& up : {Vec3{0, 1, 0}, Vec3{0, 0, 1}, Vec3{1, 0, 0}}) {
      for (const uint32_t width : {100u, 400u}) {
        const View view = must(view_of(scene, {.up = up, .width = width, .height = 200}));
        check_orthonormal(view);
        double x_min = 1, x_max = -1, y_min = 1, y_max = -1, nearest = 1e9;
        for (uint64_t i = 0; i < 2; ++i) {
          for (const double x : {-1.0, 1.0}) {
            for (const double y : {-1.0, 1.0}) {
              const format::MatrixRecord& m = scene.view().matrices[scene.view().instances[i].matrix];
              const Vec3 p = project(view, {m.rows[0][0] * x + m.rows[0][3], y + m.rows[1][3], m.rows[2][3]});
              x_min = std::min(x_min, p[0]);
              x_max = std::max(x_max, p[0]);
              y_min = std::min(y_min, p[1]);
              y_max = std::max(y_max, p[1]);
              nearest = std::min(nearest, p[2]);
            }
          }
        }
        CHECK(nearest > view.z_near);
        CHECK(x_min == Approx(-x_max).margin(1e-3));
        CHECK(y_min == Approx(-y_max).margin(1e-3));
        CHECK(std::max(x_max, y_max) == Approx(0.94).margin(1e-3));
      }
    }
  }
}

TEST_CASE("an empty scene has a view", "[camera]") {
  const Scene scene = must_load({.change = [](format::TableSet& tables) {
    tables.instances.clear();
    tables.scenes[0].instance_count = tables.scenes[0].triangle_count = 0;
  }});
  const View view = must(view_of(scene, {}));
  check_orthonormal(view);
  CHECK(view.z_near > 0);
  CHECK(view_of(scene, {.eye = Vec3{1, 1, 1}}));
}
