// Charts as SVG, and the rows they are drawn of.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/tools/run_program.h"
#include "tests/tools/temp_folder.h"
#include "tools/bench/judge/judged_case.h"
#include "tools/bench/report/plot.h"
#include "tools/bench/report/svg_chart.h"

using namespace scree;
using namespace scree::bench;

namespace {

size_t count(const std::string& text, const std::string& part) {
  size_t found = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

/// A row of a picture with `wrong` of 1000 pixels wrong.
JudgedCase judged(const std::string& scene, const std::string& positions, const std::string& indices, uint64_t wrong) {
  JudgedCase row;
  row.scene = scene;
  row.view = "default";
  row.positions = positions;
  row.indices = indices;
  row.unique_triangles = row.drawn_triangles = 100;
  row.geometry_bytes = 800;
  row.position_error = row.position_bound = 0.5;
  row.drawing = Times{2, 1, 2, 2, 3};
  row.pixels = JudgedCase::Pixels{1000, wrong, {}, {}, {}};
  row.psnr_db = wrong == 0 ? INFINITY : 40;
  row.flip_mean = 0.25;
  return row;
}

void write_rows(const std::string& path, const std::vector<JudgedCase>& rows) {
  for (const JudgedCase& row : rows) {
    const CsvCells cells = judged_cells({"abc", "GPU, \"large\"", "1", 0}, row);
    REQUIRE(append_csv(path, csv_columns(cells), csv_values(cells)));
  }
}

Error read_error(const tests::TempFolder& folder, const std::string& text) {
  const Result<CsvTable> table = read_csv(folder.write("bad.csv", text));
  REQUIRE_FALSE(table);
  return table.error();
}

}  // namespace

TEST_CASE("chart ticks are round numbers that cover the values", "[plot]") {
  CHECK(chart_ticks(0, 10, false, 5) == std::vector<double>{0, 2, 4, 6, 8, 10});
  CHECK(chart_ticks(33.1, 46.7, false, 8) == std::vector<double>{32, 34, 36, 38, 40, 42, 44, 46, 48});
  CHECK(chart_ticks(0.0013, 7, true, 8) == std::vector<double>{0.001, 0.01, 0.1, 1, 10});
  CHECK(chart_ticks(0.3, 4, true, 8) == std::vector<double>{0.2, 0.5, 1, 2, 5});
  const std::vector<double> wide = chart_ticks(1e-20, 1, true, 8);
  CHECK(wide.size() <= 9);
  CHECK(wide.back() >= 0.01);
}

TEST_CASE("an SVG chart has its lines, markers and words, and survives any name", "[plot]") {
  Chart chart{"A & B", "", {"bits", false, {}}, {"wrong", true, {}}, {}};
  chart.series.push_back({"<one>", {{8, 10}, {16, 0.1}, {24, 0}}, 0, false});
  chart.series.push_back({"two", {{8, 5}, {16, INFINITY}, {24, 0.5}}, 1, true});
  const std::string svg = svg_chart(chart);
  CHECK(svg == svg_chart(chart));
  CHECK(svg.find("A &amp; B") != std::string::npos);
  CHECK(svg.find("&lt;one&gt;") != std::string::npos);
  CHECK(svg.find("<one>") == std::string::npos);
  CHECK(svg.find("nan") == std::string::npos);
  CHECK(svg.find("inf") == std::string::npos);
  CHECK(count(svg, "stroke-dasharray") == 2);  // the line and its place in the legend
  CHECK(count(svg, "<circle") == 4);
  CHECK(count(svg, "<rect") == 4);
  CHECK(count(svg, "fill=\"none\" stroke=\"#2f86c9\"/>") == 1);  // what the axis cannot show: 0
  CHECK(count(svg, "fill=\"none\" stroke=\"#d97a1e\"/>") == 1);  // infinity
  CHECK(svg.find("prefers-color-scheme:dark") != std::string::npos);
  const std::string empty = svg_chart({"nothing", "", {}, {}, {}});
  CHECK(empty.find("nan") == std::string::npos);
  CHECK(empty.ends_with("</svg>\n"));
}

TEST_CASE("bench --plot draws rows of --curves, a colour a scene", "[plot]") {
  const tests::TempFolder folder;
  const std::string csv = folder.file("rows.csv");
  std::vector<JudgedCase> rows;
  for (const char* scene : {"D", "ship.gltf"})
    for (const char* indices : {"packed", "clustered"})
      for (const char* positions : {"8", "16"}) rows.push_back(judged(scene, positions, indices, 20));
  rows.push_back(judged("D", "float32", "packed", 0));
  JudgedCase snapped = judged("D", "source", "", 3);
  snapped.study = Study::kSnapping;
  snapped.geometry_bytes = 0;
  snapped.drawing.reset();
  rows.push_back(snapped);
  write_rows(csv, rows);
  const Result<CsvTable> table = read_csv(csv);
  REQUIRE(table);
  CHECK(table->rows.size() == rows.size());
  CHECK(table->rows[0][1] == "GPU, \"large\"");
  const Result<std::vector<NamedChart>> charts = curve_charts(*table);
  REQUIRE(charts);
  REQUIRE(charts->size() == 8);  // of positions, and of snapping
  const Chart& wrong = (*charts)[0].chart;
  REQUIRE(wrong.series.size() == 2);
  CHECK(wrong.series[0].name == "D");
  CHECK(wrong.series[1].name == "ship");
  CHECK(wrong.series[0].points == std::vector<std::pair<double, double>>{{8, 2}, {16, 2}, {26, 0}});
  CHECK(wrong.note == "hollow: 0");
  const auto& speed = *std::find_if(charts->begin(), charts->end(), [](const auto& c) { return c.name == "speed"; });
  REQUIRE(speed.chart.series.size() == 4);
  CHECK(speed.chart.note == "GPU, \"large\"; dashed: clustered");
  CHECK(speed.chart.series[2].name.empty());
  CHECK(speed.chart.series[2].dashed);
  CHECK(speed.chart.series[2].colour == speed.chart.series[0].colour);
  const auto run = tests::run_program({"bench", "--plot", csv}, folder.file("log"));
  INFO(run.output);
  CHECK(run.exit_code == 0);
  CHECK(count(run.output, ".svg\n") == 8);
  CHECK(tests::read_whole(folder.file("curves_wrong.svg")).find("ship") != std::string::npos);
}

TEST_CASE("bench --plot says what is wrong with its file", "[plot]") {
  const tests::TempFolder folder;
  CHECK(read_error(folder, "").message.find("empty") != std::string::npos);
  CHECK(read_error(folder, "a,b\n1\n").message.find("line 2 has 1 cells, but there are 2") != std::string::npos);
  CHECK(read_error(folder, "a,b\n1,\"2\n").message.find("quoted") != std::string::npos);
  const Result<CsvTable> nothing = read_csv(folder.file("none.csv"));
  REQUIRE_FALSE(nothing);
  CHECK(nothing.error().code == ErrorCode::kFile);
  const Result<CsvTable> other = read_csv(folder.write("other.csv", "gpu,scene\nx,D\n"));
  REQUIRE(other);
  const auto charts = curve_charts(*other);
  REQUIRE_FALSE(charts);
  CHECK(charts.error().message.find("no column device") != std::string::npos);
  const std::string csv = folder.file("rows.csv");
  write_rows(csv, {judged("D", "8", "packed", 1)});
  std::string text = tests::read_whole(csv);
  Result<CsvTable> table = read_csv(folder.write("text.csv", tests::replaced(text, ",0.25,", ",much,")));
  REQUIRE(table);
  const auto bad = curve_charts(*table);
  REQUIRE_FALSE(bad);
  CHECK(bad.error().message.find("row 1: flip_mean is 'much'") != std::string::npos);
  const auto run = tests::run_program({"bench", "--plot", csv, "--scene", "D"}, folder.file("log"));
  CHECK(run.exit_code == 1);
}
