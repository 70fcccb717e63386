// convert --max-error-pixels: the bound in pixels is kept with as few bits as possible.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tools/compare/geometry.h"
#include "tools/convert/plan/pixel_bound.h"

using namespace scree;
using namespace scree::tests;
using convert::PixelBound;

namespace {

using Vector = std::array<double, 3>;

/// The position in pixels of a point in the eye's coordinates (z along the view).
std::array<double, 2> drawn(const PixelBound& bound, const Vector& p) {
  const double focal = bound.height / (2 * std::tan(bound.fov_degrees * std::numbers::pi / 360));
  return {focal * p[0] / p[2], focal * p[1] / p[2]};
}

double moved(const PixelBound& bound, const Vector& from, const Vector& to) {
  const auto a = drawn(bound, from), b = drawn(bound, to);
  return std::hypot(b[0] - a[0], b[1] - a[1]);
}

/// The corner of the picture at the bound's distance.
Vector corner(const PixelBound& bound) {
  const double half = std::tan(bound.fov_degrees * std::numbers::pi / 360);
  return {bound.distance * half * bound.width / bound.height, bound.distance * half, bound.distance};
}

/// Three meshes: a plain one, one under a node that scales it by 100, and one of single floats far from the origin.
void make_textured_scene(const std::string& path) {
  tests::ModelMaker maker(path);
  tests::GridSpec grid{.columns = 24, .rows = 24};
  maker.draw("plain", {maker.grid(grid)});
  grid.columns = 20;
  tools::GltfNode& node = maker.writer().node(maker.draw("large", {maker.grid(grid)}, {3, 0, 0}));
  node.local = {3, 0, 0, 0, 0, 0, 1, 100, 100, 100};
  grid.columns = 16;
  grid.origin = {4e6f, 0, 0};
  maker.draw("far", {maker.grid(grid)});
  maker.finish();
}

/// Checks that no error is missing or exceeds its mesh's bound, and that the table has each of the three meshes once,
/// and none that takes more bytes than as floats.
void check_bounds_and_table(const convert::ConvertOptions& options, const convert::ConvertReport& report,
                            const tests::PackedFile& file) {
  const auto source = must(convert::import_gltf(options.input, {}));
  const auto geometry = must(compare::compare_geometry(source, file.file));
  CHECK(geometry.broken.empty());
  CHECK(geometry.missing_triangles == 0);
  uint64_t counted = 0, triangles = 0;
  for (const auto& [bits, row] : report.positions.rows()) {
    counted += row.meshes;
    triangles += row.triangles;
    CHECK(row.saved >= 0);
  }
  CHECK(counted == 3);
  CHECK(triangles == report.triangles);
}

}  // namespace

TEST_CASE("pixel bound: moves within the world error stay within the pixels, and slightly larger ones do not",
          "[pixel_bound]") {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const PixelBound& bound : {PixelBound{0.5, 10, 1920, 1080, 45}, PixelBound{2, 0.5, 640, 480, 90},
                                  PixelBound{0.01, 1000, 100, 1000, 20}, PixelBound{300, 1, 1920, 1080, 120}}) {
    const double error = convert::world_error(bound);
    const Vector at = corner(bound);
    double worst = 0;
    for (int i = 0; i < 200000; ++i) {
      // A point anywhere in the picture (often in its corner), at the distance or beyond, moved in any direction.
      Vector from = at;
      if (i % 2 == 0) {
        const double further = 1 + std::abs(unit(random));
        from = {at[0] * unit(random) * further, at[1] * unit(random) * further, at[2] * further};
      }
      Vector step{unit(random), unit(random), unit(random)};
      const double length = std::hypot(step[0], step[1], step[2]);
      Vector to = from;
      for (size_t k = 0; k < 3; ++k) to[k] += error * step[k] / length;
      worst = std::max(worst, moved(bound, from, to));
    }
    CHECK(worst <= bound.pixels * (1 + 1e-12));
    CHECK(worst >= 0.6 * bound.pixels);
  }
}

TEST_CASE("pixel bound: the gain of a matrix is the worst corner's", "[pixel_bound]") {
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 200; ++i) {
    format::MatrixRecord world{};
    for (auto& row : world.rows)
      for (double& value : row) value = unit(random);
    const double gain = convert::matrix_gain(world);
    double longest = 0;
    for (int k = 0; k < 300; ++k) {
      Vector d{unit(random), unit(random), unit(random)};
      if (k < 8) d = {(k & 1) ? -1.0 : 1.0, (k & 2) ? -1.0 : 1.0, (k & 4) ? -1.0 : 1.0};
      Vector image{};
      for (size_t r = 0; r < 3; ++r)
        for (size_t c = 0; c < 3; ++c) image[r] += world.rows[r][c] * d[c];
      longest = std::max(longest, std::hypot(image[0], image[1], image[2]));
    }
    CHECK(longest <= gain * (1 + 1e-12));
    CHECK(longest >= gain * (1 - 1e-12));
  }
}

TEST_CASE("pixel bound: meshes get the bits that their instances need, and measured errors keep it", "[pixel_bound]") {
  const tests::TempFolder folder;
  make_textured_scene(folder.file("in.glb"));
  for (const double pixels : {0.01, 0.5, 4.0}) {
    for (const bool clustered : {false, true}) {
      INFO(pixels << (clustered ? " clustered" : " indexed"));
      convert::ConvertOptions options = options_of(folder);
      options.pixel_bound.pixels = pixels;
      options.pixel_bound.distance = 5;
      options.encoding = clustered ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
      const convert::ConvertReport report = must_convert(options);
      const tests::PackedFile file = tests::must_open(options.output);
      const auto meshes = file.file.meshes();
      REQUIRE(meshes.size() == 3);
      const double allowed = convert::world_error(options.pixel_bound);
      const double gains[3] = {std::sqrt(3.0), 100 * std::sqrt(3.0), std::sqrt(3.0)};
      for (size_t i = 0; i < 3; ++i) {
        INFO("mesh " << i);
        const format::MeshRecord& mesh = meshes[i];
        if (mesh.position_encoding == format::PositionEncoding::kFloat32) continue;
        const double error = allowed / gains[i];
        CHECK(mesh.max_position_error <= error * (1 + 1e-12));
        // One bit less would not suffice: the error would grow by half a step.
        const double step = std::ldexp(1.0, mesh.lattice_exponent);
        CHECK((mesh.max_position_error + step / 2 > error || mesh.max_position_error == 0));
        for (const uint8_t bits : mesh.lattice_bits) CHECK(bits <= format::kMaxPositionBits);
      }
      // The plain mesh and the one scaled by 100 differ by 6 or 7 bits.
      const int apart = int{meshes[1].lattice_bits[0]} - int{meshes[0].lattice_bits[0]};
      if (pixels >= 0.5) CHECK((apart == 6 || apart == 7));  // for smaller bounds, half an ulp counts too
      // Half an ulp at 4e6 is 0.25 units, so this mesh keeps its floats or gets the exact lattice of its floats.
      if (meshes[2].position_encoding == format::PositionEncoding::kLattice && pixels < 1)
        CHECK(meshes[2].max_position_error == 0);
      check_bounds_and_table(options, report, file);
    }
  }
}

TEST_CASE("an error that is too small for one mesh's lattice keeps the floats of this mesh alone", "[pixel_bound]") {
  const tests::TempFolder folder;
  make_textured_scene(folder.file("in.glb"));
  for (const double error : {1e-3, 1e-5, 1e-12}) {
    for (const bool clustered : {false, true}) {
      for (const uint32_t threads : {1u, 4u}) {
        INFO(error << (clustered ? " clustered" : " indexed"));
        convert::ConvertOptions options = options_of(folder);
        options.max_error = error;
        options.threads = threads;
        options.encoding = clustered ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
        const convert::ConvertReport report = must_convert(options);
        const tests::PackedFile file = tests::must_open(options.output);
        size_t floats = 0;
        const auto meshes = file.file.meshes();
        for (size_t i = 0; i < meshes.size(); ++i) {
          CHECK(meshes[i].max_position_error <= error);
          floats += meshes[i].position_encoding == format::PositionEncoding::kFloat32 ? 1 : 0;
        }
        if (error == 1e-3) CHECK(meshes[0].position_encoding == format::PositionEncoding::kLattice);
        if (error == 1e-12) CHECK(floats == 3);
        check_bounds_and_table(options, report, file);
      }
    }
  }
}

TEST_CASE("pixel bound: drawn vertices keep the bound, measured from their exact positions", "[pixel_bound]") {
  const tests::TempFolder folder;
  make_textured_scene(folder.file("in.glb"));
  convert::ConvertOptions options = options_of(folder);
  options.pixel_bound = {1, 3, 800, 600, 60};
  must_convert(options);
  const tests::PackedFile file = tests::must_open(options.output);
  const auto source = must(convert::import_gltf(options.input, {}));
  const auto geometry = must(compare::compare_geometry(source, file.file));
  // The largest distance between a stored vertex and its source, in the mesh without a scale: at most 1 pixel at 3
  // units.
  const double error = geometry.axis_error;
  CHECK(error > 0);
  Vector at = corner(options.pixel_bound), to = at;
  for (size_t k = 0; k < 3; ++k) to[k] += (k == 2 ? -1 : 1) * error;
  CHECK(moved(options.pixel_bound, at, to) <= 1);
}

TEST_CASE("pixel bound: its syntax", "[pixel_bound]") {
  const tests::TempFolder folder;
  make_textured_scene(folder.file("in.glb"));
  const auto run = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"convert", folder.file("in.glb"), "-o", folder.file("out.scree")});
    return tests::run_program(words, folder.file("log"));
  };
  const auto good = run({"--max-error-pixels", "0.5", "--at-distance", "2m"});
  INFO(good.output);
  CHECK(good.exit_code == 0);
  CHECK(good.output.find("saved") != std::string::npos);
  CHECK(run({"--max-error-pixels", "0.5"}).output.find("need each other") != std::string::npos);
  CHECK(run({"--max-error-pixels", "0", "--at-distance", "1"}).exit_code == 1);
  CHECK(run({"--max-error-pixels", "1", "--at-distance", "0"}).exit_code == 1);
  CHECK(run({"--max-error-pixels", "1", "--at-distance", "1", "--positions", "12"}).exit_code == 1);
  CHECK(run({"--max-error-pixels", "1", "--at-distance", "1", "--max-error", "1mm"}).exit_code == 1);
  CHECK(run({"--max-error-pixels", "1", "--at-distance", "1", "--at-size", "10"}).exit_code == 1);
  CHECK(run({"--max-error-pixels", "1", "--at-distance", "1", "--at-fov", "180"}).exit_code == 1);
}
