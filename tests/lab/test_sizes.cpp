// The size of geometry in each encoding.
#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "lab/sizes.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using namespace scree::lab;

namespace {

const SizeRow& row_of(const std::vector<SizeRow>& rows, std::string_view content, std::string_view encoding,
                      int level) {
  const auto found = std::find_if(rows.begin(), rows.end(), [&](const SizeRow& row) {
    return row.content == content && row.encoding == encoding && row.zstd_level == level;
  });
  INFO(content << ", " << encoding << ", zstd " << level);
  REQUIRE(found != rows.end());
  return *found;
}

TEST_CASE("sizes of a model in every encoding", "[lab]") {
  const tests::TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 60, .rows = 60, .normal = true});
  const auto rows = must(measure_sizes({folder.file("in.glb")}));
  for (const SizeRow& row : rows) {
    INFO(row.content << ", " << row.encoding << ", zstd " << row.zstd_level);
    CHECK(row.model == "in.glb");
    CHECK(row.triangles == 2 * 60 * 60);
    CHECK(row.vertices == 61 * 61);
    CHECK(row.disk_bytes > 0);
  }
  for (const std::string content : {"geometry", "normals"}) {
    const SizeRow& raw = row_of(rows, content, "clustered", 0);
    CHECK(raw.disk_bytes == raw.device_bytes);
    CHECK(raw.encode_s > 0);
    CHECK(raw.decode_s > 0);
    CHECK(row_of(rows, content, "clustered", 3).disk_bytes < raw.disk_bytes);
    CHECK(row_of(rows, content, "clustered", 3).device_bytes == raw.device_bytes);
    CHECK(raw.device_bytes < row_of(rows, content, "indexed", 0).device_bytes);
    CHECK(row_of(rows, content, "meshoptimizer", 19).disk_bytes < row_of(rows, content, "meshoptimizer", 0).disk_bytes);
    CHECK(row_of(rows, content, "glTF", 0).disk_bytes >= 12 * 61 * 61);
  }
  CHECK(row_of(rows, "geometry", "indexed", 0).disk_bytes < row_of(rows, "normals", "indexed", 0).disk_bytes);
  CHECK(row_of(rows, "normals", "glTF", 0).disk_bytes - row_of(rows, "geometry", "glTF", 0).disk_bytes == 12 * 61 * 61);
}

}  // namespace
