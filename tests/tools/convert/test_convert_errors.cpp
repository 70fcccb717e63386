// convert() refuses unsupported input, and an error leaves no files behind.

#include <atomic>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/catch.h"
#include "tests/full_disk.h"
#include "tests/results.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"

using namespace scree;
using namespace scree::tests;

namespace {}  // namespace

TEST_CASE("a broken image is named and nothing is written", "[convert]") {
  const TempFolder folder;
  const std::vector<uint8_t> pixels(16 * 16 * 3, 77);
  REQUIRE(runtime::write_png(folder.file("a.png"), {16, 16, 3, pixels}));
  std::string png = tests::read_whole(folder.file("a.png"));
  png.resize(png.size() - 20);
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    const uint32_t material = maker.textured("bark", format::ImageCodec::kPng, std::as_bytes(std::span(png)));
    maker.node("a", maker.mesh("a", {maker.grid({.uv = true}, material)}));
  });
  const auto report = refusal(convert::convert(options_of(folder)));
  CHECK(report.message.find("image 0 (bark)") != std::string::npos);
  CHECK(exit_code(report.code) == 3);
  CHECK(folder.names() == std::vector<std::string>{"a.png", "in.glb"});
}

TEST_CASE("invalid options are refused", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  convert::ConvertOptions options = options_of(folder);
  SECTION("too few bits") {
    options.position_bits = 7;
    must_fail(options, ErrorCode::kUsage, "--positions");
  }
  SECTION("too many bits") {
    options.position_bits = 25;
    must_fail(options, ErrorCode::kUsage, "--positions");
  }
  SECTION("an error of NaN") {
    options.max_error = std::nan("");
    must_fail(options, ErrorCode::kUsage, "--max-error");
  }
  SECTION("float32 with an error") {
    options.float32 = true;
    options.max_error = 1;
    must_fail(options, ErrorCode::kUsage, "exclude each other");
  }
  SECTION("zstd level") {
    options.zstd_level = 23;
    must_fail(options, ErrorCode::kUsage, "--zstd");
  }
  SECTION("no input") {
    options.input = folder.file("none.glb");
    must_fail(options, ErrorCode::kFile, "none.glb");
  }
  SECTION("no folder") {
    options.output = folder.file("none/out.scree");
    must_fail(options, ErrorCode::kFile, "none");
  }
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
    maker.node("bad", maker.mesh("bad", {maker.primitive({kNan, 0, 0, 1, 0, 0, 0, 1, 0}, {})}));
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
    CHECK(refusal(convert::convert(options)).message.find("interrupted") != std::string::npos);
  }
  CHECK(folder.names() == std::vector<std::string>{"in.glb"});
}
