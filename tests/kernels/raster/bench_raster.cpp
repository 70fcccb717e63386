// Speed of drawing triangles: scree_tests "[.bench]", in a Release build. Speeds that must be reached have tests.
#include <chrono>
#include <cstdio>
#include <thread>

#include "kernels/cpu/backend.h"
#include "tests/kernels/scene_builder.h"
#include "tests/speed.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// Bumpy ground of columns x rows quads in blocks of 8 x 8 (as in a mesh ordered for locality), 0.0625 units per quad:
/// a smaller version of the measured scene A.
Soup ground(uint32_t columns, uint32_t rows) {
  Soup soup;
  const double step = 0.0625;
  for (uint32_t j = 0; j <= rows; ++j) {
    for (uint32_t i = 0; i <= columns; ++i) {
      const double x = (i - 0.5 * columns) * step, y = (j - 0.5 * rows) * step;
      const uint32_t noise = (i * 2654435761u) ^ (j * 2246822519u) ^ ((i + 7 * j) * 3266489917u);
      soup.add(x + 0.01 * ((noise >> 8) % 3),
               3 * std::sin(0.11 * x) * std::cos(0.13 * y) + 0.03 * ((noise >> 13) % 256) / 256, -y);
    }
  }
  for (uint32_t bj = 0; bj < rows; bj += 8) {
    for (uint32_t bi = 0; bi < columns; bi += 8) {
      for (uint32_t j = bj; j < std::min(bj + 8, rows); ++j) {
        for (uint32_t i = bi; i < std::min(bi + 8, columns); ++i) {
          const uint32_t a = j * (columns + 1) + i;
          soup.triangle(a, a + 1, a + columns + 2);
          soup.triangle(a, a + columns + 2, a + columns + 1);
        }
      }
    }
  }
  return soup;
}

}  // namespace

TEST_CASE("bench: small triangles", "[.bench]") {
  SceneBuilder builder;
  Encoding encoding{.exponent = -10};
  const uint32_t material = builder.material(0);
  encoding.material = material;
  builder.instance(builder.mesh(ground(1632, 1224), encoding), builder.identity());
  const SceneView scene = builder.view();
  struct Place {
    const char* name;
    View view;
  };
  const Place places[] = {
      {"overview", look_at({0, 64, 32}, {0, 0, 0}, 1920, 1080, 0.1, 1.0471975511965976)},
      {"far (4 x)", look_at({0, 256, 128}, {0, 0, 0}, 1920, 1080, 0.1, 1.0471975511965976)},
      {"closeup", look_at({-10, 6, 20}, {6, 0, 0}, 1920, 1080, 0.1, 1.0471975511965976)},
  };
  std::vector<uint64_t> samples(1920 * 1080);
  for (const Place& place : places) {
    for (InstructionSet set : {best_instruction_set(), InstructionSet::kBaseline}) {
      for (uint32_t threads : {1u, std::thread::hardware_concurrency()}) {
        double best = 1e9, best_cpu = 1e9;
        FrameStats stats{};
        for (int run = 0; run < 7; ++run) {
          const double cpu_start = cpu_seconds();
          const auto start = std::chrono::steady_clock::now();
          auto drawn = draw_cpu_with(scene, place.view, samples, threads, set, QueueSizes{});
          best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
          best_cpu = std::min(best_cpu, cpu_seconds() - cpu_start);
          REQUIRE(drawn);
          stats = *drawn;
        }
        std::printf(
            "%-10s %-8s %2u threads %7.2f ms, %7.2f ms of CPU: %6.1f M triangles/s a core (%.2f M, boxes with a pixel "
            "%.2f M, %llu px)\n",
            place.name, set == InstructionSet::kBaseline ? "baseline" : "avx2", threads, 1e3 * best, 1e3 * best_cpu,
            static_cast<double>(stats.triangles) / best_cpu * 1e-6, static_cast<double>(stats.triangles) * 1e-6,
            static_cast<double>(stats.triangles_small) * 1e-6, static_cast<unsigned long long>(covered(samples)));
      }
    }
  }
}

#ifdef NDEBUG
TEST_CASE("speed: 15 M small triangles per second and core at 1920 x 1080", "[speed]") {
  SceneBuilder builder;
  builder.instance(builder.mesh(ground(1632, 1224), {.exponent = -10, .material = builder.material(0)}),
                   builder.identity());
  const SceneView scene = builder.view();
  const View view = look_at({0, 64, 32}, {0, 0, 0}, 1920, 1080, 0.1, 1.0471975511965976);
  std::vector<uint64_t> samples(1920 * 1080);
  for (InstructionSet set : {best_instruction_set(), InstructionSet::kBaseline}) {
    check_speed(30, 1 / 15e6, [&] {
      const double start = cpu_seconds();
      const auto drawn = must(draw_cpu_with(scene, view, samples, 1, set, QueueSizes{}));
      REQUIRE(drawn.triangles > samples.size());  // smaller than a pixel each
      return (cpu_seconds() - start) / static_cast<double>(drawn.triangles);
    });
  }
}
#endif

TEST_CASE("bench: medium and large triangles", "[.bench]") {
  // Layers of quads that face the camera, back to front and front to back.
  for (uint32_t quads : {1u, 16u, 64u, 160u}) {
    SceneBuilder builder;
    Soup soup;
    const int layers = 8;
    for (int layer = 0; layer < layers; ++layer) {
      const double z = -0.01 * layer;
      const uint32_t first = static_cast<uint32_t>(soup.positions.size() / 3);
      for (uint32_t j = 0; j <= quads; ++j)
        for (uint32_t i = 0; i <= quads; ++i) soup.add(-2 + 4.0 * i / quads, -2 + 4.0 * j / quads, z);
      for (uint32_t j = 0; j < quads; ++j) {
        for (uint32_t i = 0; i < quads; ++i) {
          const uint32_t a = first + j * (quads + 1) + i;
          soup.triangle(a, a + 1, a + quads + 2);
          soup.triangle(a, a + quads + 2, a + quads + 1);
        }
      }
    }
    builder.instance(builder.mesh(soup, Encoding{}), builder.identity());
    std::vector<uint64_t> samples(1920 * 1080);
    for (double side : {1.0, -1.0}) {
      builder.material(format::kMaterialDoubleSided);
      builder.meshes[0].material = 0;
      const View view = look_at({0.1, 0.2, side}, {0.1, 0.2, 0}, 1920, 1080, 0.1, 1.0);
      const SceneView both = builder.view();
      double best_cpu = 1e9;
      for (int run = 0; run < 5; ++run) {
        const double start = cpu_seconds();
        REQUIRE(draw_cpu(both, view, samples, 1));
        best_cpu = std::min(best_cpu, cpu_seconds() - start);
      }
      std::printf("%3u x %3u quads of %4.0f pixels, %s: %7.2f ms of CPU, %6.1f M samples/s\n", quads, quads,
                  1976.0 * 4 / 2 / quads, side > 0 ? "front to back" : "back to front", 1e3 * best_cpu,
                  layers * 1920 * 1080 / best_cpu * 1e-6);
    }
  }
}
