// scree compare: constructed differences with known counts, and real drawings that must be equal.
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "kernels/visbuffer.h"
#include "runtime/files/mapped_file.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/scene/camera.h"
#include "tests/models.h"
#include "tests/sanitized.h"
#include "tests/tools/compare/reference_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/packed_file.h"
#include "tests/tools/run_program.h"
#include "tools/compare/against_source.h"
#include "tools/compare/buffers.h"
#include "tools/compare/geometry.h"
#include "tools/compare/report.h"

using namespace scree;
using compare::PixelKind;
using compare::PixelReport;

namespace {

using Points = std::vector<float>;

/// Corners of a square of 8 units, counter-clockwise from the lower left.
Points square_at(float x, float y, float z = 0) {
  return {x, y, z, x + 8, y, z, x + 8, y + 8, z, x, y + 8, z};
}

Points joined(Points a, const Points& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

const std::vector<uint32_t> kOneSquare{0, 1, 2, 0, 2, 3};
const std::vector<uint32_t> kTwoSquares{0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7};

struct Part {
  Points points;
  std::vector<uint32_t> corners;
  std::array<double, 3> place{0, 0, 0};
};

/// Writes a glTF with a node and a mesh per part.
void make(const std::string& path, const std::vector<Part>& parts) {
  tests::ModelMaker maker(path);
  for (const Part& part : parts)
    maker.node("node", maker.mesh("mesh", {maker.primitive(part.points, part.corners)}), part.place);
  maker.finish();
}

/// 32 x 16 pixels of one unit each, with the origin in the middle of the picture, seen from z = 10.
kernels::View pixel_view() {
  kernels::View view = tests::pixel_view(32, 16);
  view.eye[2] = 10;
  return view;
}

struct Case {
  tests::TempFolder folder;

  /// Converts `drawn`, opens it and compares it with the glTF `source`.
  Result<PixelReport> pixels(const std::vector<Part>& drawn, const std::vector<Part>& source) {
    make(folder.file("drawn.gltf"), drawn);
    make(folder.file("source.gltf"), source);
    convert::ConvertOptions options;
    options.float32 = true;
    options.source_ids = true;
    REQUIRE(tests::pack(folder.file("drawn.gltf"), folder.file("drawn.scree"), options));
    auto report = against(folder.file("drawn.scree"), folder.file("source.gltf"), nullptr);
    if (!report) return report.error();
    return std::move(report->pixels);
  }

  /// `view`: null for the default view.
  static Result<compare::SourceReport> against(const std::string& file, const std::string& source,
                                               const kernels::View* given) {
    const auto gltf = convert::import_gltf(source, {});
    if (!gltf) return gltf.error();
    auto opened = runtime::SceneFile::open(file);
    if (!opened) return opened.error();
    const auto number = opened->find_scene("");
    if (!number) return number.error();
    const auto scene = runtime::Scene::load(std::move(*opened), *number, {true, 2});  // textures must not matter
    if (!scene) return scene.error();
    const auto model = compare::load_source_model(*gltf, scene->container(), *number);
    if (!model) return model.error();
    return compare::compare_with_source(*scene, *model, given != nullptr ? *given : pixel_view(),
                                        compare::kPixelsPerDegree, 2);
  }
};

uint64_t count(const PixelReport& report, PixelKind kind) {
  return report.counts()[static_cast<size_t>(kind)];
}

}  // namespace

TEST_CASE("a scene against its own source has no wrong pixel", "[compare]") {
  Case test;
  const std::vector<Part> parts{{square_at(-12, -4), kOneSquare, {}}, {square_at(0, 0), kOneSquare, {3, -4, 0}}};
  const auto report = must(test.pixels(parts, parts));
  CHECK(report.wrong() == 0);
  CHECK(count(report, PixelKind::kSame) == 128);
  CHECK(count(report, PixelKind::kBothBackground) == 512 - 128);
  CHECK(report.same_depth.count() == 128);
  CHECK(report.same_depth.max() <= 1e-6);
}

TEST_CASE("a square shifted by two pixels: its rims differ from the background, its diagonal from the neighbour",
          "[compare]") {
  Case test;
  const auto report = must(test.pixels({{square_at(-4, -4), kOneSquare, {}}}, {{square_at(-2, -4), kOneSquare, {}}}));
  CHECK(count(report, PixelKind::kBackground) == 2 * 2 * 8);
  // In each row two pixels lie between the two diagonals. The six columns that both squares cover have 12 of them.
  CHECK(count(report, PixelKind::kNeighbour) == 12);
  CHECK(count(report, PixelKind::kSame) == 6 * 8 - 12);
  CHECK(report.wrong() == 32 + 12);
}

TEST_CASE("a square that is a unit nearer has right pixels and wrong depths", "[compare]") {
  Case test;
  const auto report =
      must(test.pixels({{square_at(-4, -4, 0), kOneSquare, {}}}, {{square_at(-4, -4, 2), kOneSquare, {}}}));
  CHECK(report.wrong() == 0);
  CHECK(report.same_depth.max() == Approx(0.25).epsilon(1e-5));  // 10 instead of 8
  CHECK(report.same_depth.rms() == Approx(0.25).epsilon(1e-5));
}

TEST_CASE("swapped meshes count as other meshes, swapped squares of one mesh as without a common vertex", "[compare]") {
  Case test;
  const Part left{square_at(0, -4), kOneSquare, {-12, 0, 0}}, right{square_at(0, -4), kOneSquare, {4, 0, 0}};
  const auto meshes = must(test.pixels({left, right}, {right, left}));
  CHECK(count(meshes, PixelKind::kOtherMesh) == 128);
  CHECK(meshes.wrong() == 128);
  CHECK(meshes.surface_depth.count() == 128);
  CHECK(meshes.same_depth.count() == 0);
  const Points a = square_at(-12, -4), b = square_at(4, -4);
  const auto squares = must(test.pixels({{joined(a, b), kTwoSquares, {}}}, {{joined(b, a), kTwoSquares, {}}}));
  CHECK(count(squares, PixelKind::kApart) == 128);
  CHECK(squares.wrong() == 128);
}

TEST_CASE("a missing triangle counts as background, another number of triangles as another source", "[compare]") {
  Case test;
  // The source's second triangle has no area, so the file's 28 pixels of it are surplus.
  const auto report =
      must(test.pixels({{square_at(-4, -4), kOneSquare, {}}}, {{square_at(-4, -4), {0, 1, 2, 0, 3, 3}, {}}}));
  CHECK(count(report, PixelKind::kBackground) == 28);
  CHECK(count(report, PixelKind::kSame) == 36);
  CHECK(report.wrong() == 28);
  check_refusal(test.pixels({{square_at(-4, -4), {0, 1, 2}, {}}}, {{square_at(-4, -4), kOneSquare, {}}}),
                ErrorCode::kFormat, "1 triangles, but the source has 2");
  CHECK(refusal(test.pixels({{square_at(-4, -4), kOneSquare, {}}},
                            {{square_at(-4, -4), kOneSquare, {}}, {square_at(-4, -4), kOneSquare, {}}}))
            .code == ErrorCode::kFormat);
}

TEST_CASE("either of two coincident triangles is right", "[compare]") {
  Case test;
  // In the source two squares coincide, and the reference shows the first one. In the file the first one lies behind
  // the other.
  const auto report = must(test.pixels({{joined(square_at(-4, -4, -2), square_at(-4, -4)), kTwoSquares, {}}},
                                       {{joined(square_at(-4, -4), square_at(-4, -4)), kTwoSquares, {}}}));
  CHECK(report.wrong() == 0);
  CHECK(count(report, PixelKind::kCoincident) == 64);
}

TEST_CASE("two visibility buffers: kinds of pixels and depths are counted", "[compare]") {
  const tests::TempFolder folder;
  const std::string gltf = folder.file("two.gltf"), file = folder.file("two.scree");
  // Mesh 0: triangles 0 and 1 of one square, 2 and 3 of another. Mesh 1: 4 and 5.
  make(gltf, {{joined(square_at(-12, -4), square_at(4, -4)), kTwoSquares, {}}, {square_at(0, 0), kOneSquare, {}}});
  convert::ConvertOptions options;
  options.order = convert::Order::kNone;
  REQUIRE(tests::pack(gltf, file, options));
  auto opened = must(runtime::SceneFile::open(file));
  const auto scene = must(runtime::Scene::load(std::move(opened), 0, {false, 1}));

  const compare::SceneMatch match(scene);
  const uint64_t none = kernels::kBackground;
  const auto sample = [](uint64_t id, uint32_t octave = 0) { return kernels::pack_sample(1000 + (octave << 22), id); };
  const std::vector<uint64_t> a{none, none, sample(0), sample(0), sample(0), sample(0), sample(1, 1), sample(2)};
  const std::vector<uint64_t> b{none, sample(3), none, sample(0), sample(1), sample(2), sample(1), sample(5)};
  const auto known = must(compare::compare_buffers(a, b, 4, 2, &match));
  const std::vector<PixelKind> expected{PixelKind::kBothBackground, PixelKind::kBackground, PixelKind::kBackground,
                                        PixelKind::kSame,           PixelKind::kNeighbour,  PixelKind::kApart,
                                        PixelKind::kSame,           PixelKind::kOtherMesh};
  CHECK(known.kinds == expected);
  CHECK(known.wrong() == 5);
  // An octave of depth codes is a factor of two.
  CHECK(known.same_depth.max() == Approx(1.0).epsilon(1e-6));
  CHECK(known.same_depth.rms() == Approx(std::sqrt(0.5)).epsilon(1e-6));
  CHECK(known.surface_depth.count() == 5);

  const auto unknown = must(compare::compare_buffers(a, b, 4, 2, nullptr));
  CHECK(count(unknown, PixelKind::kOtherTriangle) == 3);
  CHECK(unknown.wrong() == 5);
  CHECK_FALSE(unknown.tells(PixelKind::kNeighbour));

  std::vector<uint64_t> past = a;
  past[4] = sample(6);
  check_refusal(compare::compare_buffers(past, b, 4, 2, &match),
                {ErrorCode::kRange, "pixel 0,1 of the first buffer: triangle 6, but " + file + " draws 6"});
}

TEST_CASE("geometry: the distance of a moved mesh and the angle of turned normals are measured", "[compare]") {
  const tests::TempFolder folder;
  const auto write = [&](const std::string& path, float shift, double degrees) {
    tests::ModelMaker maker(path);
    Points points = square_at(shift, -4);
    tools::GltfPrimitive primitive = maker.primitive(points, kOneSquare);
    Points normals;
    const double angle = degrees * 3.14159265358979323846 / 180;
    for (int i = 0; i < 4; ++i)
      normals.insert(normals.end(), {static_cast<float>(std::sin(angle)), 0.0f, static_cast<float>(std::cos(angle))});
    primitive.attributes.emplace_back("NORMAL", maker.floats(normals, tools::GltfType::kVec3));
    maker.node("node", maker.mesh("mesh", {primitive}));
    maker.finish();
  };
  write(folder.file("file.gltf"), 0, 0);
  write(folder.file("source.gltf"), 0.5f, 30);
  convert::ConvertOptions options;
  options.source_ids = true;
  options.normals = convert::Normals::kAlways;
  const auto packed = must(tests::pack(folder.file("file.gltf"), folder.file("file.scree"), options));

  const auto own = must(convert::import_gltf(folder.file("file.gltf"), {}));
  const auto same = must(compare::compare_geometry(own, packed.file));
  CHECK(same.stored.max() == 0);  // whole numbers lie on the lattice
  CHECK(same.stored.count() == 4);
  CHECK(same.triangles == 2);
  CHECK(same.broken.empty());
  CHECK(same.normals == 6);
  CHECK(same.normal_degrees < 0.05);
  CHECK(same.face_degrees == 0);

  const auto other = must(convert::import_gltf(folder.file("source.gltf"), {}));
  const auto moved = must(compare::compare_geometry(other, packed.file));
  for (const compare::Distances* distances : {&moved.stored, &moved.source}) {
    CHECK(distances->count() == 4);
    CHECK(distances->max() == 0.5);
    CHECK(distances->rms() == 0.5);
    CHECK(distances->relative_max() == Approx(0.5 / std::sqrt(128.0)));
    CHECK(distances->relative_rms() == Approx(0.5 / std::sqrt(128.0)));
  }
  CHECK(moved.axis_error == 0.5);
  REQUIRE(moved.broken.size() == 1);
  CHECK(moved.broken[0].error == 0.5);
  CHECK(moved.missing_triangles == 0);
  CHECK(moved.normal_degrees == Approx(30).margin(0.05));

  options.source_ids = false;
  const auto without = must(tests::pack(folder.file("file.gltf"), folder.file("bare.scree"), options));
  CHECK(refusal(compare::compare_geometry(own, without.file)).message.find("--source-ids") != std::string::npos);
}

TEST_CASE("the small models are drawn like the reference's pictures", "[compare]") {
  const tests::TempFolder folder;
  const std::string file = folder.file("model.scree");
  uint64_t compared = 0;
  for (const std::filesystem::path& path : tests::model_files(tests::kDataFolder)) {
    INFO(path.string());
    convert::ConvertOptions options;
    options.float32 = true;
    options.source_ids = true;
    options.drop_nonfinite = true;
    const auto packed = tests::pack(path.string(), file, options);
    if (!packed) continue;  // test_models.cpp lists the models that may be refused
    auto opened = must(runtime::SceneFile::open(file));
    const auto number = opened.find_scene("");
    if (!number) continue;
    const auto scene = must(runtime::Scene::load(std::move(opened), *number, {false, 2}));
    const auto view = must(runtime::make_view(scene, {.width = 320, .height = 240}));
    const auto report = must(Case::against(file, path.string(), &view));
    // Snapping to 1/256 pixel moves an edge across at most one pixel centre in 256 along it.
    const PixelReport& pixels = report.pixels;
    CHECK(pixels.wrong() <= 320 * 240 / 200);
    CHECK(pixels.same_depth.rms() < 1e-3);
    // Where the triangle is right, so is the colour. No difference may come from a texture, which the reference does
    // not draw.
    CHECK(report.pictures.differing <= pixels.wrong() + 320 * 240 / 500);
    compared += pixels.same_depth.count() > 0 ? 1 : 0;
  }
  CHECK(compared >= 6);
}

TEST_CASE("lit pictures against the source: identical pictures are reported as identical", "[compare]") {
  Case test;
  const std::vector<Part> parts{{square_at(-4, -4), kOneSquare, {}}}, shifted{{square_at(-2, -4), kOneSquare, {}}};
  make(test.folder.file("parts.gltf"), parts);
  make(test.folder.file("shifted.gltf"), shifted);
  convert::ConvertOptions options;
  options.source_ids = true;
  const std::string file = test.folder.file("parts.scree");
  REQUIRE(tests::pack(test.folder.file("parts.gltf"), file, options));
  const auto same = must(Case::against(file, test.folder.file("parts.gltf"), nullptr));
  CHECK(same.pictures.differing == 0);
  CHECK(std::isinf(same.pictures.psnr));
  CHECK(same.pictures.flip_max == 0);
  CHECK(compare::text_pictures(same.pictures, true).find("identical") != std::string::npos);
  std::string text;
  tools::JsonWriter json(text);
  json.begin_object();
  compare::json_pictures(json, same.pictures, true);
  json.end_object();
  CHECK_FALSE(json.met_non_finite());
  const nlohmann::json read = nlohmann::json::parse(text)["pictures"];
  CHECK(read["identical"] == true);
  CHECK(read["textures_left_out"] == true);
  CHECK_FALSE(read.contains("psnr_db"));

  // Two rims of 2 x 8 pixels: black against white that is seen head-on.
  const auto moved = must(Case::against(file, test.folder.file("shifted.gltf"), nullptr));
  CHECK(moved.pictures.differing == 32);
  CHECK(moved.pictures.max_levels == 255);
  CHECK(moved.pictures.psnr == Approx(10 * std::log10(512.0 / 32)));
  CHECK(moved.pictures.flip_max > 0.9);
}

TEST_CASE("masks follow the sampler's minification filter, as in the reference", "[compare][mask]") {
  // 200 texels on 80 pixels: the nearest level is level 1.
  constexpr uint32_t kSide = 200;
  std::vector<uint8_t> texels;
  for (uint32_t i = 0; i < kSide * kSide; ++i) {
    const double x = i % kSide, y = i / kSide;
    const double alpha = 128 + 60 * std::sin(0.8 * x + 0.03 * y) + 60 * std::cos(0.7 * y - 0.1 * x);
    texels.insert(texels.end(), {uint8_t{90}, uint8_t{150}, uint8_t{90}, static_cast<uint8_t>(alpha)});
  }
  const auto png = must(runtime::encode_png({kSide, kSide, 4, texels}));
  kernels::View view = pixel_view();
  view.width = 320;
  view.height = 160;
  const tests::TempFolder folder;
  std::map<uint16_t, std::vector<uint64_t>> pictures;
  for (const uint16_t filter : std::array<uint16_t, 7>{0, 9728, 9729, 9984, 9985, 9986, 9987}) {
    INFO("minFilter " << filter);
    tests::ModelMaker maker(folder.file("source.gltf"));
    tools::GltfTexture texture = maker.texture("waves", format::ImageCodec::kPng, png);
    texture.min_filter = filter;
    const tools::GltfMaterial material{.texture = maker.writer().add_texture(texture),
                                       .alpha = tools::GltfAlpha::kMask};
    tools::GltfPrimitive square = maker.primitive(square_at(-4, -4), kOneSquare);
    square.attributes.emplace_back("TEXCOORD_0", maker.floats({0, 1, 1, 1, 1, 0, 0, 0}, tools::GltfType::kVec2));
    square.material = maker.writer().add_material(material);
    maker.node("node", maker.mesh("mesh", {square}));
    maker.finish();
    convert::ConvertOptions options;
    options.source_ids = true;
    REQUIRE(tests::pack(folder.file("source.gltf"), folder.file("file.scree"), options));
    const auto report = must(Case::against(folder.file("file.scree"), folder.file("source.gltf"), &view));
    // Points on a mask are rounded to 1/256 texel.
    CHECK(report.pixels.wrong() <= 80 * 80 / 100);
    CHECK(report.pixels.same_depth.count() > 1000);
    CHECK(report.pixels.same_depth.count() < 5400);
    const runtime::Scene scene = must(runtime::Scene::open(folder.file("file.scree"), {}));
    pictures[filter].resize(size_t{320} * 160);
    REQUIRE(kernels::draw_cpu(scene.view(), view, pictures[filter], 2));
  }
  // A mask takes one level. Without a filter it is bilinear.
  CHECK((pictures[0] == pictures[9985] && pictures[0] == pictures[9987]));
  CHECK((pictures[9984] == pictures[9986]));
  const std::array<uint16_t, 4> different{0, 9728, 9729, 9984};
  for (const uint16_t a : different) {
    for (const uint16_t b : different) {
      size_t other = 0;
      for (size_t i = 0; i < pictures[a].size(); ++i) other += pictures[a][i] != pictures[b][i];
      INFO(a << " and " << b);
      CHECK((a == b || other > 200));
    }
  }
}

TEST_CASE("fewer position bits change the lit picture", "[compare][cli]") {
  const tests::TempFolder folder;
  const auto run = [&](const std::vector<std::string>& words) { return tests::must_run(words, folder.file("log")); };
  run({"synth", "A", "--scale", "0.0001", "-o", folder.file("a.gltf")});
  double psnr = 0, flip = 1;
  for (const char* positions : {"8", "12", "float32"}) {
    INFO(positions);
    run({"convert", folder.file("a.gltf"), "-o", folder.file("a.scree"), "--source-ids", "--quiet", "--force",
         "--positions", positions});
    const auto compared = run({"compare", folder.file("a.gltf"), folder.file("a.scree"), "--size", "160x120", "--json",
                               "--flip", folder.file("flip.png"), "--force"});
    const nlohmann::json pictures = nlohmann::json::parse(compared.output)["pictures"];
    CHECK(pictures["psnr_db"].get<double>() > psnr + 5);
    CHECK(pictures["flip_mean"].get<double>() < flip / 2);
    psnr = pictures["psnr_db"].get<double>();
    flip = pictures["flip_mean"].get<double>();
    // The picture of the error equals the numbers.
    const auto map = must(runtime::MappedFile::open(folder.file("flip.png")));
    const auto image = must(runtime::decode_image(map.bytes()));
    REQUIRE(image.rgba.size() == 4 * 160 * 120);
    double sum = 0;
    for (size_t i = 0; i < image.rgba.size(); i += 4) sum += image.rgba[i];
    CHECK(sum / 255 / (160 * 120) == Approx(flip).margin(0.5 / 255));
  }
}

TEST_CASE("compare prints its results as JSON", "[compare][cli]") {
  const tests::TempFolder folder;
  tests::make_model(folder.file("grid.gltf"), {});
  const auto run = [&](const std::vector<std::string>& words) { return tests::must_run(words, folder.file("log")); };
  run({"convert", folder.file("grid.gltf"), "-o", folder.file("grid.scree"), "--source-ids", "--quiet"});
  const auto compared = run({"compare", folder.file("grid.scree"), folder.file("grid.gltf"), "--size", "64x48",
                             "--json", "-o", folder.file("difference.png")});
  const nlohmann::json json = nlohmann::json::parse(compared.output);
  uint64_t pixels = 0;
  for (const char* kind : {"both_background", "same", "coincident", "background", "other_mesh", "apart", "neighbour"})
    pixels += json["pixels"][kind].get<uint64_t>();
  CHECK(pixels == 64 * 48);
  CHECK(json["pixels"]["same"].get<uint64_t>() > 500);
  CHECK(json["geometry"]["triangles"].get<uint64_t>() == 32);
  CHECK(json["geometry"]["broken_bounds"].get<uint64_t>() == 0);
  CHECK(json["geometry"]["max_axis_error"].get<double>() <= json["geometry"]["max_axis_bound"].get<double>());
  CHECK(std::filesystem::exists(folder.file("difference.png")));
}

TEST_CASE("inspect --source fails if a file is farther from its source than it states", "[compare]") {
  const tests::TempFolder folder;
  make(folder.file("file.gltf"), {{square_at(0, 0), kOneSquare, {}}, {square_at(20, 0), kOneSquare, {}}});
  make(folder.file("moved.gltf"), {{square_at(0, 0), kOneSquare, {}}, {square_at(20, 0.25f), kOneSquare, {}}});
  convert::ConvertOptions options;
  options.source_ids = true;
  REQUIRE(tests::pack(folder.file("file.gltf"), folder.file("file.scree"), options));
  const auto run = [&](const std::string& source) {
    return tests::run_program({"inspect", folder.file("file.scree"), "--source", source}, folder.file("log"));
  };
  CHECK(run(folder.file("file.gltf")).exit_code == 0);
  const auto moved = run(folder.file("moved.gltf"));
  CHECK(moved.exit_code == 3);
  INFO(moved.output);
  CHECK(moved.output.find("mesh 1: position error 0.250 against") != std::string::npos);
}

namespace {

/// Packs every available model with `widths(number)` bits per axis and compares it with its source, at least `least`
/// times in all.
template <class Widths>
void check_stated_errors(const Widths& widths, uint64_t least) {
  const std::filesystem::path models = tests::real_models("scenes");
  if (models.empty()) return;
  const tests::TempFolder folder;
  const std::string output = folder.file("model.scree");
  uint64_t checked = 0, number = 0;
  for (const std::filesystem::path& path : tests::model_files(models)) {
    const auto source = convert::import_gltf(path.string(), {});
    if (!source) continue;  // test_models.cpp lists the models that may be refused
    for (const uint32_t bits : widths(number++)) {
      INFO(path.string() << ", " << bits << " bits");
      convert::ConvertOptions options;
      options.position_bits = bits;
      options.source_ids = true;
      options.images.textures = convert::Textures::kRaw;  // indices of JPEGs would take most of the time
      const auto packed = tests::pack(path.string(), output, options);
      if (!packed) break;
      const auto report = must(compare::compare_geometry(*source, packed->file));
      CHECK(report.broken.empty());
      CHECK(report.missing_triangles == 0);
      CHECK(report.unknown_triangles == 0);
      CHECK(report.axis_error <= report.axis_bound);
      // Each distance is bounded by three coordinate errors.
      CHECK(report.stored.max() <= std::sqrt(3.0) * report.axis_error * (1 + 1e-12));
      CHECK(report.source.max() == report.stored.max());
      ++checked;
    }
  }
  INFO(checked << " pairs of a model and a width");
  CHECK(checked >= least);
}

}  // namespace

TEST_CASE("the stated position error holds for every model, with the widths in turn", "[compare][models]") {
  // Each model has one of the widths in turn. Without sanitizers it also has the narrowest and the widest.
  const auto widths = [](uint64_t number) {
    const auto in_turn = static_cast<uint32_t>(8 + number % 17);
    return tests::kIsSanitized ? std::vector<uint32_t>{in_turn} : std::vector<uint32_t>{8, in_turn, 24};
  };
  check_stated_errors(widths, tests::kIsSanitized ? 100 : 300);
}

TEST_CASE("the stated position error holds for every model and every width", "[.][models-all]") {
  const auto widths = [](uint64_t) {
    std::vector<uint32_t> all(17);
    std::iota(all.begin(), all.end(), 8u);
    return all;
  };
  check_stated_errors(widths, 3200);
}
