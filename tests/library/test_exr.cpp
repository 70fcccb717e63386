// Pictures of scree render as .exr files, read back by the library.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>

#include "runtime/images/image.h"
#include "tests/library/handles.h"
#include "tests/results.h"
#include "tests/tools/run_program.h"

using namespace scree::tests;

namespace {

constexpr uint32_t kWidth = 61;
constexpr uint32_t kHeight = 47;

/// The channels of a file, row by row, with the types of the file.
struct ExrFile {
  explicit ExrFile(const std::string& path) : file(path.c_str()) {
    const auto box = file.header().dataWindow();
    width = static_cast<uint32_t>(box.max.x + 1);
    height = static_cast<uint32_t>(box.max.y + 1);
  }
  std::string names() const {
    std::string all;
    for (auto i = file.header().channels().begin(); i != file.header().channels().end(); ++i)
      all += std::string(all.empty() ? "" : " ") + i.name() + ":" + "uhf"[i.channel().type];
    return all;
  }
  template <class T>
  std::vector<T> read(const char* name, Imf::PixelType type) {
    std::vector<T> values(size_t{width} * height);
    Imf::FrameBuffer buffer;
    buffer.insert(name, Imf::Slice(type, reinterpret_cast<char*>(values.data()), sizeof(T), sizeof(T) * width));
    file.setFrameBuffer(buffer);
    file.readPixels(0, static_cast<int>(height) - 1);
    return values;
  }
  std::vector<float> floats(const char* name) { return read<float>(name, Imf::FLOAT); }

  Imf::InputFile file;
  uint32_t width = 0, height = 0;
};

std::string render(const TempFolder& folder, const std::string& file, const std::string& more) {
  return must_run(words_of("render " + file + " --size 61x47 --samples 2 --backend cpu --force --quiet " + more),
                  folder.file("log"))
      .output;
}

/// Every third value from `first` on, in the form of a layer.
std::vector<float> channel_of(const std::vector<float>& values, size_t first, size_t stride) {
  std::vector<float> out;
  for (size_t i = first; i < values.size(); i += stride) out.push_back(values[i]);
  return out;
}

}  // namespace

TEST_CASE("an .exr has the picture in linear light and the library's layers", "[render][exr]") {
  const TempFolder folder;
  size_t covered = 0;
  size_t translucent = 0;  // pixels without an instance, such as the panes of glass.glb
  for (const char* const model : {"textured_cube.glb", "two_instances.gltf", "glass.glb"}) {
    const std::string file = packed(folder, model, SCREE_CONVERT_NORMALS);
    const std::string exr = folder.file("a.exr"), png = folder.file("a.png");
    render(folder, file, "-o " + exr + " --float --background none --edl");
    render(folder, file, "-o " + png + " --background none --edl");
    ExrFile read(exr);
    REQUIRE(read.width == kWidth);
    REQUIRE(read.height == kHeight);
    CHECK(read.names() ==
          "A:f B:f G:f N.X:f N.Y:f N.Z:f R:f UV.U:f UV.V:f Z:f id.instance:u id.material:u id.mesh:u id.triangle:u");

    const Opened opened(file);
    scree_draw_options options = draw_options(kWidth, kHeight, 2);
    options.flags = SCREE_EDL;
    must(scree_draw(opened.view, nullptr, &options));
    const auto colors = values_of<float>(layer_of(opened.view, SCREE_LINEAR));
    const char* const names[] = {"R", "G", "B", "A"};
    for (size_t i = 0; i < 4; ++i) CHECK(read.floats(names[i]) == channel_of(colors, i, 4));
    CHECK(read.floats("Z") == values_of<float>(layer_of(opened.view, SCREE_DEPTH)));
    const auto normals = values_of<float>(layer_of(opened.view, SCREE_NORMAL));
    const char* const axes[] = {"N.X", "N.Y", "N.Z"};
    for (size_t i = 0; i < 3; ++i) CHECK(read.floats(axes[i]) == channel_of(normals, i, 3));
    const auto uvs = values_of<float>(layer_of(opened.view, SCREE_UV));
    CHECK(read.floats("UV.U") == channel_of(uvs, 0, 2));
    CHECK(read.floats("UV.V") == channel_of(uvs, 1, 2));
    const auto instances = values_of<int32_t>(layer_of(opened.view, SCREE_INSTANCE));
    const auto triangles = values_of<int64_t>(layer_of(opened.view, SCREE_TRIANGLE));
    const auto instance = read.read<uint32_t>("id.instance", Imf::UINT),
               mesh = read.read<uint32_t>("id.mesh", Imf::UINT),
               material = read.read<uint32_t>("id.material", Imf::UINT),
               triangle = read.read<uint32_t>("id.triangle", Imf::UINT);
    for (size_t i = 0; i < instances.size(); ++i) {
      REQUIRE(static_cast<int32_t>(instance[i]) == instances[i]);
      if (instances[i] < 0) {
        CHECK((mesh[i] == UINT32_MAX && material[i] == UINT32_MAX && triangle[i] == UINT32_MAX));
        continue;
      }
      auto info = sized<scree_instance_info>();
      must(scree_get_instance_info(opened.scene, instance[i], &info));
      CHECK((mesh[i] == info.mesh && static_cast<int32_t>(material[i]) == info.material));
      CHECK(triangle[i] + info.first_triangle == static_cast<uint64_t>(triangles[i]));
      ++covered;
    }

    // Coded in 8 bits, the picture equals the .png, except for the last bit of alpha.
    const std::string bytes = read_whole(png);
    const scree::runtime::Image image = must(scree::runtime::decode_image(std::as_bytes(std::span(bytes))));
    const std::vector<float> channels[] = {read.floats("R"), read.floats("G"), read.floats("B"), read.floats("A")};
    const auto code = [](float linear) {
      const double value = static_cast<double>(linear);
      return value <= 0.0031308 ? 12.92 * value : 1.055 * std::pow(value, 1 / 2.4) - 0.055;
    };
    for (size_t i = 0; i < instances.size(); ++i) {
      const float alpha = channels[3][i];
      if (instances[i] < 0 && alpha > 0.1f && alpha < 0.9f) ++translucent;
      CHECK(image.rgba[4 * i + 3] == Approx(255.0 * static_cast<double>(alpha)).margin(0.51));
      for (size_t c = 0; c < 3 && alpha > 0; ++c)
        CHECK(image.rgba[4 * i + c] == Approx(255 * code(channels[c][i] / alpha)).margin(0.51));
    }
  }
  CHECK(covered > 200);
  CHECK(translucent > 100);
}

TEST_CASE("an .exr has the requested layers", "[render][exr]") {
  const TempFolder folder;
  const std::string file = packed(folder);
  const std::string some = folder.file("some.exr"), again = folder.file("again.exr"),
                    colors = folder.file("colors.exr");
  render(folder, file, "--layers depth,id --threads 3 -o " + some);
  CHECK(ExrFile(some).names() == "Z:f id.instance:u id.material:u id.mesh:u id.triangle:u");
  render(folder, file, "--layers id,depth --threads 1 -o " + again);
  CHECK(read_whole(some) == read_whole(again));
  render(folder, file, "--layers color --show triangle -o " + colors);
  CHECK(ExrFile(colors).names() == "A:h B:h G:h R:h");
  // A half has no number above 65504.
  render(folder, file, "--layers color --light environment --exposure 20 -o " + colors);
  const std::vector<float> bright = ExrFile(colors).floats("R");
  CHECK(*std::max_element(bright.begin(), bright.end()) == 65504);
  for (const char* const words :
       {"-o x.exr --layers colour", "-o x.png --layers color", "-o x.png --float", "-o x.jpg"}) {
    const ProgramRun run = run_program(words_of("render " + file + " " + words), folder.file("log"));
    INFO(run.output);
    CHECK(run.exit_code == 1);
    CHECK(std::count(run.output.begin(), run.output.end(), '\n') == 1);
  }
}
