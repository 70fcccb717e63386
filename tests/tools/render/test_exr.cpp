// .exr files that cannot be written. tests/library/test_exr.cpp tests written files.
#include "tools/render/exr.h"

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/full_disk.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"

using namespace scree::tests;
namespace fs = std::filesystem;

TEST_CASE("an .exr that cannot be written completely leaves nothing behind", "[render][exr]") {
  const TempFolder folder;
  const std::string path = folder.file("full.exr");
  std::vector<float> values(100 * 100);
  for (size_t i = 0; i < values.size(); ++i) values[i] = std::sin(static_cast<float>(i * i));  // does not compress
  const scree::tools::ExrChannel channel{"Z", scree::tools::ExrType::kFloat, values.data(), 1};
  const auto write = [&] {
    return scree::tools::write_exr(path, 100, 100, {&channel, 1}, scree::format::Existing::kReplace);
  };
  REQUIRE(write());
  const auto whole = fs::file_size(path);
  fs::remove(path);
  // The write fails in the header, among the pixels, and one byte before the end.
  for (const uint64_t bytes : {uint64_t{20}, uint64_t{9000}, uint64_t{whole - 1}}) {
    check_refusal(on_full_disk(bytes, write), scree::ErrorCode::kFile, "full.exr.part: write: File too large");
    CHECK_FALSE(fs::exists(path));
    CHECK_FALSE(fs::exists(path + ".part"));
  }
}
