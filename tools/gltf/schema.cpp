#include "tools/gltf/schema.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
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

struct ObjectRule;

struct Member {
  std::string_view name;
  Kind kind = Kind::kAny;
  const ObjectRule* object = nullptr;  // kObject, kObjects
  uint32_t length = 0;                 // kNumbers: exact length; 0: any
  bool required = false;
};

struct ObjectRule {
  std::span<const Member> members;  // at most 32
};

constexpr bool kRequired = true;
constexpr size_t kMaxNames = 256;  // of attributes; the search is linear

// Materials, texture information, and extensions that scree reads.
constexpr Member kTransformMembers[] = {{"offset", Kind::kNumbers, nullptr, 2},
                                        {"scale", Kind::kNumbers, nullptr, 2},
                                        {"rotation", Kind::kNumber},
                                        {"texCoord", Kind::kIndex}};
constexpr ObjectRule kTransform{kTransformMembers};
constexpr Member kTextureInfoExtensionMembers[] = {{"KHR_texture_transform", Kind::kObject, &kTransform}};
constexpr ObjectRule kTextureInfoExtensions{kTextureInfoExtensionMembers};
constexpr Member kTextureInfoMembers[] = {{"index", Kind::kIndex, nullptr, 0, kRequired},
                                          {"texCoord", Kind::kIndex},
                                          {"extensions", Kind::kObject, &kTextureInfoExtensions}};
constexpr ObjectRule kTextureInfo{kTextureInfoMembers};
constexpr Member kNormalTextureMembers[] = {{"index", Kind::kIndex, nullptr, 0, kRequired},
                                            {"texCoord", Kind::kIndex},
                                            {"scale", Kind::kNumber},
                                            {"extensions", Kind::kObject, &kTextureInfoExtensions}};
constexpr ObjectRule kNormalTexture{kNormalTextureMembers};
constexpr Member kOcclusionTextureMembers[] = {{"index", Kind::kIndex, nullptr, 0, kRequired},
                                               {"texCoord", Kind::kIndex},
                                               {"strength", Kind::kNumber},
                                               {"extensions", Kind::kObject, &kTextureInfoExtensions}};
constexpr ObjectRule kOcclusionTexture{kOcclusionTextureMembers};
constexpr Member kPbrMembers[] = {{"baseColorFactor", Kind::kNumbers, nullptr, 4},
                                  {"baseColorTexture", Kind::kObject, &kTextureInfo},
                                  {"metallicRoughnessTexture", Kind::kObject, &kTextureInfo},
                                  {"metallicFactor", Kind::kNumber},
                                  {"roughnessFactor", Kind::kNumber}};
constexpr ObjectRule kPbr{kPbrMembers};
constexpr Member kSpecularGlossinessMembers[] = {{"diffuseFactor", Kind::kNumbers, nullptr, 4},
                                                 {"diffuseTexture", Kind::kObject, &kTextureInfo},
                                                 {"specularFactor", Kind::kNumbers, nullptr, 3},
                                                 {"glossinessFactor", Kind::kNumber}};
constexpr ObjectRule kSpecularGlossiness{kSpecularGlossinessMembers};
constexpr Member kEmissiveStrengthMembers[] = {{"emissiveStrength", Kind::kNumber}};
constexpr ObjectRule kEmissiveStrength{kEmissiveStrengthMembers};
constexpr Member kIorMembers[] = {{"ior", Kind::kNumber}};
constexpr ObjectRule kIor{kIorMembers};
constexpr Member kSpecularMembers[] = {{"specularFactor", Kind::kNumber},
                                       {"specularTexture", Kind::kObject, &kTextureInfo},
                                       {"specularColorFactor", Kind::kNumbers, nullptr, 3},
                                       {"specularColorTexture", Kind::kObject, &kTextureInfo}};
constexpr ObjectRule kSpecular{kSpecularMembers};
constexpr Member kMaterialExtensionMembers[] = {
    {"KHR_materials_unlit", Kind::kAny},
    {"KHR_materials_emissive_strength", Kind::kObject, &kEmissiveStrength},
    {"KHR_materials_ior", Kind::kObject, &kIor},
    {"KHR_materials_specular", Kind::kObject, &kSpecular},
    {"KHR_materials_pbrSpecularGlossiness", Kind::kObject, &kSpecularGlossiness}};
constexpr ObjectRule kMaterialExtensions{kMaterialExtensionMembers};
constexpr Member kMaterialMembers[] = {{"name", Kind::kString},
                                       {"pbrMetallicRoughness", Kind::kObject, &kPbr},
                                       {"normalTexture", Kind::kObject, &kNormalTexture},
                                       {"occlusionTexture", Kind::kObject, &kOcclusionTexture},
                                       {"emissiveTexture", Kind::kObject, &kTextureInfo},
                                       {"emissiveFactor", Kind::kNumbers, nullptr, 3},
                                       {"alphaMode", Kind::kString},
                                       {"alphaCutoff", Kind::kNumber},
                                       {"doubleSided", Kind::kBool},
                                       {"extensions", Kind::kObject, &kMaterialExtensions}};

constexpr Member kSourceMembers[] = {{"source", Kind::kIndex}};
constexpr ObjectRule kSource{kSourceMembers};
constexpr Member kTextureExtensionMembers[] = {{"EXT_texture_webp", Kind::kObject, &kSource},
                                               {"KHR_texture_basisu", Kind::kObject, &kSource},
                                               {"MSFT_texture_dds", Kind::kObject, &kSource}};
constexpr ObjectRule kTextureExtensions{kTextureExtensionMembers};
constexpr Member kTextureMembers[] = {{"name", Kind::kString},
                                      {"sampler", Kind::kIndex},
                                      {"source", Kind::kIndex},
                                      {"extensions", Kind::kObject, &kTextureExtensions}};
constexpr Member kSamplerMembers[] = {{"name", Kind::kString},
                                      {"magFilter", Kind::kIndex},
                                      {"minFilter", Kind::kIndex},
                                      {"wrapS", Kind::kIndex},
                                      {"wrapT", Kind::kIndex}};
constexpr Member kImageMembers[] = {
    {"name", Kind::kString}, {"uri", Kind::kString}, {"mimeType", Kind::kString}, {"bufferView", Kind::kIndex}};

// Geometry.
constexpr Member kMeshoptFallbackMembers[] = {{"fallback", Kind::kBool}};
constexpr ObjectRule kMeshoptFallback{kMeshoptFallbackMembers};
constexpr Member kBufferExtensionMembers[] = {{"EXT_meshopt_compression", Kind::kObject, &kMeshoptFallback},
                                              {"KHR_meshopt_compression", Kind::kObject, &kMeshoptFallback}};
constexpr ObjectRule kBufferExtensions{kBufferExtensionMembers};
constexpr Member kBufferMembers[] = {{"name", Kind::kString},
                                     {"uri", Kind::kString},
                                     {"byteLength", Kind::kSize, nullptr, 0, kRequired},
                                     {"chunk", Kind::kIndex},
                                     {"extensions", Kind::kObject, &kBufferExtensions}};
constexpr Member kMeshoptMembers[] = {{"buffer", Kind::kIndex, nullptr, 0, kRequired},
                                      {"byteOffset", Kind::kSize},
                                      {"byteLength", Kind::kSize, nullptr, 0, kRequired},
                                      {"byteStride", Kind::kSize, nullptr, 0, kRequired},
                                      {"count", Kind::kSize, nullptr, 0, kRequired},
                                      {"mode", Kind::kString, nullptr, 0, kRequired},
                                      {"filter", Kind::kString}};
constexpr ObjectRule kMeshopt{kMeshoptMembers};
constexpr Member kBufferViewExtensionMembers[] = {{"EXT_meshopt_compression", Kind::kObject, &kMeshopt},
                                                  {"KHR_meshopt_compression", Kind::kObject, &kMeshopt}};
constexpr ObjectRule kBufferViewExtensions{kBufferViewExtensionMembers};
constexpr Member kBufferViewMembers[] = {{"name", Kind::kString},
                                         {"buffer", Kind::kIndex, nullptr, 0, kRequired},
                                         {"byteOffset", Kind::kSize},
                                         {"byteLength", Kind::kSize, nullptr, 0, kRequired},
                                         {"byteStride", Kind::kSize},
                                         {"target", Kind::kIndex},
                                         {"extensions", Kind::kObject, &kBufferViewExtensions}};
constexpr Member kSparseIndicesMembers[] = {{"bufferView", Kind::kIndex, nullptr, 0, kRequired},
                                            {"byteOffset", Kind::kSmallSize},
                                            {"componentType", Kind::kIndex, nullptr, 0, kRequired}};
constexpr ObjectRule kSparseIndices{kSparseIndicesMembers};
constexpr Member kSparseValuesMembers[] = {{"bufferView", Kind::kIndex, nullptr, 0, kRequired},
                                           {"byteOffset", Kind::kSmallSize}};
constexpr ObjectRule kSparseValues{kSparseValuesMembers};
constexpr Member kSparseMembers[] = {{"count", Kind::kSmallSize, nullptr, 0, kRequired},
                                     {"indices", Kind::kObject, &kSparseIndices, 0, kRequired},
                                     {"values", Kind::kObject, &kSparseValues, 0, kRequired}};
constexpr ObjectRule kSparse{kSparseMembers};
constexpr Member kAccessorMembers[] = {{"name", Kind::kString},
                                       {"bufferView", Kind::kIndex},
                                       {"byteOffset", Kind::kSize},
                                       {"componentType", Kind::kIndex, nullptr, 0, kRequired},
                                       {"count", Kind::kSize, nullptr, 0, kRequired},
                                       {"type", Kind::kString, nullptr, 0, kRequired},
                                       {"normalized", Kind::kBool},
                                       {"min", Kind::kNumbers},
                                       {"max", Kind::kNumbers},
                                       {"sparse", Kind::kObject, &kSparse}};
constexpr Member kDracoMembers[] = {{"bufferView", Kind::kIndex, nullptr, 0, kRequired},
                                    {"attributes", Kind::kIndexMap}};
constexpr ObjectRule kDraco{kDracoMembers};
constexpr Member kPrimitiveExtensionMembers[] = {{"KHR_draco_mesh_compression", Kind::kObject, &kDraco}};
constexpr ObjectRule kPrimitiveExtensions{kPrimitiveExtensionMembers};
constexpr Member kPrimitiveMembers[] = {{"attributes", Kind::kIndexMap, nullptr, 0, kRequired},
                                        {"indices", Kind::kIndex},
                                        {"material", Kind::kIndex},
                                        {"mode", Kind::kIndex},
                                        {"targets", Kind::kIndexMaps},
                                        {"extensions", Kind::kObject, &kPrimitiveExtensions}};
constexpr ObjectRule kPrimitive{kPrimitiveMembers};
constexpr Member kMeshMembers[] = {
    {"name", Kind::kString}, {"primitives", Kind::kObjects, &kPrimitive, 0, kRequired}, {"weights", Kind::kNumbers}};

// Scenes.
constexpr Member kInstancingMembers[] = {{"attributes", Kind::kIndexMap, nullptr, 0, kRequired}};
constexpr ObjectRule kInstancing{kInstancingMembers};
constexpr Member kNodeLightMembers[] = {{"light", Kind::kIndex, nullptr, 0, kRequired}};
constexpr ObjectRule kNodeLight{kNodeLightMembers};
constexpr Member kNodeExtensionMembers[] = {{"EXT_mesh_gpu_instancing", Kind::kObject, &kInstancing},
                                            {"KHR_lights_punctual", Kind::kObject, &kNodeLight}};
constexpr ObjectRule kNodeExtensions{kNodeExtensionMembers};
constexpr Member kNodeMembers[] = {{"name", Kind::kString},
                                   {"children", Kind::kIndices},
                                   {"mesh", Kind::kIndex},
                                   {"camera", Kind::kIndex},
                                   {"skin", Kind::kIndex},
                                   {"matrix", Kind::kNumbers, nullptr, 16},
                                   {"translation", Kind::kNumbers, nullptr, 3},
                                   {"rotation", Kind::kNumbers, nullptr, 4},
                                   {"scale", Kind::kNumbers, nullptr, 3},
                                   {"weights", Kind::kNumbers},
                                   {"extensions", Kind::kObject, &kNodeExtensions}};
constexpr Member kSceneMembers[] = {{"name", Kind::kString}, {"nodes", Kind::kIndices}};
constexpr Member kPerspectiveMembers[] = {{"yfov", Kind::kNumber, nullptr, 0, kRequired},
                                          {"znear", Kind::kNumber, nullptr, 0, kRequired},
                                          {"zfar", Kind::kNumber},
                                          {"aspectRatio", Kind::kNumber}};
constexpr ObjectRule kPerspective{kPerspectiveMembers};
constexpr Member kOrthographicMembers[] = {{"xmag", Kind::kNumber, nullptr, 0, kRequired},
                                           {"ymag", Kind::kNumber, nullptr, 0, kRequired},
                                           {"znear", Kind::kNumber, nullptr, 0, kRequired},
                                           {"zfar", Kind::kNumber, nullptr, 0, kRequired}};
constexpr ObjectRule kOrthographic{kOrthographicMembers};
constexpr Member kCameraMembers[] = {{"name", Kind::kString},
                                     {"type", Kind::kString, nullptr, 0, kRequired},
                                     {"perspective", Kind::kObject, &kPerspective},
                                     {"orthographic", Kind::kObject, &kOrthographic}};
constexpr Member kSkinMembers[] = {
    {"name", Kind::kString}, {"inverseBindMatrices", Kind::kIndex}, {"joints", Kind::kIndices, nullptr, 0, kRequired}};
constexpr Member kAnimationSamplerMembers[] = {{"input", Kind::kIndex, nullptr, 0, kRequired},
                                               {"output", Kind::kIndex, nullptr, 0, kRequired}};
constexpr ObjectRule kAnimationSampler{kAnimationSamplerMembers};
constexpr Member kAnimationMembers[] = {{"name", Kind::kString},
                                        {"samplers", Kind::kObjects, &kAnimationSampler, 0, kRequired}};
constexpr Member kSpotMembers[] = {{"innerConeAngle", Kind::kNumber}, {"outerConeAngle", Kind::kNumber}};
constexpr ObjectRule kSpot{kSpotMembers};
constexpr Member kLightMembers[] = {{"name", Kind::kString},
                                    {"type", Kind::kString, nullptr, 0, kRequired},
                                    {"color", Kind::kNumbers, nullptr, 3},
                                    {"intensity", Kind::kNumber},
                                    {"range", Kind::kNumber},
                                    {"spot", Kind::kObject, &kSpot}};
constexpr ObjectRule kLight{kLightMembers};
constexpr Member kLightsMembers[] = {{"lights", Kind::kObjects, &kLight}};
constexpr ObjectRule kLights{kLightsMembers};
constexpr Member kDocumentExtensionMembers[] = {{"KHR_lights_punctual", Kind::kObject, &kLights}};
constexpr ObjectRule kDocumentExtensions{kDocumentExtensionMembers};
constexpr Member kAssetMembers[] = {{"version", Kind::kString, nullptr, 0, kRequired},
                                    {"minVersion", Kind::kString},
                                    {"copyright", Kind::kString},
                                    {"generator", Kind::kString}};

constexpr ObjectRule kMaterial{kMaterialMembers};
constexpr ObjectRule kTexture{kTextureMembers};
constexpr ObjectRule kSampler{kSamplerMembers};
constexpr ObjectRule kImage{kImageMembers};
constexpr ObjectRule kBuffer{kBufferMembers};
constexpr ObjectRule kBufferView{kBufferViewMembers};
constexpr ObjectRule kAccessor{kAccessorMembers};
constexpr ObjectRule kMesh{kMeshMembers};
constexpr ObjectRule kNode{kNodeMembers};
constexpr ObjectRule kScene{kSceneMembers};
constexpr ObjectRule kCamera{kCameraMembers};
constexpr ObjectRule kSkin{kSkinMembers};
constexpr ObjectRule kAnimation{kAnimationMembers};
constexpr ObjectRule kAsset{kAssetMembers};

struct Section {
  Member member;
  std::string_view one;
};

constexpr Section kSections[] = {
    {{"materials", Kind::kObjects, &kMaterial}, "material"},
    {{"textures", Kind::kObjects, &kTexture}, "texture"},
    {{"samplers", Kind::kObjects, &kSampler}, "sampler"},
    {{"images", Kind::kObjects, &kImage}, "image"},
    {{"buffers", Kind::kObjects, &kBuffer}, "buffer"},
    {{"bufferViews", Kind::kObjects, &kBufferView}, "buffer view"},
    {{"accessors", Kind::kObjects, &kAccessor}, "accessor"},
    {{"meshes", Kind::kObjects, &kMesh}, "mesh"},
    {{"nodes", Kind::kObjects, &kNode}, "node"},
    {{"scenes", Kind::kObjects, &kScene}, "scene"},
    {{"cameras", Kind::kObjects, &kCamera}, "camera"},
    {{"skins", Kind::kObjects, &kSkin}, "skin"},
    {{"animations", Kind::kObjects, &kAnimation}, "animation"},
    {{"extensionsUsed", Kind::kStrings}, "extensionsUsed"},
    {{"extensionsRequired", Kind::kStrings}, "extensionsRequired"},
    {{"asset", Kind::kObject, &kAsset}, "asset"},
    {{"extensions", Kind::kObject, &kDocumentExtensions}, "extensions"},
};

const Section* find_section(std::string_view name) {
  for (const Section& section : kSections) {
    if (section.member.name == name) return &section;
  }
  return nullptr;
}

constexpr Member kAnyMember{};
constexpr Member kIndexMember{"", Kind::kIndex};
constexpr Member kNumberMember{"", Kind::kNumber};
constexpr Member kStringMember{"", Kind::kString};
constexpr Member kIndexMapMember{"", Kind::kIndexMap};

std::string expectation(Kind kind) {
  switch (kind) {
    case Kind::kIndex:
      return "an index";
    case Kind::kSize:
      return "a size";
    case Kind::kSmallSize:
      return "a size below 2^31";
    case Kind::kNumber:
      return "a number";
    case Kind::kString:
      return "a string";
    case Kind::kBool:
      return "true or false";
    case Kind::kObject:
    case Kind::kIndexMap:
      return "an object";
    case Kind::kObjects:
    case Kind::kIndexMaps:
      return "an array of objects";
    case Kind::kIndices:
      return "an array of indices";
    case Kind::kNumbers:
      return "an array of numbers";
    case Kind::kStrings:
      return "an array of strings";
    case Kind::kAny:
      break;
  }
  return "a value";
}

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
    root_rule_.members = {&section->member, 1};
    root_ = {"", Kind::kObject, &root_rule_, 0, false};
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
    if (fits && !frames_.empty() && frames_.back().rule == &kPrimitive && frames_.back().member->name == "indices")
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
        frame.rule = member.object;
        if (member.object == nullptr) frame.each = &kAnyMember;
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
        frame.element_rule = member.object;
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
    if (frame.rule == nullptr) return true;
    for (size_t i = 0; i < frame.rule->members.size(); ++i) {
      const Member& member = frame.rule->members[i];
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
    if (frame.rule != nullptr) {
      for (size_t i = 0; i < frame.rule->members.size(); ++i) {
        if (!frame.rule->members[i].required || (frame.seen >> i & 1u) != 0) continue;
        frames_.back().key = std::string(frame.rule->members[i].name);
        return fail(ErrorCode::kFormat, "is missing");
      }
      if (frame.rule == &kPrimitive) outcome.primitive_indices.push_back(frame.indices);
    }
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
    const ObjectRule* rule = nullptr;          // an object with rules
    const ObjectRule* element_rule = nullptr;  // an array of objects with rules
    const Member* each = nullptr;              // the rule of every element or member
    const Member* member = &kAnyMember;        // of the current key
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
    if (frame.element_rule != nullptr) {
      element_ = {"", Kind::kObject, frame.element_rule, 0, false};
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
    if (absent && frames_.back().rule != nullptr && member.kind != Kind::kAny) {
      const auto& members = frames_.back().rule->members;
      for (size_t i = 0; i < members.size(); ++i) {
        if (&members[i] == &member) frames_.back().seen &= ~(1u << i);
      }
      return true;
    }
    if (member.kind != Kind::kAny && (!fits || found == "null")) {
      const bool number = !found.empty() && (found[0] == '-' || (found[0] >= '0' && found[0] <= '9'));
      return fail(number ? ErrorCode::kRange : ErrorCode::kFormat,
                  "is " + found + ", expected " + expectation(member.kind));
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
  Member root_{};  // the batch document: an object whose one member is the section
  ObjectRule root_rule_{};
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
