#include "tools/gltf/materials.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "format/bytes.h"
#include "format/fail.h"
#include "runtime/images/image.h"

namespace scree::convert {
namespace {

using format::kNone;

// The kind of an image file by its first bytes.
struct ImageKind {
  std::string_view name;  // empty: unknown
  std::optional<format::ImageCodec> codec;
  bool is_webp = false;
};

ImageKind sniff(std::string_view head) {
  const auto starts = [&](std::string_view magic, size_t offset = 0) {
    return head.size() >= offset + magic.size() && head.substr(offset, magic.size()) == magic;
  };
  using namespace std::string_view_literals;
  if (starts("\x89PNG\r\n\x1a\n"sv)) return {"PNG", format::ImageCodec::kPng};
  if (starts("\xff\xd8\xff"sv)) return {"JPEG", format::ImageCodec::kJpeg};
  if (starts("RIFF"sv) && starts("WEBP"sv, 8)) return {"WebP", format::ImageCodec::kPng, true};
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
  if (number == 10497) return format::Wrap::kRepeat;
  if (number == 33648) return format::Wrap::kMirror;
  if (number == 33071) return format::Wrap::kClamp;
  return std::nullopt;
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

  /// The sets of texture coordinates that a material's textures use, or kNone. The first entry is the set of the first
  /// texture.
  using UvSets = std::array<uint32_t, 2>;

  Result<format::MaterialRecord> record(const DocMaterial& from, UvSets& sets) {
    format::MaterialRecord to{.texture = kNone};
    for (size_t i = 0; i < 4; ++i) to.base_color[i] = static_cast<float>(from.base_color[i]);
    to.uv_scale[0] = to.uv_scale[1] = 1.0f;
    // Programs without blending draw a blended surface where its alpha is at least one half.
    to.alpha_cutoff = from.alpha_blend ? 0.5f : static_cast<float>(from.alpha_cutoff);
    to.flags = (from.double_sided ? format::kMaterialDoubleSided : 0u) | (from.unlit ? format::kMaterialUnlit : 0u) |
               (from.alpha_mask ? format::kMaterialAlphaMask : 0u) |
               (from.alpha_blend ? format::kMaterialAlphaBlend : 0u);
    bool is_second = false;  // stays false: this texture is the first
    auto base = SCREE_TRY(placed(from.base_texture, sets, is_second));
    if (base.texture != kNone) {
      to.texture = base.texture;
      std::copy_n(base.uv_offset, 2, to.uv_offset);
      std::copy_n(base.uv_scale, 2, to.uv_scale);
      to.uv_rotation = base.uv_rotation;
    }
    for (const float value : {to.base_color[0], to.base_color[1], to.base_color[2], to.base_color[3], to.uv_offset[0],
                              to.uv_offset[1], to.uv_scale[0], to.uv_scale[1], to.uv_rotation, to.alpha_cutoff}) {
      if (!std::isfinite(value)) return Error{ErrorCode::kRange, "a factor outside the range of floats"};
    }
    // glTF's colour factors are 0 to 1. Rounding in some writers exceeds 1 by an ulp, and export would write that
    // again.
    for (float& value : to.base_color) value = std::clamp(value, 0.0f, 1.0f);
    return to;
  }

  /// The properties of a material beyond its base colour; nullopt if it is matt or unlit. Runs after record() and
  /// continues with its `sets`. `is_default`: whether its properties are glTF's defaults, of a rough metal.
  Result<std::optional<format::SurfaceRecord>> surface(const DocMaterial& from, UvSets& sets, bool& is_default) {
    is_default = false;
    if (from.unlit) return std::optional<format::SurfaceRecord>();
    format::SurfaceRecord to{};
    const auto share = [](double value) { return static_cast<float>(std::clamp(value, 0.0, 1.0)); };
    to.metallic = share(from.metallic);
    to.roughness = share(from.roughness);
    to.normal_scale = static_cast<float>(from.normal_scale);
    to.occlusion_strength = share(from.occlusion_strength);
    to.ior = static_cast<float>(from.ior == 0 ? 0 : std::max(from.ior, 1.0));
    to.specular = share(from.specular);
    for (size_t c = 0; c < 3; ++c) {
      to.emission[c] = static_cast<float>(std::max(from.emission[c], 0.0));
      to.specular_color[c] = static_cast<float>(std::max(from.specular_color[c], 0.0));
    }
    bool is_plain = (to.metallic == 0 || to.metallic == 1) && to.roughness == 1 && to.ior == 1.5f && to.specular == 1;
    for (size_t c = 0; c < 3; ++c) is_plain = is_plain && to.emission[c] == 0 && to.specular_color[c] == 1;
    for (size_t use = 0; use < format::kSurfaceUses; ++use) {
      bool is_second = false;
      auto made = SCREE_TRY(placed(from.textures[use], sets, is_second));
      if (is_second) to.second_uv |= 1u << use;
      to.textures[use] = made;
      is_plain = is_plain && made.texture == kNone;
    }
    for (const double value : {from.metallic, from.roughness, from.normal_scale, from.occlusion_strength, from.ior,
                               from.specular, from.emission[0], from.emission[1], from.emission[2],
                               from.specular_color[0], from.specular_color[1], from.specular_color[2]})
      if (!std::isfinite(static_cast<float>(value)))
        return Error{ErrorCode::kRange, "a factor outside the range of floats"};
    if (is_plain && to.metallic == 0) return std::optional<format::SurfaceRecord>();
    is_default = is_plain;
    return std::optional(to);
  }

  // One line per kind, because often all textures of a scene share one format.
  void warn() {
    for (const auto& [what, count] : dropped_) {
      scene_.warnings.push_back(std::to_string(count) + (count == 1 ? " texture is " : " textures are ") + what +
                                " and left out: its material keeps the factors only");
    }
    if (other_sets_ > 0)
      scene_.warnings.push_back(std::to_string(other_sets_) + (other_sets_ == 1 ? " texture uses" : " textures use") +
                                " a third set of texture coordinates of the material, and " +
                                (other_sets_ == 1 ? "is" : "are") + " left out");
    uint64_t unused = 0;
    for (const uint32_t place : image_places_) unused += place == kUnknown ? 1 : 0;
    if (unused > 0) scene_.left_out.push_back({"unused images", unused, unused_bytes(), 0});
    const auto textures = std::count(texture_places_.begin(), texture_places_.end(), kUnknown);
    if (textures > 0) scene_.left_out.push_back({"unused textures", static_cast<uint64_t>(textures), 0, 0});
  }

 private:
  static constexpr uint32_t kUnknown = kNone - 1;  // not read yet

  /// A texture as a material uses it, which may add to `sets`. Its texture is kNone if there is none, if it cannot be
  /// drawn, or if it uses a third set of texture coordinates.
  Result<format::SurfaceTexture> placed(const DocTextureUse& from, UvSets& sets, bool& is_second) {
    format::SurfaceTexture to{kNone, {0, 0}, {1, 1}, 0};
    if (from.texture == kAbsent) return to;
    const auto set =
        std::find_if(sets.begin(), sets.end(), [&](uint32_t known) { return known == kNone || known == from.uv_set; });
    if (set == sets.end()) {
      ++other_sets_;
      return to;
    }
    auto place = SCREE_TRY(texture(from.texture));
    if (place == kNone) return to;
    *set = from.uv_set;
    is_second = set != sets.begin();
    to.texture = place;
    for (size_t i = 0; i < 2; ++i) {
      to.uv_offset[i] = static_cast<float>(from.offset[i]);
      to.uv_scale[i] = static_cast<float>(from.scale[i]);
    }
    to.uv_rotation = static_cast<float>(from.rotation);
    for (const float value : {to.uv_offset[0], to.uv_offset[1], to.uv_scale[0], to.uv_scale[1], to.uv_rotation})
      if (!std::isfinite(value)) return Error{ErrorCode::kRange, "a texture transform outside the range of floats"};
    return to;
  }

  // Index in SourceScene::textures, or kNone if its image cannot be drawn.
  Result<uint32_t> texture(int32_t index) {
    uint32_t& slot = texture_places_[static_cast<size_t>(index)];
    if (slot != kUnknown) return slot;
    slot =
        SCREE_TRY_AT("texture " + std::to_string(index), make_texture(document_.textures[static_cast<size_t>(index)]));
    return slot;
  }

  Result<uint32_t> make_texture(const DocTexture& from) {
    NamedTexture to{.name = from.name};
    DocSampler sampler;
    if (from.sampler != kAbsent) sampler = document_.samplers[static_cast<size_t>(from.sampler)];
    const auto wrap_s = wrap_of(sampler.wrap_s);
    const auto wrap_t = wrap_of(sampler.wrap_t);
    if (!wrap_s || !wrap_t || !is_filter(sampler.mag_filter, false) || !is_filter(sampler.min_filter, true)) {
      return fail(ErrorCode::kRange, "sampler ", from.sampler, ": a wrap mode or filter that glTF does not define");
    }
    to.record.wrap_s = *wrap_s;
    to.record.wrap_t = *wrap_t;
    to.record.mag_filter = static_cast<uint16_t>(sampler.mag_filter);
    to.record.min_filter = static_cast<uint16_t>(sampler.min_filter);

    std::string why = "without an image";
    const int32_t source = best_source(from);
    const auto place = SCREE_TRY(source == kAbsent ? kNone : image(source, why));
    if (place == kNone) {
      drop(why);
      return kNone;
    }
    to.record.image = place;
    scene_.textures.push_back(std::move(to));
    return static_cast<uint32_t>(scene_.textures.size() - 1);
  }

  // Chooses among alternative images. It prefers block-compressed ones, which are kept and have mip levels, then a PNG
  // or JPEG, then a WebP or blocks of UASTC or BasisLZ, which must be decoded and take more bytes. The order of
  // DocTexture::sources decides between images of the same kind. If none is readable, the first is chosen, so that its
  // error is reported.
  int32_t best_source(const DocTexture& from) {
    std::array<int32_t, 4> sources = from.sources;
    const auto end = std::remove(sources.begin(), sources.end(), kAbsent);
    if (end - sources.begin() < 2) return sources[0];
    int32_t best = sources[0];
    uint32_t best_rank = kUnreadable;
    for (auto source = sources.begin(); source != end && best_rank > kBlockRank; ++source) {
      const uint32_t rank = rank_of(document_.images[static_cast<size_t>(*source)]);
      if (rank < best_rank) best = *source, best_rank = rank;
    }
    return best;
  }

  static constexpr uint32_t kBlockRank = 0, kPlainRank = 1, kDecodedRank = 2, kUnreadable = 3;

  uint32_t rank_of(const DocImage& from) {
    std::string ignored;
    const auto made = describe_image(from, ignored);
    if (!made || !*made) return kUnreadable;
    const SourceImage& found = **made;
    const auto read = [&](uint64_t offset, std::span<std::byte> out) {
      return found.source->read_alone(found.offset + offset, out);
    };
    const auto info = runtime::probe_decodable({found.bytes, read, runtime::ImageFile::kHeadBytes});
    if (!info) return kUnreadable;
    if (found.is_webp || info->is_decoded) return kDecodedRank;
    return found.codec == format::ImageCodec::kBlocks ? kBlockRank : kPlainRank;
  }

  // Index in SourceScene::images, or kNone with the reason in `why`.
  Result<uint32_t> image(int32_t index, std::string& why) {
    const size_t number = static_cast<size_t>(index);
    if (reasons_.empty()) reasons_.resize(document_.images.size());
    uint32_t& slot = image_places_[number];
    if (slot == kUnknown) {
      slot = SCREE_TRY_AT("image " + std::to_string(index), make_image(document_.images[number], reasons_[number]));
    }
    if (slot == kNone) why = reasons_[number];
    return slot;
  }

  Result<uint32_t> make_image(const DocImage& from, std::string& reason) {
    auto described = SCREE_TRY(describe_image(from, reason));
    if (!described) return kNone;
    scene_.images.push_back(std::move(*described));
    return static_cast<uint32_t>(scene_.images.size() - 1);
  }

  // Describes an image by its first bytes; nullopt if its kind is not supported, with the reason in `reason`.
  Result<std::optional<SourceImage>> describe_image(const DocImage& from, std::string& reason) {
    auto bytes = buffers_.image(from);
    if (!bytes && keep_going_ && bytes.error().code == ErrorCode::kFile) {
      reason = "missing (" + bytes.error().message + ")";
      return std::optional<SourceImage>();
    }
    if (!bytes) return bytes.error();
    std::array<char, 12> head{};
    const size_t head_bytes = static_cast<size_t>(std::min<uint64_t>(bytes->bytes, head.size()));
    SCREE_TRY(bytes->source->read(bytes->offset, std::as_writable_bytes(std::span(head).first(head_bytes))));
    const ImageKind kind = sniff({head.data(), head_bytes});
    if (kind.name.empty()) {
      return Error{ErrorCode::kFormat, bytes->bytes == 0
                                           ? "is empty"
                                           : "is no image file of a known kind, expected PNG, JPEG, WebP, KTX2 or DDS"};
    }
    if (!kind.codec) {
      reason = std::string(kind.name);
      return std::optional<SourceImage>();
    }
    SourceImage image{.name = from.name.empty() && !from.is_data ? from.uri : from.name,
                      .codec = *kind.codec,
                      .is_webp = kind.is_webp,
                      .source = bytes->source,
                      .offset = bytes->offset,
                      .bytes = bytes->bytes};
    return std::optional(std::move(image));
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

  // Bytes of unused images in buffer views. The sizes of unused files are not looked up.
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
  uint64_t other_sets_ = 0;  // textures with a third set of texture coordinates
  std::vector<std::pair<std::string, uint64_t>> dropped_;
};

}  // namespace

Result<MaterialPlan> make_materials(const GltfDocument& document, const std::vector<bool>& used, GltfBuffers& buffers,
                                    bool keep_going, SourceScene& scene) {
  MaterialPlan plan;
  plan.place.assign(document.materials.size(), kNone);
  plan.uv_sets.assign(document.materials.size(), {kNone, kNone});
  MaterialMaker maker(document, buffers, keep_going, scene);
  uint64_t unused = 0;
  bool all_default = true;
  for (size_t i = 0; i < document.materials.size(); ++i) {
    if (!used[i]) {
      ++unused;
      continue;
    }
    auto record = SCREE_TRY_AT("material " + std::to_string(i), maker.record(document.materials[i], plan.uv_sets[i]));
    bool is_default = false;
    auto surface = SCREE_TRY_AT("material " + std::to_string(i),
                                maker.surface(document.materials[i], plan.uv_sets[i], is_default));
    if (surface) all_default = all_default && is_default;
    plan.place[i] = static_cast<uint32_t>(scene.materials.size());
    scene.materials.push_back({document.materials[i].name, record, surface});
  }
  // If all materials have glTF's default properties (a rough metal), the writer stored base colours only, and the
  // surfaces are drawn matt.
  if (all_default)
    for (NamedMaterial& material : scene.materials) material.surface.reset();
  for (const NamedMaterial& material : scene.materials) {
    const auto mark = [&](uint32_t texture) { scene.images[scene.textures[texture].record.image].is_color = true; };
    if (material.record.texture != kNone) mark(material.record.texture);
    for (uint32_t use = 0; material.surface && use < format::kSurfaceUses; ++use)
      if (const uint32_t texture = material.surface->textures[use].texture; texture != kNone)
        if (format::is_color(static_cast<format::SurfaceUse>(use))) mark(texture);
  }
  if (unused > 0) scene.left_out.push_back({"unused materials", unused, 0, 0});
  maker.warn();
  return plan;
}

}  // namespace scree::convert
