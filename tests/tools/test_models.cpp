// Converts every real model, opens and decodes it, and compares it with its source within the stated error.
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/sanitized.h"
#include "tests/tools/compare/source_compare.h"
#include "tools/convert/convert.h"

using namespace scree;
namespace fs = std::filesystem;

TEST_CASE("the small models are converted within the stated error", "[models]") {
  const tests::TempFolder folder;
  const std::string output = folder.file("model.scree");
  uint64_t converted = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(tests::kDataFolder)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".gltf" && extension != ".glb") continue;
    INFO(entry.path().string());
    for (int variant = 0; variant < 6; ++variant) {
      convert::ConvertOptions options;
      options.input = entry.path().string();
      options.output = output;
      options.source_ids = true;
      options.drop_nonfinite = true;
      options.normals = variant % 2 == 1 ? convert::Normals::kAlways : convert::Normals::kAuto;
      options.order = variant == 2 ? convert::Order::kNone : convert::Order::kFifo;
      options.float32 = variant == 3;
      options.chunk_triangles = variant == 4 ? 0 : variant == 5 ? 3 : format::kMaxChunkTriangles;
      options.zstd_level = variant == 5 ? 3 : 0;
      const Result<convert::ConvertReport> report = convert::convert(options);
      if (!report) {
        INFO(report.error().message);
        CHECK(report.error().code == ErrorCode::kUnsupported);
        break;
      }
      const tests::Comparison comparison = tests::compare_with_source(options.input, output);
      CHECK(comparison.difference == "");
      CHECK(comparison.triangles == report->triangles);
      CHECK(comparison.position_error == report->position_error);
      ++converted;
    }
  }
  CHECK(converted >= 6);
}

TEST_CASE("every model is converted within the stated error", "[models]") {
  const std::vector<fs::path> files = tests::model_files(tests::real_models("scenes"));
  if (files.empty()) return;
  const tests::TempFolder folder;
  const std::string output = folder.file("model.scree");
  uint64_t converted = 0, triangles = 0, number = 0;
  std::map<std::string, uint64_t> refused;
  for (const fs::path& path : files) {
    if (tests::kIsSanitized && number++ % 2 != 0) continue;
    INFO(path.string());
    convert::ConvertOptions options;
    options.input = path.string();
    options.output = output;
    options.source_ids = true;
    options.normals = converted % 2 == 0 ? convert::Normals::kAlways : convert::Normals::kAuto;
    options.threads = 2;
    if (converted % 3 == 1) options.grid = convert::Grid::kScene;
    if (converted % 5 == 1) options.zstd_level = 1;
    if (converted % 4 >= 2) options.encoding = convert::Encoding::kClustered;
    if (converted % 8 == 2) options.clusters = tools::ClusterEffort::kBest;
    // Indices of JPEGs would take most of the time.
    if (tests::kIsSanitized && converted % 3 != 2) options.images.textures = convert::Textures::kRaw;
    Result<convert::ConvertReport> report = convert::convert(options);
    if (!report && report.error().message.find("--grid scene") != std::string::npos) {
      // A detailed mesh beside a very wide one. A common step may need more bits than are available.
      REQUIRE(report.error().code == ErrorCode::kRange);
      REQUIRE(options.grid == convert::Grid::kScene);
      options.grid = convert::Grid::kMesh;
      report = convert::convert(options);
    }
    if (!report) {
      // A model may be refused only if it needs features that this program does not support at all, or if its nodes are
      // not trees. A supported model must not be refused.
      const std::string& message = report.error().message;
      INFO(message);
      CHECK((report.error().code == ErrorCode::kUnsupported || message.find("has two parents") != std::string::npos ||
             message.find("is no root") != std::string::npos || message.find("a multiple of 3") != std::string::npos));
      CHECK_FALSE(fs::exists(output));
      CHECK_FALSE(fs::exists(output + ".part"));
      ++refused[report.error().message];
      continue;
    }
    const tests::Comparison comparison = tests::compare_with_source(path.string(), output);
    CHECK(comparison.difference == "");
    CHECK(comparison.triangles == report->triangles);
    CHECK(comparison.position_error <= report->position_error_bound);
    CHECK(comparison.position_error == report->position_error);
    fs::remove(output);
    ++converted;
    triangles += report->triangles;
  }
  CHECK(converted >= (tests::kIsSanitized ? 75 : 150));
  CHECK(triangles >= (tests::kIsSanitized ? 100'000 : 500'000));
}
