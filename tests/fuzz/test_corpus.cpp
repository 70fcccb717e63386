// The fuzz targets over their committed corpus: the seeds, what coverage found worth keeping, and the inputs that once
// broke something ("found-...").
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/format/container_fixture.h"
#include "tests/fuzz/targets.h"
#include "tests/paths.h"

namespace scree::fuzz {
namespace {

/// Runs the target over the corpus of `folder` and over pieces of it: every input cut in half, and nothing at all.
void replay(const std::string& name, const std::string& folder) {
  const auto* const target = std::find_if(std::begin(kTargets), std::end(kTargets),
                                          [&](const Target& candidate) { return candidate.name == name; });
  REQUIRE(target != std::end(kTargets));
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(tests::kCorpusFolder) / folder))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  REQUIRE(!files.empty());
  target->run({});
  for (const std::filesystem::path& file : files) {
    INFO(file.string());  // a target that breaks ends the program
    const tests::Bytes bytes = tests::read_file(file.string());
    target->run(bytes);
    target->run(Bytes(bytes).first(bytes.size() / 2));
  }
  SUCCEED(files.size() << " inputs");
}

TEST_CASE("fuzz corpus: index_codec", "[fuzz]") {
  replay("index_codec", "index_codec");
}
TEST_CASE("fuzz corpus: position_codec", "[fuzz]") {
  replay("position_codec", "position_codec");
}
TEST_CASE("fuzz corpus: attribute_codec", "[fuzz]") {
  replay("attribute_codec", "attribute_codec");
}
TEST_CASE("fuzz corpus: cluster_codec", "[fuzz]") {
  replay("cluster_codec", "cluster_codec");
}
TEST_CASE("fuzz corpus: cluster_page", "[fuzz]") {
  replay("cluster_page", "cluster_page");
}
TEST_CASE("fuzz corpus: jpeg_index", "[fuzz]") {
  replay("jpeg_index", "jpeg_index");
}
TEST_CASE("fuzz corpus: jpeg_file", "[fuzz]") {
  replay("jpeg_file", "jpeg_file");
}
TEST_CASE("fuzz corpus: image", "[fuzz]") {
  replay("image", "image");
}
TEST_CASE("fuzz corpus: container", "[fuzz]") {
  replay("container", "container");
}
TEST_CASE("fuzz corpus: scene", "[fuzz]") {
  replay("scene", "container");
}
TEST_CASE("fuzz corpus: gltf", "[fuzz]") {
  replay("gltf", "gltf");
}

}  // namespace
}  // namespace scree::fuzz
