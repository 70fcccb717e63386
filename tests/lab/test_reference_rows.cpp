// scree-lab --reference and --curves: the rows for small pictures of real scenes.
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "tests/csv.h"
#include "tests/lab/refused.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/run_program.h"

using namespace scree;
using namespace scree::lab;
using tests::refused;

namespace {

using Row = tests::CsvRow;

double number(const Row& row, const std::string& column) {
  const std::string& text = row.at(column);
  INFO(column << " " << text);
  REQUIRE_FALSE(text.empty());
  return text == "inf" ? INFINITY : std::stod(text);
}

LabWords reference_words() {
  LabWords words;
  words.reference = true;
  return words;
}

}  // namespace

TEST_CASE("lab --reference: wider positions are nearer to the source", "[lab]") {
  const tests::TempFolder folder;
  const std::string csv = folder.file("rows.csv");
  const auto run =
      tests::must_run({"--reference", "--scene", "D", "--view", "inside", "--size", "160x90", "--frames", "1",
                       "--warmup", "0", "--positions", "10,16,float32", "--indices", "packed,clustered", "--csv", csv},
                      folder.file("log"), tests::kLabProgram);
  CHECK(run.output.find("float32, packed") != std::string::npos);
  const std::vector<Row> rows = tests::read_csv(csv);
  REQUIRE(rows.size() == 5);
  std::map<std::string, Row> named;
  for (const Row& row : rows) named[row.at("positions") + row.at("indices")] = row;
  for (const Row& row : rows) {
    CHECK(row.at("study") == "positions");
    CHECK(number(row, "position_error") <= number(row, "position_bound"));
    CHECK(number(row, "covered_pixels") == 160 * 90);
    CHECK(number(row, "draw_ms") > 0);
    CHECK(number(row, "wrong_background") + number(row, "wrong_other_mesh") + number(row, "wrong_apart") +
              number(row, "wrong_neighbour") ==
          number(row, "wrong_pixels"));
  }
  CHECK(number(named["float32packed"], "position_error") == 0);
  CHECK(number(named["float32packed"], "wrong_pixels") <= 0.005 * 160 * 90);  // snapping to 1/256 pixel: 0.1% and less
  CHECK(number(named["float32packed"], "same_depth_error_rms") < 1e-4);       // walls seen at a grazing angle
  for (const char* indices : {"packed", "clustered"}) {
    const Row &coarse = named[std::string("10") + indices], &fine = named[std::string("16") + indices];
    CHECK(number(coarse, "wrong_pixels") > 2 * number(fine, "wrong_pixels"));
    CHECK(number(coarse, "psnr_db") < number(fine, "psnr_db"));
    CHECK(number(coarse, "flip_mean") > number(fine, "flip_mean"));
    CHECK(number(coarse, "bytes_per_triangle") < number(fine, "bytes_per_triangle"));
  }
  // The clusters have the same vertices, so no pixel differs.
  for (const char* column : {"wrong_pixels", "psnr_db", "depth_error_rms", "position_error"})
    CHECK(named["16packed"].at(column) == named["16clustered"].at(column));
}

TEST_CASE("lab --curves: snapping, depth codes and samples of a model", "[lab]") {
  const tests::TempFolder folder;
  const std::string csv = folder.file("rows.csv");
  tests::must_run({"--curves", tests::data_path("two_instances.gltf").string(), "--size", "96x64", "--frames", "1",
                   "--warmup", "0", "--csv", csv},
                  folder.file("log"), tests::kLabProgram);
  std::map<std::string, std::vector<Row>> studies;
  for (const Row& row : tests::read_csv(csv)) studies[row.at("study")].push_back(row);
  REQUIRE(studies["positions"].size() == 18);
  double before = INFINITY;
  for (const Row& row : studies["positions"]) {
    CHECK(number(row, "position_error") <= number(row, "position_bound"));
    CHECK(number(row, "position_bound") <= before);
    before = number(row, "position_bound");
  }
  REQUIRE(studies["samples"].size() == 6);
  for (size_t i = 0; i < 6; ++i) {
    CHECK(studies["samples"][i].at("samples_per_side") == std::to_string(1 << (i % 3)));
    if (i % 3 != 0) CHECK(number(studies["samples"][i], "psnr_db") > number(studies["samples"][i - 1], "psnr_db") + 2);
  }
  REQUIRE(studies["snapping"].size() == 3);
  for (const Row& row : studies["snapping"]) {
    CHECK(row.at("device") == "reference");
    CHECK(row.at("draw_ms").empty());
  }
  CHECK(number(studies["snapping"][0], "wrong_pixels") >= number(studies["snapping"][1], "wrong_pixels"));
  CHECK(number(studies["snapping"][1], "wrong_pixels") >= number(studies["snapping"][2], "wrong_pixels"));
  REQUIRE(studies["depth"].size() == 2);
  CHECK(number(studies["depth"][0], "depth_error_max") <= 0x1p-22);
  CHECK(number(studies["depth"][1], "depth_error_max") <= 0x1p-24 * 1.001);
}

TEST_CASE("lab --reference: invalid options are refused", "[lab]") {
  LabWords words = reference_words();
  words.sweep = true;
  CHECK(refused(words).find("--sweep") != std::string::npos);
  words = reference_words();
  words.samples = "4";
  CHECK(refused(words).find("--samples") != std::string::npos);
  words = reference_words();
  words.indices = "32";
  CHECK(refused(words).find("packed or clustered") != std::string::npos);
  words = reference_words();
  words.curves = true;
  words.size = "3840x2160";
  CHECK(refused(words).find("2048") != std::string::npos);
  words = {};
  words.files = {"a.scree", "b.scree"};
  CHECK(refused(words).find("--reference") != std::string::npos);
  words.reference = true;
  words.scenes = "A";
  const LabOptions both = must(parse_options(words));
  CHECK(both.files.size() == 2);
  CHECK(both.scenes == std::vector<std::string>{"A"});
  CHECK(must(parse_options(reference_words())).scenes == std::vector<std::string>{"D"});
  words = {};
  words.curves = true;
  const LabOptions curves = must(parse_options(words));
  CHECK(curves.reference);
  CHECK(curves.encodings.size() == 18);
}

TEST_CASE("lab --reference: a missing source is an error with its name", "[lab]") {
  const tests::TempFolder folder;
  const auto run = tests::run_program({"--reference", folder.file("none.glb")}, folder.file("log"), tests::kLabProgram);
  CHECK(run.exit_code == 2);
  CHECK(run.output.find("none.glb") != std::string::npos);
}
