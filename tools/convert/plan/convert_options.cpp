#include "tools/convert/plan/convert_options.h"

#include <charconv>
#include <cmath>
#include <utility>

namespace scree::convert {
namespace {

Result<void> check_pixel_bound(const PixelBound& bound) {
  const auto usage = [](std::string message) { return Error{ErrorCode::kUsage, std::move(message)}; };
  const auto is_positive = [](double value) { return value > 0 && std::isfinite(value); };
  if (!is_positive(bound.pixels)) return usage("--max-error-pixels: not a number of pixels above 0");
  if (!is_positive(bound.distance)) return usage("--at-distance: not a length above 0");
  if (bound.width < 1 || bound.height < 1) return usage("--at-size: a picture without pixels");
  if (!(bound.fov_degrees > 0 && bound.fov_degrees < 180)) return usage("--at-fov: not above 0 and below 180 degrees");
  return {};
}

std::string describe_textures(const ImageOptions& options) {
  if (options.textures == Textures::kRaw) return "raw";
  return options.textures == Textures::kKeep ? "keep" : "jpeg:" + std::to_string(options.quality);
}

/// The shortest text that reads back as the same number.
std::string shortest(double number) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, number).ptr};
}

}  // namespace

bool bounds_error(const ConvertOptions& options) {
  return options.max_error > 0 || options.pixel_bound.pixels > 0;
}

Result<void> check_options(const ConvertOptions& options) {
  const auto usage = [](std::string message) { return Error{ErrorCode::kUsage, std::move(message)}; };
  if (options.position_bits < 8 || options.position_bits > format::kMaxPositionBits)
    return usage("--positions: " + std::to_string(options.position_bits) + " bits, expected 8 to " +
                 std::to_string(format::kMaxPositionBits));
  if (!(options.max_error >= 0) || !std::isfinite(options.max_error)) return usage("--max-error: not a length above 0");
  if (options.float32 && options.max_error > 0) return usage("--max-error and --positions float32 exclude each other");
  if (options.pixel_bound.pixels != 0) {
    if (options.max_error > 0 || options.float32)
      return usage("--max-error-pixels, --max-error and --positions float32 exclude each other");
    SCREE_TRY(check_pixel_bound(options.pixel_bound));
  }
  if (options.float32 && options.grid == Grid::kScene)
    return usage("--grid scene and --positions float32 exclude each other");
  for (const int level : {options.zstd_level, options.images.block_zstd_level})
    if (level < 0 || level > 22) return usage("--zstd: level " + std::to_string(level) + ", expected 0 to 22");
  if (options.images.quality < 1 || options.images.quality > 100)
    return usage("--textures: quality " + std::to_string(options.images.quality) + ", expected 1 to 100");
  if (options.threads > 4096) return usage("--threads: more than 4096");
  return {};
}

std::string describe_options(const ConvertOptions& options) {
  const PixelBound& bound = options.pixel_bound;
  std::string text = "--positions " + std::to_string(options.position_bits);
  if (options.float32) text = "--positions float32";
  if (options.max_error > 0) text = "--max-error " + shortest(options.max_error);
  if (bound.pixels > 0)
    text = "--max-error-pixels " + shortest(bound.pixels) + " --at-distance " + shortest(bound.distance) +
           " --at-size " + std::to_string(bound.width) + "x" + std::to_string(bound.height) + " --at-fov " +
           shortest(bound.fov_degrees);
  text += options.grid == Grid::kScene ? " --grid scene" : " --grid mesh";
  text += options.order == Order::kNone ? " --order none" : " --order fifo";
  text += options.encoding == Encoding::kClustered ? " --encoding clustered" : " --encoding indexed";
  if (options.encoding == Encoding::kClustered)
    text += options.clusters == tools::ClusterEffort::kBest ? " --clusters best" : " --clusters fast";
  text += " --chunk-triangles " + std::to_string(options.chunk_triangles);
  if (options.zstd_level != 0 || options.images.block_zstd_level != ImageOptions().block_zstd_level)
    text += " --zstd " + std::to_string(options.zstd_level);
  text += " --textures " + describe_textures(options.images);
  if (options.normals != Normals::kAuto)
    text += options.normals == Normals::kAlways ? " --normals always" : " --normals never";
  if (options.source_ids) text += " --source-ids";
  if (options.drop_nonfinite) text += " --drop-nonfinite";
  if (!options.weld) text += " --no-weld";
  if (!options.share) text += " --no-share";
  if (options.images.keep_going) text += " --keep-going";
  if (!options.exclude.empty()) text += " --exclude " + options.exclude;
  return text;
}

}  // namespace scree::convert
