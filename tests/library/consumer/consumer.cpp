// consumer_cpp MODEL.glb FOLDER: the C++ version of consumer.c, with the same output line.
#include <scree/scree.hpp>

#include <cstdio>
#include <memory>
#include <numeric>
#include <regex>
#include <string>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  try {
    const std::string path = std::string(argv[2]) + "/consumer_cpp.scree";
    auto convert = scree::make<scree_convert_options>();
    convert.flags = SCREE_CONVERT_REPLACE;
    const scree_convert_report report = scree::convert(argv[1], path, convert);
    auto load = scree::make<scree_load_options>();
    load.backend = SCREE_BACKEND_CPU;
    scree::View view = scree::File(path).load(load).view();  // keeps the objects that it needs
    auto draw = scree::make<scree_draw_options>();
    draw.width = 64;
    draw.height = 48;
    draw.background[3] = 1;
    view.draw(scree::make<scree_camera>(), draw);
    const scree_array color = view.host_layer(SCREE_COLOR);
    const auto* const pixels = static_cast<const unsigned char*>(color.data);
    const unsigned long sum = std::accumulate(pixels, pixels + color.bytes, 0ul);
    std::printf("scree %s: %llu triangles, %d x %d, sum %lu\n", scree_version(),
                static_cast<unsigned long long>(report.triangles), static_cast<int>(color.shape[1]),
                static_cast<int>(color.shape[0]), sum);
    // The archive also contains the statics of these functions. The linker must not find them twice.
    const auto version = std::make_shared<std::regex>("[0-9]+[.][0-9]+[.][0-9]+.*");
    if (!std::regex_match(scree_version(), *version)) return 1;
    try {
      view.pick(64, 0);
      return 1;
    } catch (const scree::Error& error) {
      return error.status() == SCREE_ERROR_ARGUMENT ? 0 : 1;
    }
  } catch (const scree::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
