#include "tools/gltf/document/schema.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>

namespace scree::convert {
namespace {

enum class Kind : uint8_t {
  kAny,
  kIndex,      // 0 to 2^31 - 1; tinygltf keeps indices as int
  kSize,       // 0 to 2^53: sizes, counts, offsets
  kSmallSize,  // 0 to 2^31 - 1: sizes that tinygltf keeps as int
  kNumber,
  kString,
  kBool,
  kObject,
  kObjects,  // array of objects
  kIndices,  // array of indices
  kNumbers,  // array of numbers
  kStrings,
  kIndexMap,   // object whose members are all indices
  kIndexMaps,  // array of these
};

enum class Presence : bool { kOptional, kRequired };
using enum Presence;

struct Member {
  constexpr Member() = default;
  constexpr Member(std::string_view its_name, Kind its_kind, Presence its_presence = kOptional)
      : name(its_name), kind(its_kind), presence(its_presence) {}
  /// An array of numbers.
  constexpr Member(std::string_view its_name, Kind its_kind, uint32_t its_length)
      : name(its_name), kind(its_kind), length(its_length) {}
  /// An object or an array of objects, with rules for its members: at most 32.
  template <size_t kCount>
  constexpr Member(std::string_view its_name, Kind its_kind, const Member (&its_members)[kCount],
                   Presence its_presence = kOptional)
      : name(its_name), kind(its_kind), members(its_members), member_count(kCount), presence(its_presence) {}

  std::string_view name;
  Kind kind = Kind::kAny;
  const Member* members = nullptr;  // kObject, kObjects
  uint32_t member_count = 0;
  uint32_t length = 0;  // kNumbers: exact length; 0: any
  Presence presence = kOptional;
};

constexpr size_t kMaxNames = 256;  // of attributes; the search is linear

// Materials, texture information, and extensions that scree reads.
constexpr Member kTransform[] = {{"offset", Kind::kNumbers, 2},
                                 {"scale", Kind::kNumbers, 2},
                                 {"rotation", Kind::kNumber},
                                 {"texCoord", Kind::kIndex}};
constexpr Member kTextureInfoExtensions[] = {{"KHR_texture_transform", Kind::kObject, kTransform}};
constexpr Member kTextureInfo[] = {{"index", Kind::kIndex, kRequired},
                                   {"texCoord", Kind::kIndex},
                                   {"extensions", Kind::kObject, kTextureInfoExtensions}};
constexpr Member kNormalTexture[] = {{"index", Kind::kIndex, kRequired},
                                     {"texCoord", Kind::kIndex},
                                     {"scale", Kind::kNumber},
                                     {"extensions", Kind::kObject, kTextureInfoExtensions}};
constexpr Member kOcclusionTexture[] = {{"index", Kind::kIndex, kRequired},
                                        {"texCoord", Kind::kIndex},
                                        {"strength", Kind::kNumber},
                                        {"extensions", Kind::kObject, kTextureInfoExtensions}};
constexpr Member kPbr[] = {{"baseColorFactor", Kind::kNumbers, 4},
                           {"baseColorTexture", Kind::kObject, kTextureInfo},
                           {"metallicRoughnessTexture", Kind::kObject, kTextureInfo},
                           {"metallicFactor", Kind::kNumber},
                           {"roughnessFactor", Kind::kNumber}};
constexpr Member kSpecularGlossiness[] = {{"diffuseFactor", Kind::kNumbers, 4},
                                          {"diffuseTexture", Kind::kObject, kTextureInfo},
                                          {"specularFactor", Kind::kNumbers, 3},
                                          {"glossinessFactor", Kind::kNumber}};
constexpr Member kEmissiveStrength[] = {{"emissiveStrength", Kind::kNumber}};
constexpr Member kIor[] = {{"ior", Kind::kNumber}};
constexpr Member kSpecular[] = {{"specularFactor", Kind::kNumber},
                                {"specularTexture", Kind::kObject, kTextureInfo},
                                {"specularColorFactor", Kind::kNumbers, 3},
                                {"specularColorTexture", Kind::kObject, kTextureInfo}};
constexpr Member kMaterialExtensions[] = {{"KHR_materials_unlit", Kind::kAny},
                                          {"KHR_materials_emissive_strength", Kind::kObject, kEmissiveStrength},
                                          {"KHR_materials_ior", Kind::kObject, kIor},
                                          {"KHR_materials_specular", Kind::kObject, kSpecular},
                                          {"KHR_materials_pbrSpecularGlossiness", Kind::kObject, kSpecularGlossiness}};
constexpr Member kMaterial[] = {{"name", Kind::kString},
                                {"pbrMetallicRoughness", Kind::kObject, kPbr},
                                {"normalTexture", Kind::kObject, kNormalTexture},
                                {"occlusionTexture", Kind::kObject, kOcclusionTexture},
                                {"emissiveTexture", Kind::kObject, kTextureInfo},
                                {"emissiveFactor", Kind::kNumbers, 3},
                                {"alphaMode", Kind::kString},
                                {"alphaCutoff", Kind::kNumber},
                                {"doubleSided", Kind::kBool},
                                {"extensions", Kind::kObject, kMaterialExtensions}};

constexpr Member kSource[] = {{"source", Kind::kIndex}};
constexpr Member kTextureExtensions[] = {{"EXT_texture_webp", Kind::kObject, kSource},
                                         {"KHR_texture_basisu", Kind::kObject, kSource},
                                         {"MSFT_texture_dds", Kind::kObject, kSource}};
constexpr Member kTexture[] = {{"name", Kind::kString},
                               {"sampler", Kind::kIndex},
                               {"source", Kind::kIndex},
                               {"extensions", Kind::kObject, kTextureExtensions}};
constexpr Member kSampler[] = {{"name", Kind::kString},
                               {"magFilter", Kind::kIndex},
                               {"minFilter", Kind::kIndex},
                               {"wrapS", Kind::kIndex},
                               {"wrapT", Kind::kIndex}};
constexpr Member kImage[] = {
    {"name", Kind::kString}, {"uri", Kind::kString}, {"mimeType", Kind::kString}, {"bufferView", Kind::kIndex}};

// Geometry.
constexpr Member kMeshoptFallback[] = {{"fallback", Kind::kBool}};
constexpr Member kBufferExtensions[] = {{"EXT_meshopt_compression", Kind::kObject, kMeshoptFallback},
                                        {"KHR_meshopt_compression", Kind::kObject, kMeshoptFallback}};
constexpr Member kBuffer[] = {{"name", Kind::kString},
                              {"uri", Kind::kString},
                              {"byteLength", Kind::kSize, kRequired},
                              {"chunk", Kind::kIndex},
                              {"extensions", Kind::kObject, kBufferExtensions}};
constexpr Member kMeshopt[] = {{"buffer", Kind::kIndex, kRequired},
                               {"byteOffset", Kind::kSize},
                               {"byteLength", Kind::kSize, kRequired},
                               {"byteStride", Kind::kSize, kRequired},
                               {"count", Kind::kSize, kRequired},
                               {"mode", Kind::kString, kRequired},
                               {"filter", Kind::kString}};
constexpr Member kBufferViewExtensions[] = {{"EXT_meshopt_compression", Kind::kObject, kMeshopt},
                                            {"KHR_meshopt_compression", Kind::kObject, kMeshopt}};
constexpr Member kBufferView[] = {{"name", Kind::kString},
                                  {"buffer", Kind::kIndex, kRequired},
                                  {"byteOffset", Kind::kSize},
                                  {"byteLength", Kind::kSize, kRequired},
                                  {"byteStride", Kind::kSize},
                                  {"target", Kind::kIndex},
                                  {"extensions", Kind::kObject, kBufferViewExtensions}};
constexpr Member kSparseIndices[] = {{"bufferView", Kind::kIndex, kRequired},
                                     {"byteOffset", Kind::kSmallSize},
                                     {"componentType", Kind::kIndex, kRequired}};
constexpr Member kSparseValues[] = {{"bufferView", Kind::kIndex, kRequired}, {"byteOffset", Kind::kSmallSize}};
constexpr Member kSparse[] = {{"count", Kind::kSmallSize, kRequired},
                              {"indices", Kind::kObject, kSparseIndices, kRequired},
                              {"values", Kind::kObject, kSparseValues, kRequired}};
constexpr Member kAccessor[] = {{"name", Kind::kString},           {"bufferView", Kind::kIndex},
                                {"byteOffset", Kind::kSize},       {"componentType", Kind::kIndex, kRequired},
                                {"count", Kind::kSize, kRequired}, {"type", Kind::kString, kRequired},
                                {"normalized", Kind::kBool},       {"min", Kind::kNumbers},
                                {"max", Kind::kNumbers},           {"sparse", Kind::kObject, kSparse}};
constexpr Member kDraco[] = {{"bufferView", Kind::kIndex, kRequired}, {"attributes", Kind::kIndexMap}};
constexpr Member kPrimitiveExtensions[] = {{"KHR_draco_mesh_compression", Kind::kObject, kDraco}};
constexpr Member kPrimitive[] = {{"attributes", Kind::kIndexMap, kRequired},
                                 {"indices", Kind::kIndex},
                                 {"material", Kind::kIndex},
                                 {"mode", Kind::kIndex},
                                 {"targets", Kind::kIndexMaps},
                                 {"extensions", Kind::kObject, kPrimitiveExtensions}};
constexpr Member kMesh[] = {
    {"name", Kind::kString}, {"primitives", Kind::kObjects, kPrimitive, kRequired}, {"weights", Kind::kNumbers}};

// Scenes.
constexpr Member kInstancing[] = {{"attributes", Kind::kIndexMap, kRequired}};
constexpr Member kNodeLight[] = {{"light", Kind::kIndex, kRequired}};
constexpr Member kNodeExtensions[] = {{"EXT_mesh_gpu_instancing", Kind::kObject, kInstancing},
                                      {"KHR_lights_punctual", Kind::kObject, kNodeLight}};
constexpr Member kNode[] = {{"name", Kind::kString},
                            {"children", Kind::kIndices},
                            {"mesh", Kind::kIndex},
                            {"camera", Kind::kIndex},
                            {"skin", Kind::kIndex},
                            {"matrix", Kind::kNumbers, 16},
                            {"translation", Kind::kNumbers, 3},
                            {"rotation", Kind::kNumbers, 4},
                            {"scale", Kind::kNumbers, 3},
                            {"weights", Kind::kNumbers},
                            {"extensions", Kind::kObject, kNodeExtensions}};
constexpr Member kScene[] = {{"name", Kind::kString}, {"nodes", Kind::kIndices}};
constexpr Member kPerspective[] = {{"yfov", Kind::kNumber, kRequired},
                                   {"znear", Kind::kNumber, kRequired},
                                   {"zfar", Kind::kNumber},
                                   {"aspectRatio", Kind::kNumber}};
constexpr Member kOrthographic[] = {{"xmag", Kind::kNumber, kRequired},
                                    {"ymag", Kind::kNumber, kRequired},
                                    {"znear", Kind::kNumber, kRequired},
                                    {"zfar", Kind::kNumber, kRequired}};
constexpr Member kCamera[] = {{"name", Kind::kString},
                              {"type", Kind::kString, kRequired},
                              {"perspective", Kind::kObject, kPerspective},
                              {"orthographic", Kind::kObject, kOrthographic}};
constexpr Member kSkin[] = {
    {"name", Kind::kString}, {"inverseBindMatrices", Kind::kIndex}, {"joints", Kind::kIndices, kRequired}};
constexpr Member kAnimationSampler[] = {{"input", Kind::kIndex, kRequired}, {"output", Kind::kIndex, kRequired}};
constexpr Member kAnimation[] = {{"name", Kind::kString}, {"samplers", Kind::kObjects, kAnimationSampler, kRequired}};
constexpr Member kSpot[] = {{"innerConeAngle", Kind::kNumber}, {"outerConeAngle", Kind::kNumber}};
constexpr Member kLight[] = {{"name", Kind::kString},      {"type", Kind::kString, kRequired},
                             {"color", Kind::kNumbers, 3}, {"intensity", Kind::kNumber},
                             {"range", Kind::kNumber},     {"spot", Kind::kObject, kSpot}};
constexpr Member kLights[] = {{"lights", Kind::kObjects, kLight}};
constexpr Member kDocumentExtensions[] = {{"KHR_lights_punctual", Kind::kObject, kLights}};
constexpr Member kAsset[] = {{"version", Kind::kString, kRequired},
                             {"minVersion", Kind::kString},
                             {"copyright", Kind::kString},
                             {"generator", Kind::kString}};

struct Section {
  Member member;
  std::string_view one;
};

constexpr Section kSections[] = {
    {{"materials", Kind::kObjects, kMaterial}, "material"},
    {{"textures", Kind::kObjects, kTexture}, "texture"},
    {{"samplers", Kind::kObjects, kSampler}, "sampler"},
    {{"images", Kind::kObjects, kImage}, "image"},
    {{"buffers", Kind::kObjects, kBuffer}, "buffer"},
    {{"bufferViews", Kind::kObjects, kBufferView}, "buffer view"},
    {{"accessors", Kind::kObjects, kAccessor}, "accessor"},
    {{"meshes", Kind::kObjects, kMesh}, "mesh"},
    {{"nodes", Kind::kObjects, kNode}, "node"},
    {{"scenes", Kind::kObjects, kScene}, "scene"},
    {{"cameras", Kind::kObjects, kCamera}, "camera"},
    {{"skins", Kind::kObjects, kSkin}, "skin"},
    {{"animations", Kind::kObjects, kAnimation}, "animation"},
    {{"extensionsUsed", Kind::kStrings}, "extensionsUsed"},
    {{"extensionsRequired", Kind::kStrings}, "extensionsRequired"},
    {{"asset", Kind::kObject, kAsset}, "asset"},
    {{"extensions", Kind::kObject, kDocumentExtensions}, "extensions"},
};

const Section* find_section(std::string_view name) {
  for (const Section& section : kSections) {
    if (section.member.name == name) return &section;
  }
  return nullptr;
}

constexpr Member kAnyMember;
constexpr Member kIndexMember{"", Kind::kIndex};
constexpr Member kNumberMember{"", Kind::kNumber};
constexpr Member kStringMember{"", Kind::kString};
constexpr Member kIndexMapMember{"", Kind::kIndexMap};

/// The expected content, by Kind.
constexpr const char* kExpectations[] = {"a value",
                                         "an index",
                                         "a size",
                                         "a size below 2^31",
                                         "a number",
                                         "a string",
                                         "true or false",
                                         "an object",
                                         "an array of objects",
                                         "an array of indices",
                                         "an array of numbers",
                                         "an array of strings",
                                         "an object",
                                         "an array of objects"};
static_assert(std::size(kExpectations) == static_cast<size_t>(Kind::kIndexMaps) + 1);

// Takes nlohmann's SAX events. Returns false for the event that breaks a rule, with error_ set.
class Checker {
 public:
  using number_integer_t = nlohmann::json::number_integer_t;
  using number_unsigned_t = nlohmann::json::number_unsigned_t;
  using number_float_t = nlohmann::json::number_float_t;
  using string_t = nlohmann::json::string_t;
  using binary_t = nlohmann::json::binary_t;

  // With a section: checks a batch document of it. Without: checks any JSON.
  Checker(const Section* section, uint64_t first, uint64_t json_byte, uint64_t head_bytes)
      : section_(section), first_(first), json_byte_(json_byte), head_bytes_(head_bytes) {
    if (section == nullptr) return;
    root_.kind = Kind::kObject;
    root_.members = &section->member;
    root_.member_count = 1;
  }
  Checker(const Checker&) = delete;
  Checker& operator=(const Checker&) = delete;

  SchemaOutcome outcome;
  Error error{ErrorCode::kFormat, {}};

  bool null() { return leaf("null", true); }
  bool boolean(bool value) { return expected().kind == Kind::kBool ? leaf("", true) : leaf(value ? "true" : "false"); }

  bool number_integer(number_integer_t value) {
    if (expected().kind == Kind::kNumber) return leaf("", true);
    return leaf(std::to_string(value));
  }

  bool number_unsigned(number_unsigned_t value) {
    constexpr uint64_t kMaxInt = std::numeric_limits<int32_t>::max();
    constexpr uint64_t kMaxSize = uint64_t{1} << 53;
    const Kind kind = expected().kind;
    const bool fits = kind == Kind::kNumber || (kind == Kind::kSize && value <= kMaxSize) ||
                      ((kind == Kind::kIndex || kind == Kind::kSmallSize) && value <= kMaxInt);
    if (fits && !frames_.empty() && frames_.back().rules.data() == kPrimitive &&
        frames_.back().member->name == "indices")
      frames_.back().indices = static_cast<int32_t>(value);
    return fits ? leaf("", true) : leaf(std::to_string(value));
  }

  bool number_float(number_float_t value, const string_t& text) {
    if (expected().kind == Kind::kNumber && std::isfinite(value)) return leaf("", true);
    return leaf(text.substr(0, 40));
  }

  bool string(string_t&) { return expected().kind == Kind::kString ? leaf("", true) : leaf("a string"); }
  bool binary(binary_t&) { return leaf("binary data"); }

  bool start_object(std::size_t) {
    const Member& member = expected();
    Frame frame;
    switch (member.kind) {
      case Kind::kAny:
        frame.each = &kAnyMember;
        break;
      case Kind::kObject:
        frame.rules = {member.members, member.member_count};
        if (frame.rules.empty()) frame.each = &kAnyMember;
        break;
      case Kind::kIndexMap:
        frame.each = &kIndexMember;
        frame.map = true;
        break;
      default:
        return leaf("an object");
    }
    frames_.push_back(frame);
    return true;
  }

  bool start_array(std::size_t) {
    const Member& member = expected();
    Frame frame{.array = true, .length = member.length};
    switch (member.kind) {
      case Kind::kAny:
        frame.each = &kAnyMember;
        break;
      case Kind::kObjects:
        frame.element_rules = {member.members, member.member_count};
        break;
      case Kind::kIndices:
        frame.each = &kIndexMember;
        break;
      case Kind::kNumbers:
        frame.each = &kNumberMember;
        break;
      case Kind::kStrings:
        frame.each = &kStringMember;
        break;
      case Kind::kIndexMaps:
        frame.each = &kIndexMapMember;
        break;
      default:
        return leaf("an array");
    }
    frames_.push_back(frame);
    return true;
  }

  bool key(string_t& name) {
    Frame& frame = frames_.back();
    frame.key = name.substr(0, 60);
    frame.member = &kAnyMember;
    if (frame.map) {
      if (std::find(frame.names.begin(), frame.names.end(), name) != frame.names.end())
        return fail(ErrorCode::kFormat, "appears twice");
      if (frame.names.size() == kMaxNames)
        return fail(ErrorCode::kRange, "is past the limit of " + std::to_string(kMaxNames) + " names");
      frame.names.push_back(name);
    }
    for (size_t i = 0; i < frame.rules.size(); ++i) {
      const Member& member = frame.rules[i];
      if (member.name != name) continue;
      if ((frame.seen >> i & 1u) != 0) return fail(ErrorCode::kFormat, "appears twice");
      frame.seen |= 1u << i;
      frame.member = &member;
      break;
    }
    return true;
  }

  bool end_object() {
    const Frame frame = frames_.back();
    for (size_t i = 0; i < frame.rules.size(); ++i) {
      if (frame.rules[i].presence == kOptional || (frame.seen >> i & 1u) != 0) continue;
      frames_.back().key = std::string(frame.rules[i].name);
      return fail(ErrorCode::kFormat, "is missing");
    }
    if (frame.rules.data() == kPrimitive) outcome.primitive_indices.push_back(frame.indices);
    frames_.pop_back();
    count_element();
    return true;
  }

  bool end_array() {
    const Frame frame = frames_.back();
    frames_.pop_back();
    if (frame.length != 0 && frame.elements != frame.length) {
      return fail(ErrorCode::kRange,
                  "has " + std::to_string(frame.elements) + " numbers, expected " + std::to_string(frame.length));
    }
    count_element();
    return true;
  }

  bool parse_error(std::size_t position, const std::string& token, const nlohmann::json::exception& exception) {
    (void)token;
    // "[json.exception.parse_error.101] parse error at line 1, column 9: syntax error while ...": its position is
    // relative to the batch.
    std::string what = exception.what();
    if (const size_t bracket = what.find("] "); bracket != std::string::npos) what = what.substr(bracket + 2);
    if (const size_t colon = what.find(": "); what.compare(0, 11, "parse error") == 0 && colon != std::string::npos)
      what = what.substr(colon + 2);
    for (char& c : what) c = static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    const uint64_t byte = json_byte_ + (position > head_bytes_ ? position - head_bytes_ - 1 : 0);
    error = {ErrorCode::kFormat, "JSON byte " + std::to_string(byte) + ": " + what.substr(0, 200)};
    return false;
  }

 private:
  struct Frame {
    std::span<const Member> rules;          // of an object's members
    std::span<const Member> element_rules;  // of the members of an array's objects
    const Member* each = nullptr;           // the rule of every element or member
    const Member* member = &kAnyMember;     // of the current key
    bool array = false;
    bool map = false;                // names have no rules, but each may occur once
    std::vector<std::string> names;  // of a map
    uint32_t length = 0;
    uint32_t seen = 0;
    uint64_t elements = 0;
    int32_t indices = -1;
    std::string key;
  };

  const Member& expected() {
    if (frames_.empty()) return root_;
    const Frame& frame = frames_.back();
    if (!frame.element_rules.empty()) {
      element_.kind = Kind::kObject;
      element_.members = frame.element_rules.data();
      element_.member_count = static_cast<uint32_t>(frame.element_rules.size());
      return element_;
    }
    if (frame.each != nullptr) return *frame.each;
    return *frame.member;
  }

  void count_element() {
    if (!frames_.empty() && frames_.back().array) ++frames_.back().elements;
  }

  // A value that is not a container. `found` describes it; null counts as an absent member.
  bool leaf(const std::string& found, bool fits = false) {
    const Member& member = expected();
    const bool absent = fits && found == "null" && !frames_.empty() && !frames_.back().array;
    if (const auto rules = frames_.empty() ? std::span<const Member>() : frames_.back().rules;
        absent && !rules.empty() && member.kind != Kind::kAny) {
      for (size_t i = 0; i < rules.size(); ++i) {
        if (&rules[i] == &member) frames_.back().seen &= ~(1u << i);
      }
      return true;
    }
    if (member.kind != Kind::kAny && (!fits || found == "null")) {
      const bool number = !found.empty() && (found[0] == '-' || (found[0] >= '0' && found[0] <= '9'));
      return fail(number ? ErrorCode::kRange : ErrorCode::kFormat,
                  "is " + found + ", expected " + kExpectations[static_cast<size_t>(member.kind)]);
    }
    count_element();
    return true;
  }

  bool fail(ErrorCode code, const std::string& what) {
    std::string place;
    for (size_t i = 1; i < frames_.size(); ++i) {
      const Frame& frame = frames_[i];
      if (i == 1 && frame.array) continue;  // the section's own array: the number names its element
      if (frame.array) {
        place += "[" + std::to_string(frame.elements) + "]";
      } else if (!frame.key.empty()) {
        place += (place.empty() ? "" : ".") + frame.key;
      }
    }
    std::string where(section_ == nullptr ? "JSON" : section_->one);
    if (frames_.size() > 1 && frames_[1].array) where += " " + std::to_string(first_ + frames_[1].elements);
    for (char& c : place) c = static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    error = {code, where + (place.empty() ? " " : ": " + place + " ") + what};
    return false;
  }

  const Section* section_;
  const uint64_t first_;
  const uint64_t json_byte_;
  const uint64_t head_bytes_;
  Member root_;  // the batch document: an object whose one member is the section
  Member element_;
  std::vector<Frame> frames_;
};

}  // namespace

Result<SchemaOutcome> check_schema(std::string_view section, std::string_view batch, uint64_t first,
                                   uint64_t json_byte) {
  const Section* known = find_section(section);
  if (known == nullptr) return Error{ErrorCode::kFormat, "no section \"" + std::string(section) + "\""};
  const uint64_t head_bytes = batch.find(':') + (known->member.kind == Kind::kObject ? 1 : 2);  // {"SECTION":[
  Checker checker(known, first, json_byte, head_bytes);
  if (!nlohmann::json::sax_parse(batch.begin(), batch.end(), &checker)) return checker.error;
  return std::move(checker.outcome);
}

std::string_view singular(std::string_view section) {
  const Section* known = find_section(section);
  return known == nullptr ? section : known->one;
}

Result<void> check_json(std::string_view text, uint64_t json_byte) {
  Checker checker(nullptr, 0, json_byte, 0);
  if (!nlohmann::json::sax_parse(text.begin(), text.end(), &checker)) return checker.error;
  return {};
}

}  // namespace scree::convert
