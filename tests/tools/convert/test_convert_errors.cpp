// convert() refuses unsupported input, and an error leaves no files behind.

#include <atomic>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/full_disk.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/convert.h"
#include "tools/convert/images/images.h"

using namespace scree;
using namespace scree::tests;

TEST_CASE("a broken image is named and nothing is written", "[convert]") {
  const TempFolder folder;
  const std::vector<uint8_t> pixels(16 * 16 * 3, 77);
  std::vector<std::byte> png = must(runtime::encode_png({16, 16, 3, pixels}));
  png.resize(png.size() - 20);
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    maker.draw("a", {maker.grid({.uv = true}, maker.textured("bark", format::ImageCodec::kPng, png))});
  });
  const auto report = refusal(convert::convert(options_of(folder)));
  CHECK(report.message.find("image 0 (bark)") != std::string::npos);
  CHECK(exit_code(report.code) == 3);
  CHECK(folder.names() == std::vector<std::string>{"in.glb"});
}

TEST_CASE("invalid options are refused", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  using Options = convert::ConvertOptions;
  const auto refuse = [&](ErrorCode code, const char* words, const std::function<void(Options&)>& change) {
    INFO(words);
    Options options = options_of(folder);
    change(options);
    must_fail(options, code, words);
  };
  refuse(ErrorCode::kUsage, "--positions", [](Options& o) { o.position_bits = 7; });
  refuse(ErrorCode::kUsage, "--positions", [](Options& o) { o.position_bits = 25; });
  refuse(ErrorCode::kUsage, "--max-error", [](Options& o) { o.max_error = std::nan(""); });
  refuse(ErrorCode::kUsage, "exclude each other", [](Options& o) { o.float32 = true, o.max_error = 1; });
  refuse(ErrorCode::kUsage, "--zstd", [](Options& o) { o.zstd_level = 23; });
  refuse(ErrorCode::kFile, "none.glb", [&](Options& o) { o.input = folder.file("none.glb"); });
  refuse(ErrorCode::kFile, "none", [&](Options& o) { o.output = folder.file("none/out.scree"); });
}

TEST_CASE("an output that is the input, a buffer of it or a folder is refused", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  convert::ConvertOptions options = options_of(folder);
  SECTION("output is the input") {
    options.output = options.input;
    const std::string before = tests::read_whole(options.input);
    CHECK(refusal(convert::convert(options)).code == ErrorCode::kUsage);
    CHECK((tests::read_whole(options.input) == before));
  }
  SECTION("output is a buffer of the input") {
    tests::make_model(folder.file("in.gltf"), {});
    options.input = folder.file("in.gltf");
    options.output = folder.file("in.bin");
    const std::string before = tests::read_whole(options.output);
    REQUIRE_FALSE(before.empty());
    CHECK(refusal(convert::convert(options)).code == ErrorCode::kUsage);
    CHECK((tests::read_whole(options.output) == before));
  }
  SECTION("output is a folder") {
    std::filesystem::create_directory(options.output);
    CHECK(refusal(convert::convert(options)).code == ErrorCode::kFile);
  }
}

TEST_CASE("an earlier output survives an error and is replaced after success", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  const convert::ConvertOptions options = options_of(folder);
  std::ofstream(options.output) << "earlier";
  tests::make_model(folder.file("bad.glb"), [&](ModelMaker& maker) {
    maker.draw("bad", {maker.primitive({kNan, 0, 0, 1, 0, 0, 0, 1, 0}, {})});
  });
  convert::ConvertOptions bad = options;
  bad.input = folder.file("bad.glb");
  CHECK_FALSE(convert::convert(bad));
  CHECK(tests::read_whole(options.output) == "earlier");
  must_match(options);
}

TEST_CASE("a full disk or an interruption leaves nothing behind", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 300, .rows = 300});
  convert::ConvertOptions options = options_of(folder);
  SECTION("disk") {
    const auto report = tests::on_full_disk(100000, [&] { return convert::convert(options); });
    check_refusal(report, ErrorCode::kFile, "out.scree");
  }
  SECTION("interruption") {
    const std::atomic<bool> stop{true};
    options.stop = &stop;
    CHECK(refusal(convert::convert(options)).message == options.input + ": interrupted");  // by the import
    check_refusal(convert::largest_image_bytes({}, {}, 1, &stop), ErrorCode::kFile, "interrupted");
  }
  CHECK(folder.names() == std::vector<std::string>{"in.glb"});
}
