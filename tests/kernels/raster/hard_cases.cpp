#include "tests/kernels/raster/hard_cases.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>

#include "tools/compare/reference.h"

namespace scree::tests {
namespace {

using kernels::kBackground;
using kernels::View;

constexpr double kPi = 3.14159265358979323846;

Encoding lattice(int32_t exponent) {
  return {.exponent = exponent};
}

/// A view of 100 pixels per unit, from above, with the origin at a pixel corner in the picture's middle.
View pixels_view(uint32_t width, uint32_t height) {
  return orthographic(look_at({0, 0, 4}, {0, 0, 0}, width, height), height / 200.0, 0.5, 16);
}

Soup square(double half, double z = 0) {
  Soup soup;
  soup.add(-half, -half, z);
  soup.add(half, -half, z);
  soup.add(half, half, z);
  soup.add(-half, half, z);
  soup.triangle(0, 1, 2);
  soup.triangle(0, 2, 3);
  return soup;
}

/// A rectangle of 2 by 2e-6 * 2 * `count` in slivers of aspect 1e6.
Soup sliver_strip(uint32_t count) {
  Soup soup;
  for (uint32_t i = 0; i <= count; ++i) {
    soup.add(-1, 0.125 + 2e-6 * i, 0);
    soup.add(1, 0.125 + 2e-6 * i, 0);
  }
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t a = 2 * i;
    soup.triangle(a, a + 1, a + 3);
    soup.triangle(a, a + 3, a + 2);
  }
  return soup;
}

HardCase slivers() {
  HardCase hard;
  std::mt19937 random(31);
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (int i = 0; i < 20000; ++i) {
    const double angle = kPi * unit(random), x = unit(random), y = unit(random), z = unit(random);
    const double across = 1e-6;  // units
    const uint32_t a = soup.add(x, y, z);
    soup.add(x + std::cos(angle), y + std::sin(angle), z);
    soup.add(x - across * std::sin(angle), y + across * std::cos(angle), z);
    soup.triangle(a, a + 1, a + 2);
  }
  hard.draw_once(soup, hard.both_sides(float32()));
  hard.views = {look_at({0.3, 0.2, 3}, {0, 0, 0}, 400, 300), pixels_view(400, 300)};
  return hard;
}

HardCase strip() {
  HardCase hard;
  hard.draw_once(sliver_strip(20000), float32());
  hard.views = {look_at({0.3, 0.2, 1}, {0, 0.15, 0}, 400, 300), pixels_view(400, 300)};
  return hard;
}

HardCase degenerate_triangles() {
  HardCase hard;
  Soup soup = sphere(12, 0.1);
  const size_t count = soup.indices.size();
  for (size_t i = 0; i < count; i += 3) {
    const uint32_t a = soup.indices[i], b = soup.indices[i + 1], c = soup.indices[i + 2];
    soup.triangle(a, a, a);
    soup.triangle(a, b, a);
    soup.triangle(b, b, c);
    soup.triangle(a, b, c);  // a duplicate
    soup.triangle(b, c, a);  // a duplicate with rotated corners
  }
  const uint32_t line = soup.add(-2, -2, 0);
  soup.add(0, 0, 0);
  soup.add(2, 2, 0);
  soup.triangle(line, line + 1, line + 2);
  hard.draw_once(soup, hard.both_sides(lattice(-14)));
  hard.views = {look_at({1, 1, 2}, {0, 0, 0}, 200, 150), pixels_view(320, 320)};
  return hard;
}

/// Four coincident surfaces, of several chunks, instances and meshes. The triangles of the last one start at another
/// corner.
HardCase coincident() {
  HardCase hard;
  const uint32_t identity = hard.builder.identity();
  Encoding pieces = lattice(-12);
  pieces.chunk_triangles = 37;
  const uint32_t first = hard.mesh(grid(20, 0.2), pieces);
  const uint32_t copy = hard.mesh(grid(20, 0.2), lattice(-12));
  Soup turned = grid(20, 0.2);
  for (size_t i = 0; i < turned.indices.size(); i += 3)
    std::rotate(&turned.indices[i], &turned.indices[i] + 1, &turned.indices[i] + 3);
  const uint32_t last = hard.mesh(turned, lattice(-12));
  for (const uint32_t mesh : {first, first, copy, last}) hard.builder.instance(mesh, identity);
  hard.views = {look_at({1, 1.5, 2}, {0, 0, 0}, 300, 200), look_at({0, 3, 0}, {0, 0, 0}, 256, 256)};
  return hard;
}

HardCase whole_screen() {
  HardCase hard;
  hard.draw_once(square(1e6, -1), float32());
  hard.draw_once(square(3), float32());
  hard.views = {look_at({0.3, 0.2, 1}, {0, 0, 0}, 321, 203), pixels_view(500, 300),
                look_at({0.1, 0.1, 1e-4}, {0, 0, 0}, 200, 200, 1e-5)};
  return hard;
}

HardCase edge_on() {
  HardCase hard;
  hard.draw_once(grid(30, 0), hard.both_sides(lattice(-12)));
  // The eye in the plane, an ulp-sized angle above it, and a small angle above it.
  hard.views = {look_at({0, 0, 3}, {0, 0, 0}, 300, 200), look_at({0.4, 1e-7, 2}, {0, 0, 0}, 300, 201),
                look_at({0.4, 1e-3, 2}, {0, 0, 0}, 300, 200),
                orthographic(look_at({0, 0, 3}, {0, 0, 0}, 300, 200), 1.2, 0.5, 8)};
  return hard;
}

/// Large triangles around the eye: in front of it, across the near plane, behind it.
HardCase near_plane() {
  HardCase hard;
  std::mt19937 random(47);
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (int i = 0; i < 300; ++i) {
    const uint32_t a = soup.add(4 * unit(random), 4 * unit(random), 4 * unit(random));
    soup.add(4 * unit(random), 4 * unit(random), 4 * unit(random));
    soup.add(4 * unit(random), 4 * unit(random), 4 * unit(random));
    soup.triangle(a, a + 1, a + 2);
  }
  hard.draw_once(soup, hard.both_sides(float32()));
  hard.views = {look_at({0, 0, 0}, {1, 0.2, 0.1}, 200, 150, 0.05), look_at({0, 0, 0}, {0, 1, 0.3}, 200, 150, 0.5),
                look_at({1, 1, 1}, {-1, 0, 0}, 200, 150, 1.0)};
  return hard;
}

HardCase behind() {
  HardCase hard;
  hard.draw_once(sphere(20, 0.1), hard.both_sides(float32()));
  hard.views = {look_at({0, 0, 3}, {0, 0, 6}, 200, 150), look_at({2, 0, 0}, {8, 1, 0}, 100, 100, 0.01, 2.5)};
  return hard;
}

/// Fans whose hub is at the eye, and the eye on their edges and faces.
HardCase vertex_at_eye() {
  HardCase hard;
  Soup soup;
  const uint32_t hub = soup.add(0.5, 0.25, 0.125);
  for (int i = 0; i <= 24; ++i) {
    const double angle = 2 * kPi * i / 24;
    soup.add(0.5 + 2 * std::cos(angle), 0.25 + 2 * std::sin(angle), 0.125 - 1 + 0.3 * std::sin(3 * angle));
  }
  for (uint32_t i = 1; i <= 24; ++i) soup.triangle(hub, hub + i, hub + i + 1);
  hard.draw_once(soup, hard.both_sides(float32()));
  hard.views = {look_at({0.5, 0.25, 0.125}, {0.5, 0.25, -1}, 200, 150, 0.001),
                look_at({0.5, 0.25, 0.125}, {1.5, 0.25, -0.1}, 200, 150, 0.001),
                look_at({1.5, 0.25, -0.375}, {0.5, 0.3, -0.3}, 200, 150, 0.001)};
  return hard;
}

/// All vertices lie at pixel centres; edges run through centres in eight directions.
HardCase pixel_centres() {
  HardCase hard;
  Soup soup;
  const uint32_t n = 14;
  for (uint32_t j = 0; j <= n; ++j)
    for (uint32_t i = 0; i <= n; ++i)
      soup.add((2 * static_cast<int>(8 * i) - 111) / 256.0, (2 * static_cast<int>(8 * j) - 111) / 256.0, 0);
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i, b = a + 1, c = a + n + 2, d = a + n + 1;
      if ((i + j) % 2 == 0) {
        soup.triangle(a, b, c);
        soup.triangle(a, c, d);
      } else {
        soup.triangle(a, b, d);
        soup.triangle(b, c, d);
      }
    }
  }
  hard.draw_once(soup, hard.both_sides(lattice(-8)));
  View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, 128, 128), 0.5, 0, 2);  // 128 pixels per unit
  hard.views = {view};
  for (int i = 0; i < 3; ++i) view.right[i] = -view.right[i], view.up[i] = -view.up[i];
  hard.views.push_back(view);  // upside down, so that the centres on each edge belong to its other side
  return hard;
}

/// 10,000 triangles around a point, all inside of one pixel or up to 40 pixels long.
Soup fan(double x, double y, double radius) {
  Soup soup;
  const uint32_t count = 10000;
  const uint32_t hub = soup.add(x, y, 0);
  for (uint32_t i = 0; i < count; ++i)
    soup.add(x + radius * std::cos(2 * kPi * i / count), y + radius * std::sin(2 * kPi * i / count), 0);
  for (uint32_t i = 0; i < count; ++i) soup.triangle(hub, hub + 1 + i, hub + 1 + (i + 1) % count);
  return soup;
}

HardCase fans() {
  HardCase hard;
  hard.draw_once(fan(0.005, 0.005, 0.4), float32());      // around a pixel's centre, 40 pixels long
  hard.draw_once(fan(-0.595, 0.305, 0.0045), float32());  // within a pixel, around its centre
  hard.draw_once(fan(0.6, -0.3, 0.0045), float32());      // around a corner of four pixels
  hard.draw_once(fan(0.7012, 0.3987, 0.2), float32());    // anywhere
  hard.views = {pixels_view(200, 100)};
  return hard;
}

HardCase subpixel_sphere() {
  HardCase hard;
  hard.draw_once(sphere(150, 0), hard.both_sides(lattice(-16)));  // 89,400 triangles, 4 per pixel
  hard.views = {look_at({0.1, 0.2, 3}, {0, 0, 0}, 160, 160), pixels_view(160, 160)};
  hard.views[1] = orthographic(hard.views[0], 1.2, 0.5, 8);
  return hard;
}

/// A sphere with bumps of a millimetre, 1e7 m from the origin, placed by its instance's translation.
HardCase georeferenced() {
  HardCase hard;
  const uint32_t ball = hard.mesh(sphere(40, 0.001), lattice(-16));
  hard.builder.instance(ball, hard.builder.matrix({1, 0, 0, 1e7, 0, 1, 0, -5e6, 0, 0, 1, 2.5e6}));
  hard.views = {look_at({1e7 + 2.4, -5e6 + 1.1, 2.5e6 + 0.7}, {1e7, -5e6, 2.5e6}, 300, 200),
                look_at({1e7 + 1.01, -5e6, 2.5e6}, {1e7, -5e6 + 0.2, 2.5e6}, 300, 200, 0.001)};
  return hard;
}

/// The same sphere as float32 vertices, which are half a metre apart at that distance.
HardCase georeferenced_floats() {
  HardCase hard;
  Soup soup = sphere(40, 0.001);
  const float away[3] = {1e7f, -5e6f, 2.5e6f};
  for (size_t i = 0; i < soup.positions.size(); ++i) soup.positions[i] = 20 * soup.positions[i] + away[i % 3];
  hard.draw_once(soup, hard.both_sides(float32()));
  hard.views = {look_at({1e7 + 48, -5e6 + 22, 2.5e6 + 14}, {1e7, -5e6, 2.5e6}, 300, 200)};
  return hard;
}

HardCase scaled(double scale) {
  HardCase hard;
  const uint32_t ball = hard.mesh(sphere(30, 0.1), lattice(-14));
  hard.builder.instance(ball, hard.builder.matrix({scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0}));
  Soup small = sphere(30, 0.1);
  for (float& value : small.positions) value *= static_cast<float>(0.5 * scale);
  const uint32_t own = hard.mesh(small, float32());  // placed by its vertices instead of its matrix
  hard.builder.instance(own, hard.builder.matrix({1, 0, 0, 1.5 * scale, 0, 1, 0, 0, 0, 0, 1, 0}));
  hard.views = {look_at({2 * scale, 1.5 * scale, 2.5 * scale}, {0.4 * scale, 0, 0}, 300, 200, 0.1 * scale)};
  return hard;
}

HardCase flat_and_points() {
  HardCase hard;
  const Encoding sides = hard.both_sides(lattice(-12));
  hard.draw_once(grid(10, 0), sides);
  Soup wall;  // flat in x
  for (uint32_t i = 0; i < 4; ++i) wall.add(0.25, i & 1, i >> 1);
  wall.triangle(0, 1, 2);
  wall.triangle(1, 3, 2);
  hard.draw_once(wall, sides);
  Soup line;  // flat in two
  for (uint32_t i = 0; i < 5; ++i) line.add(-0.5, 0.25, 0.2 * i);
  for (uint32_t i = 0; i < 3; ++i) line.triangle(i, i + 1, i + 2);
  hard.draw_once(line, sides);
  Soup point;  // in all three
  for (uint32_t i = 0; i < 3; ++i) point.add(0.5, 0.5, 0.5);
  point.triangle(0, 1, 2);
  hard.draw_once(point, sides);
  hard.views = {look_at({1, 1.5, 2}, {0, 0, 0}, 300, 200), look_at({0, 3, 0}, {0, 0, 0}, 200, 200)};
  return hard;
}

/// Squares that fill one strip of the picture each, from 1e-3 units away, where the near plane is, to 1e7.
HardCase depth_range() {
  HardCase hard;
  const uint32_t identity = hard.builder.identity();
  const int columns = 14;
  for (int column = 0; column < columns; ++column) {
    const double distance = std::pow(10.0, -3 + 10.0 * column / (columns - 1));
    Soup soup;
    const double left = (-0.98 + 0.14 * column) * 0.5 * distance, width = 0.06 * distance, half = 0.4 * distance;
    soup.add(left, -half, -distance);
    soup.add(left + width, -half, -distance);
    soup.add(left + width, half, -1.3 * distance);  // leaning back
    soup.add(left, half, -1.3 * distance);
    soup.triangle(0, 1, 2);
    soup.triangle(0, 2, 3);
    hard.builder.instance(hard.mesh(soup, float32()), identity);
  }
  hard.views = {look_at({0, 0, 0}, {0, 0, -1}, 300, 300, 1e-3, 2 * std::atan(0.5))};
  return hard;
}

HardCase transforms() {
  HardCase hard;
  const uint32_t ball = hard.mesh(sphere(20, 0.1), lattice(-12));
  const uint32_t open = hard.mesh(grid(12, 0.2), hard.both_sides(lattice(-12)));
  for (const uint32_t mesh : {ball, open}) {
    const double y = mesh == ball ? 0 : 2.4;
    const auto at = [&](std::array<double, 12> rows) { hard.builder.instance(mesh, hard.builder.matrix(rows)); };
    at({-1, 0, 0, -3, 0, 1, 0, y, 0, 0, 1, 0});        // mirrored
    at({1, 0.8, 0, 0, 0, 1, 0.5, y, 0.3, 0, 1, 0});    // sheared
    at({0.8, 0, 0, 3, 0, 0, 0, y, 0, 0, 0.8, 0});      // a plane
    at({0.5, 0.5, 0, 5, 0.5, 0.5, 0, y, 0, 0, 0, 0});  // a line
    at({0, 0, 0, -5, 0, 0, 0, y, 0, 0, 0, 0});         // a point
    at({0, -0.7, 0, 7, 0.7, 0, 0, y, 0, 0, -0.7, 0});  // rotated and mirrored
    at({1e-6, 0, 0, -7, 0, 1, 0, y, 0, 0, 1e-6, 0});   // a needle
  }
  hard.views = {look_at({0.5, 3, 9}, {0, 1, 0}, 500, 200), look_at({-2, 6, 1}, {0, 0, 0}, 300, 300)};
  return hard;
}

HardCase odd_sizes() {
  HardCase hard;
  hard.draw_once(sphere(40, 0.1), lattice(-14));
  const View view = look_at({1.2, 0.8, 2}, {0, 0, 0}, 1, 1, 0.1, 0.8);
  for (const auto& [width, height] : {std::array<uint32_t, 2>{1, 1}, {1, 8192}, {8192, 1}, {3, 2}, {129, 127}}) {
    View sized = view;
    sized.width = width;
    sized.height = height;
    hard.views.push_back(sized);  // stretched to fill the picture
  }
  return hard;
}

}  // namespace

uint32_t HardCase::mesh(Soup soup, const Encoding& encoding) {
  const uint32_t number = builder.mesh(soup, encoding);
  soups.push_back(std::move(soup));
  encodings.push_back(encoding);
  return number;
}

void HardCase::draw_once(Soup soup, const Encoding& encoding) {
  builder.instance(mesh(std::move(soup), encoding), builder.identity());
}

Encoding HardCase::both_sides(Encoding encoding) {
  encoding.material = builder.material(format::kMaterialDoubleSided);
  return encoding;
}

std::string Figures::text() const {
  char text[256];
  std::snprintf(text, sizeof text,
                "%llu of %llu pixels covered, %llu by the reference; background wrong %llu, other triangle %llu, depth "
                "error %.1e",
                static_cast<unsigned long long>(covered), static_cast<unsigned long long>(pixels),
                static_cast<unsigned long long>(reference), static_cast<unsigned long long>(background),
                static_cast<unsigned long long>(other_triangle), depth_error);
  return text;
}

Figures judge(HardCase& hard) {
  const kernels::SceneView scene = hard.builder.view();
  std::vector<compare::ReferenceMesh> meshes;
  for (size_t i = 0; i < hard.soups.size(); ++i) {
    const uint32_t material = hard.builder.meshes[i].material;
    meshes.push_back(
        {hard.soups[i].positions, hard.soups[i].indices, nullptr,
         material != format::kNone && (hard.builder.materials[material].flags & format::kMaterialDoubleSided) != 0});
  }
  std::vector<compare::ReferenceInstance> instances;
  for (const format::InstanceRecord& instance : hard.builder.instances) {
    compare::ReferenceInstance out{instance.mesh, {}};
    for (size_t row = 0; row < 3; ++row)
      for (size_t column = 0; column < 4; ++column)
        out.world[row][column] = hard.builder.matrices[instance.matrix].rows[row][column];
    instances.push_back(out);
  }
  Figures figures;
  for (size_t v = 0; v < hard.views.size(); ++v) {
    INFO("view " << v);
    const View& view = hard.views[v];
    const std::vector<uint64_t> samples =
        draw_with(scene, view, 1, kernels::InstructionSet::kBaseline, kernels::QueueSizes{});
    REQUIRE(draw_with(scene, view, 2, kernels::best_instruction_set(), {1, 1, 1}) == samples);
    REQUIRE(draw(scene, view, 2) == samples);
    const auto expected = must(compare::draw_reference(meshes, instances, view, 2));
    figures.pixels += samples.size();
    for (size_t i = 0; i < samples.size(); ++i) {
      const compare::ReferencePixel& right = expected[i];
      const bool drawn = samples[i] != kBackground;
      figures.covered += drawn ? 1 : 0;
      figures.reference += right.is_background() ? 0 : 1;
      if (drawn == right.is_background()) ++figures.background;
      if (!drawn || right.is_background()) continue;
      const uint64_t id = kernels::sample_id(samples[i]);
      const auto next = std::upper_bound(hard.builder.bases.begin(), hard.builder.bases.end(), id);
      const size_t instance = static_cast<size_t>(next - hard.builder.bases.begin()) - 1;
      const uint64_t triangle = id - hard.builder.bases[instance];
      const double depth = kernels::depth_of_code(view, kernels::sample_depth_code(samples[i]));
      if (instance != right.instance || triangle != right.triangle) {
        const auto ours =
            compare::reference_depth(meshes[instances[instance].mesh], instances[instance], triangle, view,
                                     static_cast<uint32_t>(i % view.width), static_cast<uint32_t>(i / view.width));
        // Another triangle at the same depth is equally right.
        if (!ours || std::fabs(*ours - right.depth) > 1e-12 * std::fabs(right.depth)) {
          ++figures.other_triangle;
          continue;
        }
      }
      figures.depth_error = std::max(figures.depth_error, std::fabs(depth - right.depth) / std::fabs(right.depth));
    }
  }
  return figures;
}

CoverCount count_covers(SceneBuilder& builder, const View& view, const Draws& draws) {
  const kernels::SceneView scene = builder.view();
  const auto picture = [&] { return draws ? draws(builder, scene, view) : draw(scene, view, 2); };
  struct Chunk {
    std::vector<uint32_t> indices;
    std::span<std::byte> stream;
    format::IndexRange range;
    uint64_t first;  // number of its first triangle among those of all meshes
  };
  std::vector<Chunk> chunks;
  uint64_t triangles = 0;
  for (const format::ChunkRecord& record : builder.chunks) {
    const format::ChunkStreams streams = format::chunk_streams(builder.meshes[record.mesh], record);
    Chunk chunk{.stream = std::span(builder.pages[record.page]).subspan(streams.indices.offset, streams.indices.bytes),
                .range = {record.index_min, record.index_bits}};
    chunk.indices.resize(3 * size_t{record.triangle_count});
    chunk.first = triangles;
    REQUIRE(record.encoding == format::ChunkEncoding::kIndexed);
    REQUIRE(format::decode_indices(chunk.indices, record.vertex_count, chunk.range, chunk.stream));
    triangles += record.triangle_count;
    chunks.push_back(std::move(chunk));
  }
  const auto keep = [&](auto&& is_kept) {
    std::vector<uint32_t> indices;
    for (Chunk& chunk : chunks) {
      indices = chunk.indices;
      for (size_t t = 0; t < indices.size() / 3; ++t)
        if (!is_kept(chunk.first + t)) indices[3 * t + 1] = indices[3 * t + 2] = indices[3 * t];
      format::encode_indices(chunk.stream, indices, chunk.range);
    }
  };
  CoverCount count;
  const std::vector<uint64_t> whole = picture();
  count.is_covered.resize(whole.size());
  count.is_twice.resize(whole.size());
  for (size_t i = 0; i < whole.size(); ++i) count.is_covered[i] = whole[i] != kBackground;
  for (uint64_t bit = 0; ((triangles - 1) >> bit) != 0; ++bit) {
    std::vector<uint64_t> halves[2];
    for (uint64_t side = 0; side < 2; ++side) {
      keep([&](uint64_t number) { return ((number >> bit) & 1) == side; });
      halves[side] = picture();
    }
    uint64_t different = 0;  // the two halves together must give the whole
    for (size_t i = 0; i < whole.size(); ++i) {
      const bool a = halves[0][i] != kBackground, b = halves[1][i] != kBackground;
      different += (a || b) != count.is_covered[i] ? 1 : 0;
      if (a && b) count.is_twice[i] = true;
    }
    REQUIRE(different == 0);
  }
  keep([](uint64_t) { return true; });
  count.covered = static_cast<uint64_t>(std::count(count.is_covered.begin(), count.is_covered.end(), true));
  count.twice = static_cast<uint64_t>(std::count(count.is_twice.begin(), count.is_twice.end(), true));
  return count;
}

void note(const std::string& what, const std::string& figure) {
  UNSCOPED_INFO(what << ": " << figure);
  if (const char* path = std::getenv("SCREE_HARD_CASES"))
    std::ofstream(path, std::ios::app) << "| " << what << " | " << figure << " |\n";
}

void check_closed(const std::string& name, const Soup& soup, const View& view, double disc_pixels, const Draws& draws) {
  CoverCount counts[2];
  const auto start = std::chrono::steady_clock::now();
  for (const bool turned : {false, true}) {
    Soup facing = soup;
    if (turned)
      for (size_t i = 0; i < facing.indices.size(); i += 3) std::swap(facing.indices[i + 1], facing.indices[i + 2]);
    SceneBuilder builder(facing, {.exponent = -16});
    counts[turned] = count_covers(builder, view, draws);
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  uint64_t one_side = 0, inside_missing = 0, inside_twice = 0;
  for (uint32_t y = 0; y < view.height; ++y) {
    for (uint32_t x = 0; x < view.width; ++x) {
      const size_t i = size_t{y} * view.width + x;
      one_side += counts[0].is_covered[i] != counts[1].is_covered[i] ? 1 : 0;
      const double from_middle = std::hypot(x + 0.5 - 0.5 * view.width, y + 0.5 - 0.5 * view.height);
      if (from_middle > disc_pixels - 2) continue;
      for (const CoverCount& count : counts) {
        inside_missing += count.is_covered[i] ? 0 : 1;
        inside_twice += count.is_twice[i] ? 1 : 0;
      }
    }
  }
  char took[32];
  std::snprintf(took, sizeof took, "%.0f s", seconds);
  note(name, std::to_string(soup.indices.size() / 3) + " triangles, " + std::to_string(counts[0].covered) +
                 " pixels covered by front faces, " + std::to_string(counts[1].covered) + " by back faces; leaks " +
                 std::to_string(inside_missing) + ", covered twice " + std::to_string(inside_twice) +
                 " (in the two outermost pixels " + std::to_string(counts[0].twice + counts[1].twice - inside_twice) +
                 "), covered from one side only " + std::to_string(one_side) + "; " + took);
  CHECK(inside_missing == 0);
  CHECK(inside_twice == 0);
  CHECK(one_side == 0);  // a closed surface has as many front as back faces at every point, also after snapping
  CHECK(static_cast<double>(counts[0].covered) == Approx(3.14159265 * disc_pixels * disc_pixels).epsilon(0.01));
}

View sphere_view(uint32_t side) {
  return orthographic(look_at({0.4, 0.7, 2.9}, {0, 0, 0}, side, side), 1.1, 0.5, 8);
}

const std::vector<NamedCase>& hard_cases() {
  static const std::vector<NamedCase> kCases{
      {"slivers", slivers},
      {"sliver strip", strip},
      {"degenerate and duplicate triangles", degenerate_triangles},
      {"coincident surfaces", coincident},
      {"whole screen", whole_screen},
      {"edge-on", edge_on},
      {"near plane", near_plane},
      {"behind the camera", behind},
      {"vertex at the eye", vertex_at_eye},
      {"vertices at pixel centres", pixel_centres},
      {"fans", fans},
      {"sub-pixel sphere", subpixel_sphere},
      {"georeferenced by translation", georeferenced},
      {"georeferenced float32", georeferenced_floats},
      {"scale 1e-6", [] { return scaled(1e-6); }},
      {"scale 1e6", [] { return scaled(1e6); }},
      {"flat and single-point meshes", flat_and_points},
      {"depth range", depth_range},
      {"transforms", transforms},
      {"odd sizes", odd_sizes},
  };
  return kCases;
}

HardCase make_hard_case(const std::string& name) {
  for (const NamedCase& hard : hard_cases())
    if (name == hard.name) return hard.make();
  FAIL("no hard case " << name);
  return {};
}

HardCase in_clusters(const HardCase& hard, Clusters clusters) {
  HardCase out;
  out.builder.materials = hard.builder.materials;
  for (size_t i = 0; i < hard.soups.size(); ++i) {
    Encoding encoding = hard.encodings[i];
    encoding.clusters = clusters;
    if (encoding.float32) {
      const format::MeshRecord& mesh = hard.builder.meshes[i];
      const auto chosen = must(format::choose_lattice(mesh.bounds_min, mesh.bounds_max, 20, 0));
      encoding.float32 = false;
      encoding.exponent = chosen.exponent;
    }
    out.mesh(hard.soups[i], encoding);
  }
  out.builder.matrices = hard.builder.matrices;
  out.builder.instances = hard.builder.instances;
  out.views = hard.views;
  return out;
}

}  // namespace scree::tests
