// convert() refuses unsupported input, and an error leaves no files behind.
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/catch.h"
#include "tests/results.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"

using namespace scree;
using tests::GridSpec;
using tests::kNan;
using tests::ModelMaker;
using tests::must_fail;
using tests::must_match;
using tests::options_of;
using tests::TempFolder;

namespace {}  // namespace

TEST_CASE("a broken image is named and nothing is written", "[convert]") {
  const TempFolder folder;
  const std::vector<uint8_t> pixels(16 * 16 * 3, 77);
  REQUIRE(runtime::write_png(folder.file("a.png"), {16, 16, 3, pixels}));
  std::string png = tests::read_whole(folder.file("a.png"));
  png.resize(png.size() - 20);
  {
    ModelMaker maker(folder.file("in.glb"));
    const uint32_t material = maker.textured("bark", format::ImageCodec::kPng, std::as_bytes(std::span(png)));
    GridSpec spec;
    spec.uv = true;
    maker.node("a", maker.mesh("a", {maker.grid(spec, material)}));
    maker.finish();
  }
  const auto report = refusal(convert::convert(options_of(folder)));
  CHECK(report.message.find("image 0 (bark)") != std::string::npos);
  CHECK(exit_code(report.code) == 3);
  CHECK(folder.names() == std::vector<std::string>{"a.png", "in.glb"});
}

TEST_CASE("invalid options are refused", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  convert::ConvertOptions options = options_of(folder);
  SECTION("few bits") {
    options.position_bits = 7;
    must_fail(options, ErrorCode::kUsage, "--positions");
  }
  SECTION("many bits") {
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
  {
    ModelMaker maker(folder.file("bad.glb"));
    maker.node("bad", maker.mesh("bad", {maker.primitive({kNan, 0, 0, 1, 0, 0, 0, 1, 0}, {})}));
    maker.finish();
  }
  convert::ConvertOptions bad = options;
  bad.input = folder.file("bad.glb");
  CHECK_FALSE(convert::convert(bad));
  CHECK(tests::read_whole(options.output) == "earlier");
  must_match(options);
}

TEST_CASE("a full disk and an interruption leave nothing behind", "[convert]") {
  const TempFolder folder;
  GridSpec spec;
  spec.columns = spec.rows = 300;
  tests::make_model(folder.file("in.glb"), spec);
  convert::ConvertOptions options = options_of(folder);
  SECTION("disk") {
    // If SIGXFSZ is ignored, write() fails past the limit as on a full disk.
    const auto before = std::signal(SIGXFSZ, SIG_IGN);
    rlimit limit{};
    REQUIRE(getrlimit(RLIMIT_FSIZE, &limit) == 0);
    rlimit low = limit;
    low.rlim_cur = 100000;
    REQUIRE(setrlimit(RLIMIT_FSIZE, &low) == 0);
    const Result<convert::ConvertReport> report = convert::convert(options);
    setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, before);
    REQUIRE_FALSE(report);
    CHECK(report.error().code == ErrorCode::kFile);
    CHECK(report.error().message.find("out.scree") != std::string::npos);
  }
  SECTION("interruption") {
    const std::atomic<bool> stop{true};
    options.stop = &stop;
    CHECK(refusal(convert::convert(options)).message.find("interrupted") != std::string::npos);
  }
  CHECK(folder.names() == std::vector<std::string>{"in.glb"});
}
