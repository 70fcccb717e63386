#include "tools/render/render_options.h"

#include <fstream>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "tests/runtime/small_scene.h"
#include "tests/tools/render/run_render.h"

using scree::ErrorCode;
using scree::Result;
using scree::tests::run_render;
using scree::tests::ScratchPath;
using scree::tests::SmallScene;
using namespace scree::tools;

namespace {

std::string usage_message(const RenderWords& words) {
  const Result<RenderOptions> options = parse_render_options(words);
  if (options) return "";
  CHECK(options.error().code == ErrorCode::kUsage);
  return options.error().message;
}

RenderWords words_with(std::string RenderWords::*member, const char* text) {
  RenderWords words;
  words.file = "a.scree";
  words.*member = text;
  return words;
}

}  // namespace

TEST_CASE("without an output the picture is written beside the file", "[render]") {
  RenderWords words;
  words.file = "folder/town.scree";
  RenderOptions options = must(parse_render_options(words));
  CHECK(options.output == "folder/town.png");
  CHECK(options.threads >= 1);
  words.picks = {"1,2"};
  options = must(parse_render_options(words));
  CHECK(options.output.empty());
  CHECK(options.picks[0].y == 2);
}

TEST_CASE("ambient occlusion and eye-dome lighting darken a picture", "[render]") {
  RenderWords words;
  words.file = "a.scree";
  RenderOptions options = must(parse_render_options(words));
  CHECK_FALSE(options.shade.ssao);
  CHECK_FALSE(options.shade.edl);
  words.ssao = words.edl = true;
  words.edl_strength = "2.5";
  words.edl_radius = "3";
  options = must(parse_render_options(words));
  CHECK(options.shade.ssao);
  CHECK(options.shade.edl);
  CHECK(options.shade.edl_strength == 2.5f);
  CHECK(options.shade.edl_radius == 3);
}

TEST_CASE("an error for a bad value gives the allowed values", "[render]") {
  CHECK(usage_message(words_with(&RenderWords::size, "1920")) == "--size: '1920' is not WxH with each side 1 to 16384");
  CHECK(usage_message(words_with(&RenderWords::size, "0x5")) != "");
  CHECK(usage_message(words_with(&RenderWords::size, "5x16385")) != "");
  CHECK(usage_message(words_with(&RenderWords::size, "5x5x5")) != "");
  CHECK(usage_message(words_with(&RenderWords::size, "-5x5")) != "");
  CHECK(usage_message(words_with(&RenderWords::samples, "3")) == "--samples: '3' is not 1, 2 or 4");
  CHECK(usage_message(words_with(&RenderWords::show, "colour")) ==
        "--show: 'colour' is not one of texture, color, uv, normal, triangle, cluster, mesh, stage, depth");
  CHECK(usage_message(words_with(&RenderWords::edl_strength, "2")) == "--edl-strength needs --edl");
  CHECK(usage_message(words_with(&RenderWords::edl_radius, "2")) == "--edl-radius needs --edl");
  for (const char* strength : {"-1", "101", "nan", "strong"}) {
    RenderWords words = words_with(&RenderWords::edl_strength, strength);
    words.edl = true;
    CHECK(usage_message(words) == "--edl-strength: '" + std::string(strength) + "' is not a number from 0 to 100");
  }
  for (const char* radius : {"0", "65", "1.5", "-1"}) {
    RenderWords words = words_with(&RenderWords::edl_radius, radius);
    words.edl = true;
    CHECK(usage_message(words) != "");
  }
  CHECK(usage_message(words_with(&RenderWords::eye, "1,2")) == "--eye: '1,2' is not three numbers X,Y,Z");
  CHECK(usage_message(words_with(&RenderWords::eye, "1,nan,2")) != "");
  CHECK(usage_message(words_with(&RenderWords::target, "1,2,3")) == "--target needs --eye");
  for (const char* box : {"1,2,3,4,5", "1,2,3,4,5,6,7", "1,2,3,4,inf,6", "1,2,3,4,,6", "1,2,7,4,5,6"})
    CHECK(usage_message(words_with(&RenderWords::clip_box, box)) ==
          "--clip-box: '" + std::string(box) +
              "' is not six numbers X0,Y0,Z0,X1,Y1,Z1, the smaller corner of a box and then the larger");
  CHECK(usage_message(words_with(&RenderWords::clip_box, "1,2,3,1,5.5,6e3")) == "");
  CHECK(usage_message(words_with(&RenderWords::fov, "180")) != "");
  CHECK(usage_message(words_with(&RenderWords::background, "#12345")) != "");
  CHECK(usage_message(words_with(&RenderWords::background, "#12345g")) != "");
  CHECK(usage_message(words_with(&RenderWords::output, "a.jpg")) != "");
  RenderWords large = words_with(&RenderWords::size, "8193x10");
  large.samples = "2";
  CHECK(usage_message(large) == "--size 8193x10 with --samples 2 makes 16386 samples per side, at most 16384");
  RenderWords pick;
  pick.picks = {"1920,0"};
  CHECK(usage_message(pick) ==
        "--pick: '1920,0' is not a pixel X,Y with X below 1920 and Y below 1080, counted from the top left");
  RenderWords both = words_with(&RenderWords::camera, "0");
  both.up = "0,0,1";
  CHECK(usage_message(both) == "--camera and --up exclude each other");
  RenderWords same = words_with(&RenderWords::depth, "x");
  same.visbuffer = "x";
  CHECK(usage_message(same) == "--depth and --visbuffer are both x");
}

TEST_CASE("colours are parsed in CSS syntax", "[render]") {
  CHECK(*parse_color("#fff") == std::array<float, 4>{1, 1, 1, 1});
  CHECK(*parse_color("#FF000080") == std::array<float, 4>{1, 0, 0, 128.0f / 255.0f});
  CHECK(*parse_color("none") == std::array<float, 4>{0, 0, 0, 0});
  CHECK((*parse_color("gray"))[0] == Approx(0.2158605f));
  CHECK_FALSE(parse_color(""));
  CHECK_FALSE(parse_color("mauve"));
}

TEST_CASE("render writes picture, depth and visibility buffer", "[render]") {
  const ScratchPath file("tool.scree");
  const ScratchPath picture("tool.png"), depth("tool.pfm");
  const ScratchPath visibility("tool.bin");
  SmallScene{}.write(file.string());
  // Vectors may begin with a minus sign, and must not be taken for options.
  must(run_render({file.string(), "-o", picture.string(), "--depth", depth.string(), "--visbuffer", visibility.string(),
                   "--size", "32x16", "--eye", "-0.5,0,3", "--target", "-0.5,-0.25,0", "--samples", "2", "--background",
                   "none", "-q"}));
  const scree::runtime::Image image = must(scree::runtime::decode_image(scree::tests::read_bytes(picture.path())));
  CHECK(image.width == 32);
  CHECK(image.rgba[3] == 0);
  CHECK(image.rgba[4 * (8 * 32 + 16) + 3] == 255);
  CHECK(scree::tests::read_bytes(depth.path()).size() == std::string("Pf\n32 16\n-1.0\n").size() + 4 * 32 * 16);
  CHECK(scree::tests::read_bytes(visibility.path()).size() == 8 * 64 * 32);
}

TEST_CASE("render refuses to overwrite its input", "[render]") {
  const ScratchPath file("self.scree");
  SmallScene{}.write(file.string());
  CHECK(refusal(run_render({file.string(), "--depth", file.string()})).code == ErrorCode::kUsage);
}

TEST_CASE("render names a file that is missing or no .scree file", "[render]") {
  CHECK(refusal(run_render({"no_such.scree", "--pick", "1,1"})).message ==
        "no_such.scree: cannot open: No such file or directory");
  const ScratchPath other("other.scree");
  std::ofstream(other.path()) << "solid cube\nfacet normal 0 0 1\n";
  const auto foreign = refusal(run_render({other.string(), "--pick", "1,1"}));
  CHECK(foreign.message.find(other.string() + ": ") == 0);
  CHECK(scree::exit_code(foreign.code) == 3);
}
