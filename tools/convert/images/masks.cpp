#include "tools/convert/images/masks.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "format/container/mip_levels.h"
#include "runtime/images/image.h"
#include "runtime/textures/mip_rows.h"

namespace scree::convert {
namespace {

using format::kNone;

constexpr uint32_t kLeastMaskSide = 16;  // texels; a smaller level has too few of them to keep the share

/// The alpha of an image, as 8-bit codes. The default is one opaque texel.
struct Alpha {
  uint32_t width = 1;
  uint32_t height = 1;
  std::vector<uint8_t> codes{255};
};

/// Whether the image becomes opaque instead of failing with this error.
bool is_tolerated(const Error& error, bool keep_going) {
  return keep_going && error.code != ErrorCode::kFile && error.code != ErrorCode::kMemory;
}

Result<Alpha> decode_alpha(const SourceScene& scene, uint32_t number, bool keep_going) {
  const SourceImage& image = scene.images[number];
  Alpha alpha;
  if (image.codec == format::ImageCodec::kJpeg) return alpha;
  const Result<runtime::Image> decoded = runtime::decode_image(image_file(image));
  if (!decoded && is_tolerated(decoded.error(), keep_going)) return alpha;
  if (!decoded) return at(image_place(scene, number), decoded.error());
  alpha.width = decoded->width;
  alpha.height = decoded->height;
  alpha.codes.resize(decoded->rgba.size() / 4);
  for (size_t i = 0; i < alpha.codes.size(); ++i) alpha.codes[i] = decoded->rgba[4 * i + 3];
  return alpha;
}

/// Memory for making one mask, in bytes: the file, the decoded image, its alpha, and the levels as floats and as bytes.
uint64_t mask_cost(const SourceImage& image) {
  const Result<runtime::ImageInfo> info = runtime::probe_image(image_head(image));
  return info ? image.bytes + 12 * uint64_t{info->width} * info->height : image.bytes;
}

MaskKind kind_of(uint32_t least, uint32_t most, const PlannedMask& mask) {
  if (mask.blends) return least == 255 ? MaskKind::kOpaque : most == 0 ? MaskKind::kClear : MaskKind::kMixed;
  const uint32_t threshold = mask.threshold;
  if (uint64_t{least} * 65536 >= threshold) return MaskKind::kOpaque;
  return uint64_t{most} * 65536 < threshold ? MaskKind::kClear : MaskKind::kMixed;
}

/// The smallest and the largest alpha of an image's texels; by default those of one opaque texel.
struct AlphaRange {
  uint32_t width = 1;
  uint32_t height = 1;
  uint32_t least = 255;
  uint32_t most = 255;
};

/// The range of the first rows of an image, until `suffices(range)` returns true.
template <class Suffices>
Result<AlphaRange> find_alpha_range(const SourceScene& scene, uint32_t number, bool keep_going,
                                    const Suffices& suffices) {
  const SourceImage& image = scene.images[number];
  if (image.codec == format::ImageCodec::kJpeg) return AlphaRange{};
  AlphaRange range;
  range.most = 0;
  const Result<runtime::ImageInfo> info = runtime::decode_rows(image_file(image), [&](const runtime::Image& rows) {
    for (size_t i = 3; i < rows.rgba.size(); i += 4) {
      range.least = std::min<uint32_t>(range.least, rows.rgba[i]);
      range.most = std::max<uint32_t>(range.most, rows.rgba[i]);
    }
    return !suffices(range);
  });
  if (!info && is_tolerated(info.error(), keep_going)) return AlphaRange{};
  if (!info) return at(image_place(scene, number), info.error());
  range.width = info->width;
  range.height = info->height;
  return range;
}

bool has_alpha(const Primitive& primitive) {
  return primitive.color && primitive.color->components == 4;
}

/// Whether the file has a mask for the material.
bool is_stored(const PlannedMask& mask) {
  return mask.of_colors || mask.textured == MaskKind::kMixed;
}

/// The texture from which a mask's levels are made. A mask of vertex colours has none; its record gets default values.
format::TextureRecord texture_of(const SourceScene& scene, const PlannedMask& mask, size_t material) {
  if (!mask.of_colors) return scene.textures[scene.materials[material].record.texture].record;
  format::TextureRecord none{};
  none.image = kNone;
  none.mag_filter = format::kFilterNearest;
  return none;
}

/// Writes a level's codes to `out`: `level` scaled so that `passing` of its texels reach `threshold`.
void keep_share(const std::vector<float>& level, uint64_t passing, uint32_t threshold, std::byte* out) {
  const auto least = static_cast<float>((threshold + 65535) / 65536);  // the smallest code that passes the test
  float scale = 1;
  if (passing > 0 && passing < level.size()) {
    std::vector<float> sorted = level;
    const auto place = sorted.begin() + static_cast<ptrdiff_t>(passing - 1);
    std::nth_element(sorted.begin(), place, sorted.end(), std::greater<float>());
    // Codes are rounded to nearest, so with this scale the value at `place` becomes `least`.
    if (*place > 0) scale = (least - 0.5f) / *place;
  }
  for (size_t i = 0; i < level.size(); ++i)
    out[i] = static_cast<std::byte>(std::clamp(level[i] * scale + 0.5f, 0.0f, 255.0f));
}

}  // namespace

MaskKind MaskPlan::kind(const Primitive& primitive) const {
  if (primitive.material == kNone) return MaskKind::kOpaque;
  const PlannedMask& mask = materials[primitive.material];
  if (mask.of_colors) return has_alpha(primitive) ? MaskKind::kMixed : MaskKind::kOpaque;
  return primitive.uv ? mask.textured : mask.plain;
}

uint64_t MaskPlan::bytes() const {
  uint64_t bytes = 0;
  for (const PlannedMask& mask : materials)
    if (is_stored(mask))
      bytes += format::mask_bytes(mask.width, mask.height, mask_level_count(mask.width, mask.height));
  return bytes;
}

uint32_t mask_threshold(float factor, float cutoff) {
  if (cutoff <= 0) return 0;
  const double sum = std::ceil(static_cast<double>(cutoff) / static_cast<double>(factor) * format::kMaxMaskThreshold);
  return sum <= format::kMaxMaskThreshold ? static_cast<uint32_t>(sum) : format::kMaxMaskThreshold + 1;
}

uint32_t mask_level_count(uint32_t width, uint32_t height) {
  uint32_t count = 1;
  while (std::max(width, height) >> count >= kLeastMaskSide) ++count;
  return count;
}

std::vector<std::byte> make_mask_levels(std::span<const uint8_t> alpha, uint32_t width, uint32_t height,
                                        uint32_t threshold) {
  const uint32_t count = mask_level_count(width, height);
  std::vector<std::byte> levels(format::mask_bytes(width, height, count));
  std::copy(alpha.begin(), alpha.end(), reinterpret_cast<uint8_t*>(levels.data()));
  const auto passes = static_cast<uint64_t>(
      std::count_if(alpha.begin(), alpha.end(), [&](uint8_t code) { return code * 65536u >= threshold; }));
  uint64_t offset = alpha.size();
  std::vector<std::vector<float>> codes(count);
  runtime::MipRows filter(width, height, count - 1,
                          [&](uint32_t number, uint32_t, std::span<const runtime::Texel> row) {
                            for (const runtime::Texel& texel : row) codes[number].push_back(texel[3] * 255.0f);
                          });
  std::vector<runtime::Texel> row(width);
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x)
      row[x] = {0, 0, 0, static_cast<float>(alpha[size_t{y} * width + x]) * (1.0f / 255.0f)};
    filter.push(row);
  }
  for (uint32_t l = 1; l < count; ++l) {
    const double share = static_cast<double>(passes) / static_cast<double>(alpha.size());
    const auto passing = static_cast<uint64_t>(std::lround(share * static_cast<double>(codes[l].size())));
    keep_share(codes[l], passing, threshold, levels.data() + offset);
    offset += codes[l].size();
  }
  return levels;
}

uint64_t largest_mask_bytes(const SourceScene& scene) {
  uint64_t largest = 0;
  for (const NamedMaterial& material : scene.materials) {
    const uint32_t texture = material.record.texture;
    if ((material.record.flags & format::kMaterialCutOut) == 0 || texture == kNone) continue;
    largest = std::max(largest, mask_cost(scene.images[scene.textures[texture].record.image]));
  }
  return largest;
}

Result<MaskPlan> plan_masks(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                            WorkerPool& pool, const std::function<void(uint64_t images)>& progress) {
  MaskPlan plan;
  plan.materials.resize(scene.materials.size());
  std::vector<bool> used(scene.materials.size()), has_places(scene.materials.size()),
      has_alphas(scene.materials.size());
  for (size_t i = 0; i < wanted.size(); ++i) {
    const Primitive& primitive = scene.primitives[i];
    if (!wanted[i] || primitive.material == kNone) continue;
    used[primitive.material] = true;
    if (primitive.uv) has_places[primitive.material] = true;
    if (has_alpha(primitive)) has_alphas[primitive.material] = true;
  }
  std::map<uint32_t, std::vector<size_t>> materials_of;  // by image
  for (size_t i = 0; i < scene.materials.size(); ++i) {
    const format::MaterialRecord& record = scene.materials[i].record;
    if (!used[i] || (record.flags & format::kMaterialCutOut) == 0) continue;
    PlannedMask& mask = plan.materials[i];
    mask.blends = (record.flags & format::kMaterialAlphaBlend) != 0;
    mask.threshold = mask_threshold(record.base_color[3], record.alpha_cutoff);
    mask.plain = mask.textured = kind_of(255, 255, mask);
    if (mask.blends) {
      // Programs without blending draw the surface as a mask with threshold one half.
      mask.threshold = std::clamp(mask.threshold, 1u, format::kMaxMaskThreshold);
      if (record.base_color[3] <= 0) mask.plain = mask.textured = MaskKind::kClear;
    }
    // If full alpha fails, every smaller alpha fails too, so the image is not decoded.
    if (record.texture != kNone && has_places[i] && mask.plain == MaskKind::kOpaque && mask.threshold > 0)
      materials_of[scene.textures[record.texture].record.image].push_back(i);
  }
  std::vector<uint32_t> images;
  for (const auto& entry : materials_of) images.push_back(entry.first);
  const std::vector<PlannedMask> masks = plan.materials;  // take() changes the plan
  const auto work = [&](uint64_t i, uint32_t) -> Result<AlphaRange> {
    // Once a mask hides some texels but not all, the other texels change nothing.
    return find_alpha_range(scene, images[i], options.keep_going, [&](const AlphaRange& range) {
      return std::ranges::all_of(materials_of.at(images[i]), [&](size_t material) {
        return kind_of(range.least, range.most, masks[material]) == MaskKind::kMixed;
      });
    });
  };
  const auto cost = [&](uint64_t i) { return mask_cost(scene.images[images[i]]); };
  const auto take = [&](uint64_t i, const AlphaRange& range) -> Result<void> {
    for (const size_t material : materials_of[images[i]]) {
      PlannedMask& mask = plan.materials[material];
      mask.textured = kind_of(range.least, range.most, mask);
      mask.width = range.width;
      mask.height = range.height;
    }
    progress(i + 1);
    return {};
  };
  SCREE_TRY(
      run_ordered<AlphaRange>(pool, images.size(), {2 * uint64_t{pool.threads()}, options.memory}, work, cost, take));
  for (size_t i = 0; i < plan.materials.size(); ++i) {
    PlannedMask& mask = plan.materials[i];
    if (has_alphas[i] && !mask.blends && mask.threshold > 0 && mask.textured == MaskKind::kOpaque &&
        mask.plain == MaskKind::kOpaque) {
      mask.of_colors = true;
      mask.width = mask.height = 1;
    }
    if (mask.textured == MaskKind::kMixed && std::max(mask.width, mask.height) > format::kMaxMaskSide)
      return Error{ErrorCode::kUnsupported, scene.file_name + ": an alpha mask of " + std::to_string(mask.width) +
                                                " x " + std::to_string(mask.height) + " texels, expected at most " +
                                                std::to_string(format::kMaxMaskSide) + " per side"};
  }
  return plan;
}

Result<std::vector<std::byte>> load_mask_levels(const SourceScene& scene, const MaskPlan& plan, size_t material,
                                                bool keep_going) {
  const PlannedMask& planned = plan.materials[material];
  const uint32_t image = texture_of(scene, planned, material).image;
  const Alpha alpha = SCREE_TRY(planned.of_colors ? Alpha{} : decode_alpha(scene, image, keep_going));
  if (alpha.width != planned.width || alpha.height != planned.height)
    return at(image_place(scene, image), Error{ErrorCode::kFile, "was changed while it was read"});
  return make_mask_levels(alpha.codes, alpha.width, alpha.height, planned.blends ? 0 : planned.threshold);
}

void uv_transform(const format::MaterialRecord& material, double matrix[2][3]) {
  const auto angle = static_cast<double>(material.uv_rotation);
  const double turn[2][2] = {{std::cos(angle), std::sin(angle)}, {-std::sin(angle), std::cos(angle)}};
  for (int c = 0; c < 2; ++c) {
    for (int k = 0; k < 2; ++k) matrix[c][k] = turn[c][k] * static_cast<double>(material.uv_scale[k]);
    matrix[c][2] = static_cast<double>(material.uv_offset[c]);
  }
}

Result<void> write_masks(const SourceScene& scene, const MaskPlan& plan, const std::vector<uint32_t>& materials,
                         const ImageOptions& options, int zstd_level, WorkerPool& pool, format::ContainerWriter& writer,
                         format::TableSet& tables) {
  // The levels depend on the threshold too, so materials share a page only if they have the same image and threshold.
  // Blended materials have no threshold and count as threshold 0.
  std::map<std::pair<uint32_t, uint32_t>, std::vector<size_t>> materials_of;  // by image and threshold
  for (size_t i = 0; i < materials.size(); ++i) {
    if (materials[i] == kNone || !is_stored(plan.materials[i])) continue;
    const uint32_t image = texture_of(scene, plan.materials[i], i).image;
    materials_of[{image, plan.materials[i].blends ? 0 : plan.materials[i].threshold}].push_back(i);
  }
  std::vector<std::pair<uint32_t, uint32_t>> keys;
  for (const auto& entry : materials_of) keys.push_back(entry.first);
  const auto work = [&](uint64_t i, uint32_t) -> Result<format::SealedPage> {
    std::vector<std::byte> levels =
        SCREE_TRY(load_mask_levels(scene, plan, materials_of.at(keys[i]).front(), options.keep_going));
    return format::seal_page(format::PageKind::kMask, std::move(levels), zstd_level);
  };
  const auto cost = [&](uint64_t i) {
    return keys[i].first != kNone ? mask_cost(scene.images[keys[i].first]) : uint64_t{1};
  };
  const auto take = [&](uint64_t i, format::SealedPage sealed) -> Result<void> {
    const uint32_t page = SCREE_TRY(writer.append(sealed));
    for (const size_t material : materials_of.at(keys[i])) {
      const PlannedMask& planned = plan.materials[material];
      const format::TextureRecord texture = texture_of(scene, planned, material);
      format::MaskRecord mask{};
      mask.material = materials[material];
      mask.page = page;
      mask.width = planned.width;
      mask.height = planned.height;
      mask.level_count = mask_level_count(planned.width, planned.height);
      mask.threshold = planned.threshold;
      mask.wrap_s = texture.wrap_s;
      mask.wrap_t = texture.wrap_t;
      mask.flags = (texture.mag_filter == format::kFilterNearest ? uint32_t{format::kMaskNearest} : 0) |
                   (planned.of_colors ? uint32_t{format::kMaskOfColors} : 0);
      uv_transform(scene.materials[material].record, mask.place);
      tables.masks.push_back(mask);
    }
    return {};
  };
  const Result<void> run = run_ordered<format::SealedPage>(
      pool, keys.size(), {2 * uint64_t{pool.threads()}, options.memory}, work, cost, take);
  std::sort(tables.masks.begin(), tables.masks.end(),
            [](const format::MaskRecord& a, const format::MaskRecord& b) { return a.material < b.material; });
  return run;
}

}  // namespace scree::convert
