#include "tools/gltf/materials.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "format/bytes.h"

namespace scree::convert {
namespace {

using format::kNone;

// What the first bytes of an image file say.
struct ImageKind {
  std::string_view name;  // empty: none known
  std::optional<format::ImageCodec> codec;
};

ImageKind sniff(std::string_view head) {
  const auto starts = [&](std::string_view magic, size_t offset = 0) {
    return head.size() >= offset + magic.size() && head.substr(offset, magic.size()) == magic;
  };
  using namespace std::string_view_literals;
  if (starts("\x89PNG\r\n\x1a\n"sv)) return {"PNG", format::ImageCodec::kPng};
  if (starts("\xff\xd8\xff"sv)) return {"JPEG", format::ImageCodec::kJpeg};
  if (starts("RIFF"sv) && starts("WEBP"sv, 8)) return {"WebP", {}};
  if (starts("\xabKTX 20\xbb"sv)) return {"KTX2", format::ImageCodec::kBlocks};
  if (starts("\xabKTX 11\xbb"sv)) return {"KTX", {}};
  if (starts("DDS "sv)) return {"DDS", format::ImageCodec::kBlocks};
  if (starts("sB"sv) || starts("Bs"sv)) return {"Basis", {}};
  if (starts("GIF8"sv)) return {"GIF", {}};
  if (starts("BM"sv)) return {"BMP", {}};
  if (starts("ftypavif"sv, 4)) return {"AVIF", {}};
  if (starts("#?RADIANCE"sv)) return {"Radiance HDR", {}};
  if (starts("II*\0"sv) || starts("MM\0*"sv)) return {"TIFF", {}};
  return {};
}

std::optional<format::Wrap> wrap_of(int32_t number) {
  switch (number) {
    case 10497:
      return format::Wrap::kRepeat;
    case 33648:
      return format::Wrap::kMirror;
    case 33071:
      return format::Wrap::kClamp;
    default:
      return std::nullopt;
  }
}

bool is_filter(int32_t number, bool minifying) {
  return number == 0 || number == 9728 || number == 9729 || (minifying && number >= 9984 && number <= 9987);
}

class MaterialMaker {
 public:
  MaterialMaker(const GltfDocument& document, GltfBuffers& buffers, bool keep_going, SourceScene& scene)
      : document_(document),
        buffers_(buffers),
        keep_going_(keep_going),
        scene_(scene),
        image_places_(document.images.size(), kUnknown),
        texture_places_(document.textures.size(), kUnknown) {}

  Result<format::MaterialRecord> record(const DocMaterial& from, bool& textured) {
    format::MaterialRecord to{};
    to.texture = kNone;
    for (size_t i = 0; i < 4; ++i) to.base_color[i] = static_cast<float>(from.base_color[i]);
    to.uv_scale[0] = to.uv_scale[1] = 1.0f;
    // Where a blended surface shows more of itself than of what lies behind it.
    to.alpha_cutoff = from.alpha_blend ? 0.5f : static_cast<float>(from.alpha_cutoff);
    to.flags = (from.double_sided ? format::kMaterialDoubleSided : 0u) | (from.unlit ? format::kMaterialUnlit : 0u) |
               (from.alpha_mask ? format::kMaterialAlphaMask : 0u) |
               (from.alpha_blend ? format::kMaterialAlphaBlend : 0u);
    textured = false;
    if (from.base_texture.texture != kAbsent) {
      auto place = texture(from.base_texture.texture);
      if (!place) return place.error();
      textured = *place != kNone;
      if (textured) {
        to.texture = *place;
        for (size_t i = 0; i < 2; ++i) {
          to.uv_offset[i] = static_cast<float>(from.base_texture.offset[i]);
          to.uv_scale[i] = static_cast<float>(from.base_texture.scale[i]);
        }
        to.uv_rotation = static_cast<float>(from.base_texture.rotation);
      }
    }
    for (const float value : {to.base_color[0], to.base_color[1], to.base_color[2], to.base_color[3], to.uv_offset[0],
                              to.uv_offset[1], to.uv_scale[0], to.uv_scale[1], to.uv_rotation, to.alpha_cutoff}) {
      if (!std::isfinite(value)) return Error{ErrorCode::kRange, "a factor that no float holds"};
    }
    // glTF has colour factors from 0 to 1; some writers' arithmetic goes an ulp past 1, and export would write that on.
    for (float& value : to.base_color) value = std::clamp(value, 0.0f, 1.0f);
    return to;
  }

  // One line a kind: the same format is often used by every texture of a scene.
  void warn() {
    for (const auto& [what, count] : dropped_) {
      scene_.warnings.push_back(std::to_string(count) + (count == 1 ? " texture is " : " textures are ") + what +
                                " and left out: its material keeps the colour factor only");
    }
    uint64_t unused = 0;
    for (const uint32_t place : image_places_) unused += place == kUnknown ? 1 : 0;
    if (unused > 0) scene_.left_out.push_back({"images not used for base colour", unused, unused_bytes(), 0});
    const auto textures = std::count(texture_places_.begin(), texture_places_.end(), kUnknown);
    if (textures > 0) scene_.left_out.push_back({"unused textures", static_cast<uint64_t>(textures), 0, 0});
  }

 private:
  static constexpr uint32_t kUnknown = kNone - 1;  // not looked at yet

  // Place in SourceScene::textures, or kNone where its image cannot be drawn.
  Result<uint32_t> texture(int32_t index) {
    uint32_t& slot = texture_places_[static_cast<size_t>(index)];
    if (slot != kUnknown) return slot;
    auto made = make_texture(document_.textures[static_cast<size_t>(index)]);
    if (!made) return at("texture " + std::to_string(index), made.error());
    slot = *made;
    return slot;
  }

  Result<uint32_t> make_texture(const DocTexture& from) {
    NamedTexture to;
    to.name = from.name;
    DocSampler sampler;
    if (from.sampler != kAbsent) sampler = document_.samplers[static_cast<size_t>(from.sampler)];
    const auto wrap_s = wrap_of(sampler.wrap_s);
    const auto wrap_t = wrap_of(sampler.wrap_t);
    if (!wrap_s || !wrap_t || !is_filter(sampler.mag_filter, false) || !is_filter(sampler.min_filter, true)) {
      return Error{ErrorCode::kRange,
                   "sampler " + std::to_string(from.sampler) + ": a wrap mode or filter glTF does not have"};
    }
    to.record.wrap_s = *wrap_s;
    to.record.wrap_t = *wrap_t;
    to.record.mag_filter = static_cast<uint16_t>(sampler.mag_filter);
    to.record.min_filter = static_cast<uint16_t>(sampler.min_filter);

    // The source is also the fallback of an extension's image; the latter is tried where there is no fallback.
    uint32_t place = kNone;
    std::string why = "without an image";
    for (const int32_t source : {from.source, from.other_source}) {
      if (source == kAbsent || place != kNone) continue;
      auto found = image(source, why);
      if (!found) return found.error();
      place = *found;
    }
    if (place == kNone) {
      drop(why);
      return kNone;
    }
    to.record.image = place;
    scene_.textures.push_back(std::move(to));
    return static_cast<uint32_t>(scene_.textures.size() - 1);
  }

  // Place in SourceScene::images, or kNone with the reason in `why`.
  Result<uint32_t> image(int32_t index, std::string& why) {
    const size_t number = static_cast<size_t>(index);
    if (reasons_.empty()) reasons_.resize(document_.images.size());
    uint32_t& slot = image_places_[number];
    if (slot == kUnknown) {
      auto made = make_image(document_.images[number], reasons_[number]);
      if (!made) return at("image " + std::to_string(index), made.error());
      slot = *made;
    }
    if (slot == kNone) why = reasons_[number];
    return slot;
  }

  Result<uint32_t> make_image(const DocImage& from, std::string& reason) {
    auto bytes = buffers_.image(from);
    if (!bytes && keep_going_ && bytes.error().code == ErrorCode::kFile) {
      reason = "missing (" + bytes.error().message + ")";
      return kNone;
    }
    if (!bytes) return bytes.error();
    std::array<char, 12> head{};
    const size_t head_bytes = static_cast<size_t>(std::min<uint64_t>(bytes->bytes, head.size()));
    if (auto read = bytes->source->read(bytes->offset, std::as_writable_bytes(std::span(head).first(head_bytes)));
        !read)
      return read.error();
    const ImageKind kind = sniff({head.data(), head_bytes});
    if (kind.name.empty()) {
      return Error{ErrorCode::kFormat, bytes->bytes == 0
                                           ? "is empty"
                                           : "is no image file of a known kind, expected PNG, JPEG, KTX2 or DDS"};
    }
    if (!kind.codec) {
      reason = std::string(kind.name);
      return kNone;
    }
    SourceImage image;
    image.name = from.name.empty() && !from.is_data ? from.uri : from.name;
    image.codec = *kind.codec;
    image.source = bytes->source;
    image.offset = bytes->offset;
    image.bytes = bytes->bytes;
    scene_.images.push_back(std::move(image));
    return static_cast<uint32_t>(scene_.images.size() - 1);
  }

  void drop(const std::string& why) {
    for (auto& [what, count] : dropped_) {
      if (what == why) {
        ++count;
        return;
      }
    }
    dropped_.emplace_back(why, 1);
  }

  // Of images in buffer views; the sizes of files that are not used are not looked up.
  uint64_t unused_bytes() const {
    uint64_t sum = 0;
    for (size_t i = 0; i < document_.images.size(); ++i) {
      const int32_t view = document_.images[i].view;
      if (image_places_[i] != kUnknown || view == kAbsent || static_cast<size_t>(view) >= document_.views.size())
        continue;
      sum = format::checked_add(sum, document_.views[static_cast<size_t>(view)].bytes).value_or(sum);
    }
    return sum;
  }

  const GltfDocument& document_;
  GltfBuffers& buffers_;
  bool keep_going_;
  SourceScene& scene_;
  std::vector<uint32_t> image_places_;
  std::vector<uint32_t> texture_places_;
  std::vector<std::string> reasons_;
  std::vector<std::pair<std::string, uint64_t>> dropped_;
};

void warn_of_blending(const GltfDocument& document, const std::vector<bool>& used, SourceScene& scene) {
  uint64_t blended = 0;
  for (size_t i = 0; i < document.materials.size(); ++i)
    blended += used[i] && document.materials[i].alpha_blend ? 1 : 0;
  if (blended == 0) return;
  scene.warnings.push_back("alpha blending of " + std::to_string(blended) +
                           (blended == 1 ? " material" : " materials") + " is left out: drawn where alpha is at least 0.5");
  scene.left_out.push_back({"alpha blending", blended, 0, 0});
}

}  // namespace

Result<MaterialPlan> make_materials(const GltfDocument& document, const std::vector<bool>& used, GltfBuffers& buffers,
                                    bool keep_going, SourceScene& scene) {
  MaterialPlan plan;
  plan.place.assign(document.materials.size(), kNone);
  plan.textured.assign(document.materials.size(), false);
  MaterialMaker maker(document, buffers, keep_going, scene);
  uint64_t unused = 0;
  for (size_t i = 0; i < document.materials.size(); ++i) {
    if (!used[i]) {
      ++unused;
      continue;
    }
    bool textured = false;
    auto record = maker.record(document.materials[i], textured);
    if (!record) return at("material " + std::to_string(i), record.error());
    plan.place[i] = static_cast<uint32_t>(scene.materials.size());
    plan.textured[i] = textured;
    scene.materials.push_back({document.materials[i].name, *record});
  }
  if (unused > 0) scene.left_out.push_back({"unused materials", unused, 0, 0});
  maker.warn();
  warn_of_blending(document, used, scene);
  return plan;
}

}  // namespace scree::convert
