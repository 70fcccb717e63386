#include "tools/gltf/document/document.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "format/fail.h"
#include "runtime/threads/parallel.h"
#include "tools/common/options/options.h"
#include "tools/common/process/memory_use.h"
#include "tools/gltf/document/schema.h"
#include "tools/gltf/document/tinygltf_model.h"
#include "tools/gltf/document/uri.h"

namespace scree::convert {
namespace {

// Bytes of text per call of tinygltf: enough to hide the fixed cost of a call, and few enough that its DOM (about 12.6
// bytes per byte of text) and model stay within a few MiB.
constexpr uint64_t kBatchBytes = 256 << 10;

// More threads would take more memory, and a document of several MiB is read in a tenth of a second then.
constexpr uint32_t kMostThreads = 8;
constexpr uint64_t kMemoryPerThread = uint64_t{128} << 20;  // of all memory; a batch takes up to 8 MiB

void sort_unique(std::vector<int32_t>& numbers) {
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
}

/// False for a member that is absent or null; the schema treats both alike.
bool has_member(const nlohmann::json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && !found->is_null();
}

DocMeshopt read_meshopt(const nlohmann::json& source) {
  const auto size = [&](const char* key) {
    return has_member(source, key) ? source.at(key).get<uint64_t>() : uint64_t{0};
  };
  DocMeshopt meshopt{.buffer = source.at("buffer").get<int32_t>(),
                     .offset = size("byteOffset"),
                     .bytes = size("byteLength"),
                     .stride = size("byteStride"),
                     .count = size("count")};
  const std::string mode = source.at("mode").get<std::string>();
  if (mode == "TRIANGLES") {
    meshopt.mode = DocMeshopt::Mode::kTriangles;
  } else if (mode == "INDICES") {
    meshopt.mode = DocMeshopt::Mode::kIndices;
  } else if (mode != "ATTRIBUTES") {
    meshopt.unknown_mode = one_line(mode.substr(0, 20));
  }
  const std::string filter = has_member(source, "filter") ? source.at("filter").get<std::string>() : "NONE";
  if (filter == "OCTAHEDRAL") {
    meshopt.filter = DocMeshopt::Filter::kOctahedral;
  } else if (filter == "QUATERNION") {
    meshopt.filter = DocMeshopt::Filter::kQuaternion;
  } else if (filter == "EXPONENTIAL") {
    meshopt.filter = DocMeshopt::Filter::kExponential;
  } else if (filter == "COLOR") {
    meshopt.filter = DocMeshopt::Filter::kColor;
  } else if (filter != "NONE") {
    meshopt.unknown_filter = one_line(filter.substr(0, 20));
  }
  return meshopt;
}

// Reads the compression of a batch's buffer views, which the schema has checked. tinygltf cannot be used, because it
// keeps integers of extensions in 32 bits.
std::vector<DocMeshopt> read_meshopts(const std::string& batch, uint64_t first) {
  std::vector<DocMeshopt> all;
  if (batch.find("_meshopt_compression") == std::string::npos) return all;
  const auto json = nlohmann::json::parse(batch, nullptr, false);
  uint64_t view = first;
  for (const auto& element : json.at("bufferViews")) {
    const auto extensions = element.find("extensions");
    if (extensions != element.end() && extensions->is_object()) {
      for (const bool is_khr : {false, true}) {
        const char* const name = is_khr ? "KHR_meshopt_compression" : "EXT_meshopt_compression";
        if (!has_member(*extensions, name)) continue;
        DocMeshopt meshopt = read_meshopt(extensions->at(name));
        meshopt.view = view;
        meshopt.is_khr = is_khr;
        all.push_back(std::move(meshopt));
        break;
      }
    }
    ++view;
  }
  return all;
}

/// To be called before `bytes` of the text are parsed at once, as one string in the worst case. Parsing then takes the
/// copy, the parser's string, which doubles while it grows, and the value.
Result<void> check_room(const GltfDocument& document, uint64_t bytes, uint64_t memory) {
  constexpr uint64_t kCopies = 4;
  if (bytes < kLargeDocument) return {};
  const uint64_t needed = tools::memory_use().anonymous + kCopies * bytes;
  return needed <= memory ? Result<void>() : document_too_large(memory, document.text.size(), "about", needed);
}

/// Ends the reading of the document if the process takes too much memory, or if the import is stopped. Records take
/// more than three times as much per byte of text in one document as in another, so the memory is measured, not
/// predicted.
class ReadingLimits {
 public:
  ReadingLimits(const ImportOptions& options, uint64_t text_bytes)
      : options_(options),
        text_bytes_(text_bytes),
        before_(text_bytes < kLargeDocument ? 0 : tools::memory_use().anonymous) {}

  /// To be called after one more part of the text was read. The estimate in the error assumes that the rest takes as
  /// much per byte.
  Result<void> read(JsonRange range) {
    SCREE_TRY(options_.check_stop());
    read_ += range.end - range.begin;
    if (read_ < next_) return {};
    next_ = read_ + kLargeDocument;
    const uint64_t now = tools::memory_use().anonymous;
    if (now <= options_.memory) return {};
    const double share = static_cast<double>(read_) / static_cast<double>(text_bytes_);
    const double in_the_end = static_cast<double>(before_) + static_cast<double>(now - std::min(now, before_)) / share;
    return document_too_large(options_.memory, text_bytes_, "about", static_cast<uint64_t>(in_the_end));
  }
  uint64_t memory() const { return options_.memory; }

 private:
  const ImportOptions& options_;
  uint64_t text_bytes_;
  uint64_t before_;  // memory of the process before reading, with the text
  uint64_t read_ = 0;
  uint64_t next_ = kLargeDocument;
};

/// A batch that is parsed, but not part of the document yet.
struct ParsedBatch {
  ParsedElements elements;
  std::vector<DocMeshopt> meshopts;

  void add_to(GltfDocument& document) {
    elements.add_to(document);
    for (DocMeshopt& meshopt : meshopts) {
      document.views[meshopt.view].meshopt = static_cast<int32_t>(document.meshopt.size());
      document.meshopt.push_back(std::move(meshopt));
    }
  }
};

Result<ParsedBatch> parse_batch(std::span<const char> text, const std::string& section,
                                const JsonElements::Batch& batch) {
  std::string json = "{\"" + section + "\":[";
  json.append(text.data() + batch.elements.begin, batch.elements.end - batch.elements.begin);
  json += "]}";
  auto checked = SCREE_TRY(check_schema(section, json, batch.first, batch.elements.begin));
  // tinygltf immediately looks up the accessor of every primitive's "indices", but the accessors are in other batches.
  // So the member is hidden from it. The schema check reads the member and passes it on.
  if (section == "meshes") hide_primitive_indices(json);
  auto elements = ParsedElements::parse(json, std::move(checked.primitive_indices));
  if (!elements) {
    const std::string place = std::string(singular(section)) + " " + std::to_string(batch.first) +
                              (batch.count > 1 ? " to " + std::to_string(batch.first + batch.count - 1) : "");
    return at(place, elements.error());
  }
  ParsedBatch parsed{std::move(*elements), {}};
  if (section == "bufferViews") parsed.meshopts = read_meshopts(json, batch.first);
  return parsed;
}

/// Reads the elements of a top-level array through tinygltf, a batch per thread at a time.
Result<void> read_section(GltfDocument& document, const std::string& section, JsonRange array, uint32_t threads,
                          ReadingLimits& limits) {
  const std::span<const char> text = document.text;
  JsonElements elements(text, array);
  for (bool is_more = true; is_more;) {
    std::vector<JsonElements::Batch> batches;
    Result<void> split;  // an error comes after the errors of the batches before it
    while (is_more && batches.size() < threads) {
      const auto batch = elements.next(kBatchBytes);
      if (!batch) split = batch.error();
      is_more = batch && batch->count > 0;
      if (is_more) batches.push_back(*batch);
    }
    std::vector<std::optional<Result<ParsedBatch>>> parsed(batches.size());
    runtime::parallel_for(batches.size(), threads,
                          [&](uint64_t i) { parsed[i].emplace(parse_batch(text, section, batches[i])); });
    for (size_t i = 0; i < batches.size(); ++i) {
      if (!*parsed[i]) return parsed[i]->error();
      (*parsed[i])->add_to(document);
      parsed[i].reset();
      SCREE_TRY(limits.read(batches[i].elements));
    }
    if (!split) return split;
  }
  return {};
}

// Buffers and images are hidden from tinygltf, which would read their files. They are read one at a time, because a
// data: URI can be large.
Result<void> read_uris(GltfDocument& document, const std::string& section, JsonRange array, ReadingLimits& limits) {
  const std::span<const char> text = document.text;
  JsonElements elements(text, array);
  while (true) {
    auto batch = SCREE_TRY(elements.next(1));
    if (batch.count == 0) return {};
    const std::string_view element(text.data() + batch.elements.begin, batch.elements.end - batch.elements.begin);
    SCREE_TRY(check_room(document, element.size(), limits.memory()));
    SCREE_TRY(check_schema(section, "{\"" + section + "\":[" + std::string(element) + "]}", batch.first,
                           batch.elements.begin));
    const auto json = nlohmann::json::parse(element.begin(), element.end(), nullptr, false);
    const auto text_member = [&](const char* key) {
      const auto found = json.find(key);
      return found != json.end() && found->is_string() ? found->get<std::string>() : std::string();
    };
    std::string uri = text_member("uri");
    const bool is_data = is_data_uri(uri);
    if (is_data) uri.clear();
    if (section == "images") {
      DocImage image{.name = text_member("name"), .uri = std::move(uri), .is_data = is_data, .json = batch.elements};
      if (const auto view = json.find("bufferView"); view != json.end() && view->is_number())
        image.view = view->get<int32_t>();
      document.images.push_back(std::move(image));
    } else {
      DocBuffer buffer;
      buffer.uri = std::move(uri);
      buffer.is_data = is_data;
      buffer.bytes = json.at("byteLength").get<uint64_t>();
      if (has_member(json, "chunk")) buffer.chunk = json.at("chunk").get<int32_t>();
      buffer.json = batch.elements;
      if (const auto extensions = json.find("extensions"); extensions != json.end() && extensions->is_object())
        buffer.meshopt_fallback =
            extensions->contains("EXT_meshopt_compression") || extensions->contains("KHR_meshopt_compression");
      document.buffers.push_back(std::move(buffer));
    }
    SCREE_TRY(limits.read(batch.elements));
  }
}

DocLight read_light(const nlohmann::json& source) {
  const auto number = [](const nlohmann::json& object, const char* key, double otherwise) {
    return has_member(object, key) ? object.at(key).get<double>() : otherwise;
  };
  DocLight light;
  if (has_member(source, "name")) light.name = source.at("name").get<std::string>();
  light.type = one_line(source.at("type").get<std::string>().substr(0, 20));
  if (has_member(source, "color"))
    for (size_t c = 0; c < 3; ++c) light.color[c] = source.at("color").at(c).get<double>();
  light.intensity = number(source, "intensity", 1);
  light.range = number(source, "range", 0);
  if (has_member(source, "spot")) {
    light.inner_cone = number(source.at("spot"), "innerConeAngle", light.inner_cone);
    light.outer_cone = number(source.at("spot"), "outerConeAngle", light.outer_cone);
  }
  return light;
}

/// Reads the lights of KHR_lights_punctual in the document's own "extensions".
Result<void> read_lights(GltfDocument& document, JsonRange range, ReadingLimits& limits) {
  const std::span<const char> text = document.text;
  const std::string_view value(text.data() + range.begin, static_cast<size_t>(range.end - range.begin));
  if (value.find("KHR_lights_punctual") == std::string_view::npos) return check_json(value, range.begin);
  SCREE_TRY(check_room(document, value.size(), limits.memory()));
  SCREE_TRY(check_schema("extensions", "{\"extensions\":" + std::string(value) + "}", 0, range.begin));
  for (const char* const key : {"KHR_lights_punctual", "lights"}) {
    const auto members = SCREE_TRY(split_object(text, range));
    const auto found = std::find_if(members.begin(), members.end(), [&](const auto& m) { return m.key == key; });
    if (found == members.end() || text[found->value.begin] == 'n') return {};  // absent or null
    range = found->value;
  }
  // The parser's values take many times the bytes of the text, so it gets a batch at a time.
  JsonElements elements(text, range);
  while (true) {
    const auto batch = SCREE_TRY(elements.next(kBatchBytes));
    if (batch.count == 0) return {};
    const std::string_view lights(text.data() + batch.elements.begin, batch.elements.end - batch.elements.begin);
    for (const nlohmann::json& source : nlohmann::json::parse("[" + std::string(lights) + "]", nullptr, false))
      document.lights.push_back(read_light(source));
    SCREE_TRY(limits.read(batch.elements));
  }
}

Result<void> read_default_scene(GltfDocument& document, std::string_view value, uint64_t byte) {
  const auto json = nlohmann::json::parse(value.begin(), value.end(), nullptr, false);
  if (json.is_null()) return {};
  if (!json.is_number_unsigned() || json.get<uint64_t>() > 0x7fffffffu)
    return fail(ErrorCode::kRange, "JSON byte ", byte, ": scene is ", value.substr(0, 40), ", expected an index");
  document.scene = static_cast<int32_t>(json.get<uint64_t>());
  return {};
}

void mark_draco_accessors(GltfDocument& document) {
  const auto mark = [&](int32_t accessor) {
    if (accessor >= 0 && static_cast<size_t>(accessor) < document.accessors.size())
      document.accessors[static_cast<size_t>(accessor)].is_draco = true;
  };
  for (const DocMesh& mesh : document.meshes)
    for (const DocPrimitive& primitive : mesh.primitives) {
      if (primitive.draco == kAbsent) continue;
      mark(primitive.indices);
      for (const auto& [name, accessor] : primitive.attributes) mark(accessor);
    }
}

}  // namespace

bool GltfDocument::uses(const std::string& extension) const {
  return std::find(extensions_used.begin(), extensions_used.end(), extension) != extensions_used.end() ||
         std::find(extensions_required.begin(), extensions_required.end(), extension) != extensions_required.end();
}

const DocBounds* GltfDocument::bounds_of(uint32_t accessor) const {
  const auto found = std::lower_bound(bounds.begin(), bounds.end(), accessor,
                                      [](const DocBounds& a, uint32_t b) { return a.accessor < b; });
  return found == bounds.end() || found->accessor != accessor ? nullptr : &*found;
}

Error document_too_large(uint64_t memory, uint64_t json_bytes, const char* estimate, uint64_t needed_bytes) {
  return {ErrorCode::kUsage, "--memory: " + tools::format_bytes(memory) + ", but its document of " +
                                 tools::format_bytes(json_bytes) + " of JSON needs " + estimate + " " +
                                 std::to_string(needed_bytes >> 20) + " MiB"};
}

Result<GltfDocument> read_document(std::vector<char> json, const ImportOptions& options) {
  GltfDocument document{.text = std::move(json)};
  const std::span<char> text = document.text;
  auto members = SCREE_TRY(split_document(text));

  // "asset" is read first, because a document of another version need not follow this version's rules.
  const auto asset = std::find_if(members.begin(), members.end(), [](const auto& m) { return m.key == "asset"; });
  if (asset == members.end()) return Error{ErrorCode::kFormat, "asset is missing: not a glTF 2.0 document"};
  if (text[asset->value.begin] != '{') return Error{ErrorCode::kFormat, "asset is not an object"};
  SCREE_TRY(read_asset(document, asset->value));

  constexpr std::string_view kRead[] = {
      "extensionsUsed", "extensionsRequired", "bufferViews", "accessors", "meshes", "nodes",      "scenes",
      "materials",      "textures",           "samplers",    "cameras",   "skins",  "animations", "buffers",
      "images"};
  ReadingLimits limits(options, text.size());
  const auto threads = static_cast<uint32_t>(
      std::clamp<uint64_t>(options.memory / kMemoryPerThread, 1, std::min(options.threads, kMostThreads)));
  for (const JsonMember& member : members) {
    const std::string_view value(text.data() + member.value.begin, member.value.end - member.value.begin);
    if (member.key == "asset") continue;
    Result<void> read;
    if (member.key == "scene") {
      read = read_default_scene(document, value, member.value.begin);
    } else if (member.key == "extensions" && value.front() == '{') {
      read = read_lights(document, member.value, limits);
    } else if (std::find(std::begin(kRead), std::end(kRead), member.key) == std::end(kRead) || value == "null") {
      read = check_json(value, member.value.begin);
    } else if (value.front() != '[') {
      read = Error{ErrorCode::kFormat, member.key + " is not an array"};
    } else if (member.key == "buffers" || member.key == "images") {
      read = read_uris(document, member.key, member.value, limits);
    } else {
      read = read_section(document, member.key, member.value, threads, limits);
    }
    if (!read) return read.error();
  }
  sort_unique(document.skin_accessors);
  sort_unique(document.animation_accessors);
  mark_draco_accessors(document);
  return document;
}

Result<std::vector<std::byte>> data_uri(const GltfDocument& document, JsonRange range, uint64_t memory) {
  SCREE_TRY(check_room(document, range.end - range.begin, memory));
  const std::span<const char> text = document.text;
  const auto json = nlohmann::json::parse(text.data() + range.begin, text.data() + range.end, nullptr, false);
  const auto uri = json.find("uri");
  if (uri == json.end() || !uri->is_string()) return Error{ErrorCode::kFormat, "uri is missing"};
  return decode_data_uri(uri->get_ref<const std::string&>());
}

}  // namespace scree::convert
