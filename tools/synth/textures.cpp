#include "tools/synth/textures.h"

#include <algorithm>
#include <cmath>
#include <span>

#include <png.h>

#include "runtime/images/jpeg_writer.h"
#include "runtime/threads/parallel.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {
namespace {

constexpr int kJpegQuality = 90;

struct Color {
  double r, g, b;  // sRGB, 0 to 255
};

Color mix(const Color& a, const Color& b, double t) {
  return {synth::mix(a.r, b.r, t), synth::mix(a.g, b.g, t), synth::mix(a.b, b.b, t)};
}
Color operator*(const Color& a, double t) {
  return {a.r * t, a.g * t, a.b * t};
}

/// Value noise in [-1, 1] with `px` by `py` cells over the unit square, periodic.
double tile_noise(uint32_t seed, uint32_t px, uint32_t py, double u, double v) {
  const double x = (u - std::floor(u)) * px, y = (v - std::floor(v)) * py;
  const uint32_t i = static_cast<uint32_t>(x) % px, j = static_cast<uint32_t>(y) % py;
  const uint32_t i1 = (i + 1) % px, j1 = (j + 1) % py;
  const double wx = smooth_step(x - std::floor(x)), wy = smooth_step(y - std::floor(y));
  return 2.0 * synth::mix(synth::mix(unit24(hash2(seed, i, j)), unit24(hash2(seed, i1, j)), wx),
                          synth::mix(unit24(hash2(seed, i, j1)), unit24(hash2(seed, i1, j1)), wx), wy) -
         1.0;
}

/// Octaves of tile_noise, halving in height and doubling in frequency; values approximately in [-1, 1].
double tile_fbm(uint32_t seed, uint32_t period, uint32_t octaves, double u, double v) {
  double sum = 0, height = 0.5;
  for (uint32_t o = 0; o < octaves; ++o, height *= 0.5, period *= 2)
    sum += height * tile_noise(seed + 101 * o, period, period, u, v);
  return sum;
}

/// The nearest points to a position, of one jittered point per cell; `period` cells per side. Distances in cells.
struct Cell {
  double nearest = 9, second = 9;
  double dx = 0, dy = 0;  // from the nearest point
  uint32_t id = 0;        // a hash of the nearest point's cell
};

Cell tile_cells(uint32_t seed, uint32_t period, double u, double v) {
  const double x = (u - std::floor(u)) * period, y = (v - std::floor(v)) * period;
  const int i = static_cast<int>(x), j = static_cast<int>(y), p = static_cast<int>(period);
  Cell cell;
  for (int dj = -1; dj <= 1; ++dj)
    for (int di = -1; di <= 1; ++di) {
      const uint32_t ci = static_cast<uint32_t>((i + di + p) % p), cj = static_cast<uint32_t>((j + dj + p) % p);
      const uint32_t id = hash2(seed, ci, cj);
      const double px = i + di + 0.1 + 0.8 * unit24(id), py = j + dj + 0.1 + 0.8 * unit24(hash32(id ^ 0x5bd1e995u));
      const double dx = x - px, dy = y - py, distance = std::sqrt(dx * dx + dy * dy);
      if (distance < cell.nearest) {
        cell.second = cell.nearest;
        cell.nearest = distance;
        cell.dx = dx;
        cell.dy = dy;
        cell.id = id;
      } else {
        cell.second = std::min(cell.second, distance);
      }
    }
  return cell;
}

/// Round patches of lichen on some cells of a lattice: 0 to 1.
double lichen(uint32_t seed, uint32_t period, double share, double u, double v) {
  const double wobble_u = 0.35 / period * tile_fbm(seed + 11, period * 2, 3, u, v);
  const double wobble_v = 0.35 / period * tile_fbm(seed + 12, period * 2, 3, u, v);
  const Cell cell = tile_cells(seed, period, u + wobble_u, v + wobble_v);
  if (unit24(hash32(cell.id)) >= share) return 0;
  const double radius = 0.18 + 0.22 * unit24(hash32(cell.id + 1));
  const double holes = 0.5 + 0.9 * tile_fbm(seed + 13, period * 6, 3, u, v);
  return ramp(radius, radius * 0.7, cell.nearest) * std::clamp(holes + 0.35, 0.0, 1.0);
}

Color granite(double u, double v) {
  const double cloud = tile_fbm(1, 3, 6, u, v);
  Color color = Color{162, 160, 155} * (1.0 + 0.34 * cloud);
  color = mix(color, {176, 158, 138}, 0.45 * ramp(-0.1, 0.5, tile_fbm(2, 2, 4, u, v)));       // weathered, warmer
  color = mix(color, {54, 54, 58}, 0.65 * ramp(0.35, 0.6, tile_noise(3, 300, 300, u, v)));    // mica
  color = mix(color, {214, 208, 198}, 0.6 * ramp(0.35, 0.7, tile_noise(4, 220, 220, u, v)));  // feldspar
  const double warp = 0.02 * tile_fbm(5, 6, 4, u, v);
  const Cell crack = tile_cells(6, 5, u + warp, v - warp);
  color = color * (1.0 - 0.45 * ramp(0.035, 0.0, crack.second - crack.nearest) * ramp(-0.1, 0.2, cloud));
  color = mix(color, {168, 170, 128}, 0.75 * lichen(20, 6, 0.55, u, v));
  return mix(color, {188, 142, 62}, 0.8 * lichen(30, 17, 0.16, u, v));
}

Color sandstone(double u, double v) {
  const double warp = 0.06 * tile_fbm(41, 3, 4, u, v);
  const double band = tile_noise(42, 1, 13, u, v + warp) + 0.5 * tile_noise(43, 2, 41, u, v + warp);
  Color color = mix({156, 134, 108}, {202, 184, 154}, 0.5 + 0.45 * band);
  color = color * (1.0 + 0.28 * tile_fbm(44, 5, 6, u, v));
  color = mix(color, {142, 102, 74}, 0.55 * ramp(0.12, 0.45, tile_fbm(45, 3, 5, u, v)));  // iron
  color = color * (1.0 - 0.2 * ramp(0.3, 0.8, tile_noise(46, 210, 170, u, v)));           // pits
  color = mix(color, {120, 122, 110}, 0.6 * lichen(50, 7, 0.4, u, v));
  return mix(color, {206, 204, 186}, 0.6 * lichen(60, 15, 0.18, u, v));
}

Color slate(double u, double v) {
  const double warp = 0.03 * tile_fbm(71, 4, 4, u, v);
  const double cleavage = tile_noise(72, 4, 60, u, v + warp) + 0.6 * tile_noise(73, 10, 150, u, v + warp);
  Color color = Color{122, 124, 126} * (1.0 + 0.13 * cleavage + 0.34 * tile_fbm(74, 3, 6, u, v));
  color = mix(color, {146, 130, 110}, 0.5 * ramp(0.1, 0.5, tile_fbm(75, 2, 5, u, v)));  // rust in the joints
  const Cell vein = tile_cells(76, 3, u + 2 * warp, v - warp);
  color =
      mix(color, {196, 196, 190},
          0.55 * ramp(0.02, 0.004, vein.second - vein.nearest) * ramp(0.02, 0.25, tile_fbm(77, 2, 3, u, v)));  // quartz
  return mix(color, {158, 166, 138}, 0.75 * lichen(80, 9, 0.45, u, v));
}

/// Adds pebbles of one size to `color`, lit from the upper left, with a dark rim where they lie in the soil.
Color pebbles(Color color, uint32_t seed, uint32_t period, double share, double u, double v) {
  const double warp = 0.25 / period * tile_fbm(seed + 5, period * 2, 2, u, v);
  const Cell cell = tile_cells(seed, period, u + warp, v + warp);
  if (unit24(hash32(cell.id)) >= share) return color;
  const double radius = 0.26 + 0.2 * unit24(hash32(cell.id + 1));
  const double tone = unit24(hash32(cell.id + 2)), warmth = unit24(hash32(cell.id + 3));
  Color stone = mix(Color{104, 102, 100}, Color{172, 166, 156}, tone);
  stone = mix(stone, {166, 138, 104}, 0.5 * warmth * warmth);
  const double light =
      1.0 - 0.34 * (cell.dx + cell.dy) / radius + 0.14 * tile_noise(seed + 6, period * 6, period * 6, u, v);
  color = color * (1.0 - 0.5 * ramp(radius * 1.35, radius, cell.nearest));
  return mix(color, stone * light, ramp(radius, radius * 0.86, cell.nearest));
}

Color ground(double u, double v) {
  Color color = Color{132, 120, 102} * (1.0 + 0.4 * tile_fbm(91, 4, 7, u, v));
  const double green = ramp(0.02, 0.3, tile_fbm(92, 3, 5, u, v) + 0.25 * tile_fbm(93, 24, 3, u, v));
  color = mix(color, Color{108, 112, 68} * (1.0 + 0.6 * tile_fbm(94, 64, 4, u, v)), 0.75 * green);
  color = pebbles(color, 100, 110, 0.55, u, v);
  color = pebbles(color, 110, 64, 0.6, u, v);
  color = pebbles(color, 120, 30, 0.5, u, v);
  return pebbles(color, 130, 14, 0.3, u, v);
}

Color texel(TextureKind kind, double u, double v) {
  constexpr Color (*kColors[])(double, double) = {granite, sandstone, slate, ground};
  return kColors[static_cast<size_t>(kind)](u, v);
}

uint8_t to_byte(double value) {
  return static_cast<uint8_t>(std::clamp(value, 0.0, 255.0) + 0.5);
}

/// Uses the Huffman tables of T.81, because optimised tables are made only for pictures that are not too large.
Result<std::vector<std::byte>> encode_jpeg(uint32_t size, const std::vector<uint8_t>& rgb) {
  runtime::JpegCoding coding;
  coding.width = coding.height = size;
  coding.components[0].h = coding.components[0].v = 2;
  for (size_t i = 1; i < 3; ++i) coding.components[i].h = coding.components[i].v = 1;
  coding.quality = kJpegQuality;
  coding.has_own_tables = false;
  runtime::JpegWriter writer = SCREE_TRY(runtime::JpegWriter::create(coding));
  const std::span<const uint8_t> pixels(rgb);
  for (uint64_t y = 0; y < size; ++y) SCREE_TRY(writer.row(pixels.subspan(3 * y * size, 3 * uint64_t{size})));
  return writer.finish();
}

/// JPEG of quality 90, 4:2:0, or PNG. Errors kMemory, kFormat (with the library's message).
Result<std::vector<std::byte>> encode_image(format::ImageCodec codec, uint32_t size, const std::vector<uint8_t>& rgb) {
  if (codec == format::ImageCodec::kJpeg) return encode_jpeg(size, rgb);
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = size;
  image.height = size;
  image.format = PNG_FORMAT_RGB;
  png_alloc_size_t bytes = 0;
  const auto failed = [&] { return Error{ErrorCode::kFormat, std::string("encoding a PNG: ") + image.message}; };
  if (png_image_write_to_memory(&image, nullptr, &bytes, 0, rgb.data(), 0, nullptr) == 0) return failed();
  std::vector<std::byte> out(bytes);
  if (png_image_write_to_memory(&image, out.data(), &bytes, 0, rgb.data(), 0, nullptr) == 0) return failed();
  out.resize(bytes);
  return out;
}

}  // namespace

Result<std::vector<uint8_t>> make_texture(TextureKind kind, uint32_t size, uint32_t threads,
                                          const std::atomic<bool>* stop) {
  std::vector<uint8_t> rgb(uint64_t{size} * size * 3);
  runtime::parallel_for(size, thread_count(threads, size), [&](uint64_t y) {
    if (tools::is_stopped(stop)) return;
    for (uint64_t x = 0; x < size; ++x) {
      const Color color = texel(kind, (static_cast<double>(x) + 0.5) / size, (static_cast<double>(y) + 0.5) / size);
      uint8_t* out = &rgb[(y * size + x) * 3];
      out[0] = to_byte(color.r);
      out[1] = to_byte(color.g);
      out[2] = to_byte(color.b);
    }
  });
  SCREE_TRY(tools::check_stop(stop));
  return rgb;
}

Result<uint32_t> add_texture(tools::GltfWriter& writer, const TextureRecipe& recipe, uint32_t threads,
                             const std::atomic<bool>* stop) {
  const std::vector<uint8_t> rgb = SCREE_TRY(make_texture(recipe.kind, recipe.size, threads, stop));
  const std::vector<std::byte> file =
      SCREE_TRY_AT("texture " + recipe.name, encode_image(recipe.codec, recipe.size, rgb));
  const uint32_t image = SCREE_TRY(writer.add_image(recipe.name, recipe.codec, file));
  return writer.add_texture(trilinear(image, recipe.name));
}

}  // namespace scree::synth
