#include "tools/compare/images.h"

#include <algorithm>
#include <cmath>

#include "runtime/files/mapped_file.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"

namespace scree::compare {
namespace {

struct Rgb {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> pixels;  // 3 bytes each
  std::vector<uint8_t> alpha;
};

Result<Rgb> read_picture(const std::string& path) {
  const auto map = SCREE_TRY(runtime::MappedFile::open(path));
  const runtime::Image image = SCREE_TRY_AT(path, runtime::decode_image(map.bytes()));
  if (!image.warning.empty()) return Error{ErrorCode::kFormat, path + ": " + image.warning};
  Rgb out{image.width, image.height, {}, {}};
  out.pixels.reserve(image.rgba.size() / 4 * 3);
  out.alpha.reserve(image.rgba.size() / 4);
  for (size_t i = 0; i < image.rgba.size(); i += 4) {
    for (size_t c = 0; c < 3; ++c)
      out.pixels.push_back(static_cast<uint8_t>((image.rgba[i + c] * image.rgba[i + 3] + 127) / 255));
    out.alpha.push_back(image.rgba[i + 3]);
  }
  return out;
}

}  // namespace

Result<PictureReport> compare_pictures(const std::string& a_path, const std::string& b_path, double pixels_per_degree,
                                       uint32_t threads) {
  const Rgb a = SCREE_TRY(read_picture(a_path));
  const Rgb b = SCREE_TRY(read_picture(b_path));
  if (a.width != b.width || a.height != b.height)
    return Error{ErrorCode::kRange, a_path + ": " + std::to_string(a.width) + " x " + std::to_string(a.height) +
                                        " pixels, but " + b_path + " has " + std::to_string(b.width) + " x " +
                                        std::to_string(b.height)};
  PictureReport report =
      compare_rgb({a.width, a.height, a.pixels}, {b.width, b.height, b.pixels}, pixels_per_degree, threads);
  for (size_t i = 0; i < a.alpha.size(); ++i) report.other_alpha += a.alpha[i] != b.alpha[i] ? 1 : 0;
  return report;
}

PictureReport compare_rgb(const RgbView& a, const RgbView& b, double pixels_per_degree, uint32_t threads) {
  PictureReport report{.width = a.width, .height = a.height};
  uint64_t squares = 0;  // sum over at most 2^28 pixels of at most 3 * 255^2
  for (size_t i = 0; i < a.rgb.size(); i += 3) {
    uint32_t largest = 0;
    for (size_t c = 0; c < 3; ++c) {
      const auto levels = static_cast<uint32_t>(std::abs(int{a.rgb[i + c]} - int{b.rgb[i + c]}));
      largest = std::max(largest, levels);
      squares += levels * levels;
    }
    report.differing += largest > 0 ? 1 : 0;
    report.max_levels = std::max(report.max_levels, largest);
  }
  const double mean = static_cast<double>(squares) / static_cast<double>(a.rgb.size());
  report.psnr = squares == 0 ? INFINITY : 10 * std::log10(255.0 * 255.0 / mean);
  report.flip = flip_map(a, b, pixels_per_degree, threads);
  double sum = 0;
  for (const float error : report.flip) sum += static_cast<double>(error);
  report.flip_mean = sum / static_cast<double>(report.flip.size());
  report.flip_max = static_cast<double>(*std::max_element(report.flip.begin(), report.flip.end()));
  return report;
}

Result<void> write_flip(const std::string& path, const PictureReport& report, format::Existing existing) {
  std::vector<uint8_t> pixels;
  pixels.reserve(3 * report.flip.size());
  for (const float error : report.flip) pixels.insert(pixels.end(), 3, static_cast<uint8_t>(std::lround(255 * error)));
  return runtime::write_png(path, {report.width, report.height, 3, pixels}, {}, existing);
}

}  // namespace scree::compare
