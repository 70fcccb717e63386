#include "tools/gltf/write/writer.h"

#include <algorithm>
#include <cassert>
#include <cctype>
#include <cstring>
#include <deque>
#include <filesystem>
#include <map>
#include <set>
#include <tuple>

#include "format/bytes.h"
#include "format/container/part_file.h"
#include "format/text.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/common/options/options.h"
#include "tools/common/output/output_file.h"
#include "tools/gltf/write/replacement.h"
#include "tools/gltf/write/write_parts.h"

namespace scree::tools {
namespace {

using format::PartFile;

constexpr uint64_t kGlbMaxBytes = 0xffffffffu;  // of version 2, whose lengths have 32 bits
constexpr uint64_t kGlbHeaderBytes = 12;
constexpr uint64_t kGlbChunkHeaderBytes = 8;
constexpr uint64_t kGlbWideHeaderBytes = 16;  // version 3: its own header and that of each chunk
constexpr uint32_t kGlbMagic = 0x46546c67;    // "glTF"
constexpr uint32_t kGlbJson = 0x4e4f534a;
constexpr uint32_t kGlbBinary = 0x004e4942;
constexpr size_t kDrainBytes = size_t{1} << 20;

using Sampler = std::tuple<format::Wrap, format::Wrap, uint16_t, uint16_t>;
constexpr Sampler kDefaultSampler{format::Wrap::kRepeat, format::Wrap::kRepeat, uint16_t{0}, uint16_t{0}};

struct Image {
  std::string name;
  uint32_t buffer_view;  // kNone: `uri` is used
  std::string uri;
  std::string mime_type;
};

/// The names that are taken, each with the number from which to look for a free "NAME_2", "NAME_3" ... In lower case,
/// for file systems that ignore case.
using TakenNames = std::map<std::string, uint64_t>;

struct Buffer {
  std::string file_name;
  uint64_t bytes;
};

const char* mime_type(format::ImageCodec codec) {
  if (codec == format::ImageCodec::kBlocks) return "image/ktx2";
  return codec == format::ImageCodec::kJpeg ? "image/jpeg" : "image/png";
}

const char* file_extension(format::ImageCodec codec) {
  if (codec == format::ImageCodec::kBlocks) return ".ktx2";
  return codec == format::ImageCodec::kJpeg ? ".jpg" : ".png";
}

uint32_t wrap_number(format::Wrap wrap) {
  if (wrap == format::Wrap::kMirror) return 33648;
  return wrap == format::Wrap::kClamp ? 33071 : 10497;
}

/// A file name as a relative URI (RFC 3986: percent-encodes all characters except unreserved ones).
std::string uri_of(const std::string& file_name) {
  constexpr char kHex[] = "0123456789ABCDEF";
  std::string uri;
  for (const char letter : file_name) {
    const unsigned char byte = static_cast<unsigned char>(letter);
    if (byte < 0x80 && (std::isalnum(byte) != 0 || std::strchr("-._~", letter) != nullptr)) {
      uri += letter;
    } else {
      uri += '%';
      uri += kHex[byte >> 4];
      uri += kHex[byte & 15];
    }
  }
  return uri;
}

/// `name` reduced to letters, digits, '-' and '_', at most 64 of them, and to '.' where `keeps_dots`.
std::string safe_name(std::string_view name, bool keeps_dots = false) {
  std::string safe;
  for (const char letter : name.substr(0, 64)) {
    const unsigned char byte = static_cast<unsigned char>(letter);
    const bool kept =
        byte < 0x80 && (std::isalnum(byte) != 0 || letter == '-' || letter == '_' || (keeps_dots && letter == '.'));
    safe += kept ? letter : '_';
  }
  return safe.empty() ? "image" : safe;
}

void write_image(JsonWriter& json, const Image& image) {
  write_name(json, image.name);
  json.member("mimeType", image.mime_type);
  if (image.buffer_view != format::kNone)
    json.member("bufferView", image.buffer_view);
  else
    json.member("uri", image.uri);
}

}  // namespace

struct GltfWriter::State {
  std::filesystem::path path;
  bool glb = false;
  std::string copyright;
  PartFile document;
  PartFile binary;                     // the current buffer
  std::vector<PartFile> buffer_files;  // earlier ones
  std::vector<PartFile> image_files;
  TakenNames image_names;
  TakenNames buffer_names;
  format::Existing existing = format::Existing::kReplace;
  const std::atomic<bool>* stop = nullptr;
  std::vector<Buffer> buffers;  // earlier ones
  std::string buffer_file;      // of the current buffer
  uint64_t buffer_bytes = 0;
  uint64_t fallback_bytes = 0;
  uint64_t image_bytes = 0;
  uint64_t total_bytes = 0;
  uint64_t most_version_2_bytes = kGlbMaxBytes;
  bool is_version_3 = false;

  std::vector<PlacedView> buffer_views;
  std::vector<GltfAccessor> accessors;
  std::vector<GltfMesh> meshes;
  std::deque<GltfNode> nodes;  // stable references; no doubling of memory with millions of nodes
  std::vector<GltfCamera> cameras;
  std::vector<GltfLight> lights;
  std::vector<GltfMaterial> materials;
  std::vector<GltfTexture> textures;
  std::vector<Image> images;
  std::vector<GltfScene> scenes;
  uint32_t default_scene = 0;
  std::set<std::string, std::less<>> extensions_used;
  std::set<std::string, std::less<>> extensions_required;

  std::string stem() const { return path.stem().string(); }
  std::string sibling(const std::string& file_name) const { return (path.parent_path() / file_name).string(); }
  /// "city_NAME.jpg", made unique among `taken`, to which it is added. `safe`: NAME.
  std::string file_name(const std::string& safe, const std::string& extension, TakenNames& taken) const;
  std::string image_file_name(std::string_view name, format::ImageCodec codec, TakenNames& taken) const {
    return file_name(safe_name(name, codec == format::ImageCodec::kBlocks), file_extension(codec), taken);
  }
  Result<void> check_stop() const { return tools::check_stop(stop); }
  /// The document's offset in the file.
  uint64_t document_start() const {
    return !glb ? 0 : is_version_3 ? 2 * kGlbWideHeaderBytes : kGlbHeaderBytes + kGlbChunkHeaderBytes;
  }
  uint64_t alignment() const { return is_version_3 ? 8 : 4; }  // of chunks
  /// Size of a .glb whose document ends at `document_end`, padded.
  uint64_t file_bytes(uint64_t document_end) const {
    const uint64_t head = is_version_3 ? kGlbWideHeaderBytes : kGlbChunkHeaderBytes;
    return document_end + (buffer_bytes == 0 ? 0 : head + format::align_up(buffer_bytes, alignment()));
  }
  /// Makes the current buffer of a .gltf one of the earlier ones.
  Result<void> end_buffer();
  void write_buffers(JsonWriter& json) const;
  /// Writes the document and returns its end, padded.
  Result<uint64_t> write_document();
  /// Writes the header of a .glb, and its buffer after the document.
  Result<void> write_chunks(uint64_t document_end);
  /// Removes the files that were renamed before a later rename failed.
  Result<void> commit_all();
};

namespace {

template <class Item>
uint32_t add(std::vector<Item>& items, Item item) {
  items.push_back(std::move(item));
  return static_cast<uint32_t>(items.size() - 1);
}

/// The document's text. It is written to its file as it grows.
class DocumentText {
 public:
  DocumentText(const PartFile& file, uint64_t offset) : json(text_), file_(file), end_(offset) {}

  /// Writes `items` as the top-level array `name`; nothing if there are none (glTF allows no empty arrays).
  template <class Items, class WriteItem>
  Result<void> section(std::string_view name, const Items& items, const WriteItem& write_item) {
    if (items.empty()) return {};
    json.line();
    json.key(name);
    json.begin_array();
    for (const auto& item : items) {
      json.line();
      json.object([&] { write_item(json, item); });
      if (text_.size() < kDrainBytes) continue;
      SCREE_TRY(drain());
    }
    json.end_array();
    return {};
  }

  Result<void> drain() {
    const Result<void> written = file_.write_at(end_, std::as_bytes(std::span(text_)));
    end_ += text_.size();
    text_.clear();
    return written;
  }

  /// Pads with `count` spaces.
  void pad(uint64_t count) { text_.append(count, ' '); }
  uint64_t end() const { return end_ + text_.size(); }

 private:
  std::string text_;

 public:
  JsonWriter json;

 private:
  const PartFile& file_;
  uint64_t end_;
};

}  // namespace

GltfWriter::GltfWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
GltfWriter::GltfWriter(GltfWriter&&) noexcept = default;
GltfWriter& GltfWriter::operator=(GltfWriter&&) noexcept = default;
GltfWriter::~GltfWriter() = default;

Result<GltfWriter> GltfWriter::create(const std::string& path, std::string_view copyright, format::Existing existing) {
  auto state = std::make_unique<State>();
  state->path = path;
  const std::string extension = format::lower_case(state->path.extension().string());
  if (extension != ".gltf" && extension != ".glb")
    return Error{ErrorCode::kUsage, path + ": the output's name ends in .gltf or .glb"};
  state->glb = extension == ".glb";
  state->copyright = copyright;
  state->existing = existing;
  state->document = SCREE_TRY(PartFile::create(path, PartFile::Content::kEmpty, existing));
  // A .glb begins with the JSON, whose length is known only at the end. Until then its buffer lies in a file of its
  // own.
  state->buffer_file = state->stem() + ".bin";
  PartFile binary =
      SCREE_TRY(state->glb ? PartFile::create(path + ".bin")
                           : PartFile::create(state->sibling(state->buffer_file), PartFile::Content::kEmpty, existing));
  if (state->glb) SCREE_TRY(binary.hide());
  state->binary = std::move(binary);
  return GltfWriter(std::move(state));
}

Result<uint64_t> GltfWriter::reserve(uint64_t bytes, uint64_t alignment) {
  assert(alignment != 0 && (alignment & (alignment - 1)) == 0);
  const uint64_t offset = format::align_up(state_->buffer_bytes, alignment);
  const auto end = format::checked_add(offset, bytes);
  if (!end || *end > uint64_t{1} << 62)
    return Error{ErrorCode::kRange, state_->path.string() + ": a buffer of more than 2^62 bytes"};
  state_->buffer_bytes = *end;
  return offset;
}

Result<void> GltfWriter::write_at(uint64_t offset, std::span<const std::byte> bytes) const {
  assert(format::range_within(offset, bytes.size(), state_->buffer_bytes));
  SCREE_TRY(state_->check_stop());
  return state_->binary.write_at(offset, bytes);
}

Result<uint64_t> GltfWriter::append(std::span<const std::byte> bytes, uint64_t alignment) {
  const uint64_t offset = SCREE_TRY(reserve(bytes.size(), alignment));
  SCREE_TRY(write_at(offset, bytes));
  return offset;
}

uint64_t GltfWriter::buffer_bytes() const {
  return state_->buffer_bytes;
}

Result<void> GltfWriter::next_buffer(std::string_view name) {
  State& state = *state_;
  if (state.glb) return Error{ErrorCode::kUsage, state.path.string() + ": a .glb has one buffer"};
  SCREE_TRY(state.end_buffer());
  if (!state.buffer_files.empty()) SCREE_TRY(state.buffer_files.back().park());
  state.buffer_file = state.file_name(safe_name(name), ".bin", state.buffer_names);
  state.binary =
      SCREE_TRY(PartFile::create(state.sibling(state.buffer_file), PartFile::Content::kEmpty, state.existing));
  return {};
}

Result<void> GltfWriter::State::end_buffer() {
  if (buffer_bytes == 0) return binary.hide();  // the file is not needed
  SCREE_TRY(binary.resize(buffer_bytes));
  buffer_files.push_back(std::move(binary));
  buffers.push_back({std::move(buffer_file), std::exchange(buffer_bytes, 0)});
  return {};
}

uint32_t GltfWriter::add_buffer_view(const GltfBufferView& view) {
  PlacedView placed{view, static_cast<uint32_t>(state_->buffers.size())};
  if (view.meshopt) {
    use_extension(kMeshopt, true);
    placed.view.offset = format::align_up(state_->fallback_bytes, 4);
    state_->fallback_bytes = placed.view.offset + view.bytes;
  }
  return add(state_->buffer_views, std::move(placed));
}
uint32_t GltfWriter::add_accessor(GltfAccessor accessor) {
  return add(state_->accessors, std::move(accessor));
}
uint32_t GltfWriter::add_mesh(GltfMesh mesh) {
  return add(state_->meshes, std::move(mesh));
}

uint32_t GltfWriter::add_node(GltfNode added) {
  if (!added.instancing.empty()) use_extension("EXT_mesh_gpu_instancing", true);
  state_->nodes.push_back(std::move(added));
  return static_cast<uint32_t>(state_->nodes.size() - 1);
}

GltfNode& GltfWriter::node(uint32_t index) {
  return state_->nodes[index];
}
uint32_t GltfWriter::add_camera(GltfCamera camera) {
  return add(state_->cameras, std::move(camera));
}

uint32_t GltfWriter::add_light(GltfLight light) {
  use_extension(kLights, false);
  return add(state_->lights, std::move(light));
}

uint32_t GltfWriter::add_material(GltfMaterial material) {
  if (has_transform(material)) use_extension("KHR_texture_transform", false);
  for (const char* const name : material_extensions(material)) use_extension(name, false);
  return add(state_->materials, std::move(material));
}

uint32_t GltfWriter::add_texture(GltfTexture texture) {
  return add(state_->textures, std::move(texture));
}

std::string GltfWriter::State::file_name(const std::string& safe, const std::string& extension,
                                         TakenNames& taken) const {
  const auto [name, is_free] = taken.try_emplace(format::lower_case(safe) + extension, 2);
  std::string unique = safe;
  for (bool is_unique = is_free; !is_unique;) {
    unique = safe + "_" + std::to_string(name->second++);
    is_unique = taken.try_emplace(format::lower_case(unique) + extension, 2).second;
  }
  return stem() + "_" + unique + extension;
}

void GltfWriter::stop_on(const std::atomic<bool>* stop) {
  state_->stop = stop;
}

Result<void> GltfWriter::check_files(std::span<const PlannedImage> planned, const std::string& source) const {
  const auto check_source = [&](const std::string& file) -> Result<void> {
    if (!is_same_file(file, source)) return {};
    return Error{ErrorCode::kUsage, file + ": the output would replace the file that is read"};
  };
  SCREE_TRY(check_source(state_->path.string()));
  if (state_->glb) return {};
  SCREE_TRY(check_source(state_->sibling(state_->buffer_file)));
  TakenNames taken = state_->image_names;
  for (const PlannedImage& image : planned) {
    const std::string file = state_->sibling(state_->image_file_name(image.name, image.codec, taken));
    SCREE_TRY(check_source(file));
    SCREE_TRY(check_output_file(file, state_->existing));
  }
  return {};
}

Result<uint32_t> GltfWriter::add_image(std::string_view name, format::ImageCodec codec,
                                       std::span<const std::byte> bytes, std::string_view mime) {
  Image image{std::string(name), format::kNone, {}, std::string(mime.empty() ? mime_type(codec) : mime)};
  if (state_->glb) {
    const uint64_t offset = SCREE_TRY(append(bytes));
    image.buffer_view = add_buffer_view({offset, bytes.size(), 0, GltfTarget::kNone});
    return add(state_->images, std::move(image));
  }
  SCREE_TRY(state_->check_stop());
  const std::string file_name = state_->image_file_name(name, codec, state_->image_names);
  PartFile file = SCREE_TRY(PartFile::create(state_->sibling(file_name), PartFile::Content::kEmpty, state_->existing));
  SCREE_TRY(file.write_at(0, bytes));
  SCREE_TRY(file.park());
  state_->image_files.push_back(std::move(file));
  state_->image_bytes += bytes.size();
  image.uri = uri_of(file_name);
  return add(state_->images, std::move(image));
}

uint32_t GltfWriter::add_scene(GltfScene scene) {
  return add(state_->scenes, std::move(scene));
}
void GltfWriter::set_default_scene(uint32_t scene) {
  state_->default_scene = scene;
}

void GltfWriter::use_extension(std::string_view name, bool required) {
  state_->extensions_used.emplace(name);
  if (required) state_->extensions_required.emplace(name);
}

uint64_t GltfWriter::total_bytes() const {
  return state_->total_bytes;
}

Result<void> GltfWriter::State::commit_all() {
  std::vector<PartFile*> files;
  for (PartFile& file : buffer_files) files.push_back(&file);
  for (PartFile& file : image_files) files.push_back(&file);
  files.push_back(&document);
  Replacement replacement(files);
  for (size_t i = 0; i < files.size(); ++i) SCREE_TRY(replacement.commit(i));
  return replacement.keep();
}

void GltfWriter::set_most_version_2_bytes(uint64_t bytes) {
  state_->most_version_2_bytes = bytes;
}

bool GltfWriter::is_version_3() const {
  return state_->is_version_3;
}

void GltfWriter::State::write_buffers(JsonWriter& json) const {
  if (buffers.empty() && buffer_bytes == 0) return;
  json.key("buffers");
  json.begin_array();
  for (const Buffer& buffer : buffers)
    json.object([&] {
      json.member("uri", uri_of(buffer.file_name));
      json.member("byteLength", buffer.bytes);
    });
  if (buffer_bytes != 0) json.object([&] { json.member("byteLength", buffer_bytes); });  // a .glb's
  if (fallback_bytes != 0)
    json.object([&] {
      json.member("byteLength", fallback_bytes);
      write_extension(json, kMeshopt, [&] { json.member("fallback", true); });
    });
  json.end_array();
}

Result<uint64_t> GltfWriter::State::write_document() {
  State& state = *this;
  DocumentText text(state.document, document_start());
  JsonWriter& json = text.json;
  json.begin_object();
  json.object("asset", [&] {
    json.member("version", "2.0");
    json.member("generator", "scree " SCREE_VERSION);
    if (!state.copyright.empty()) json.member("copyright", state.copyright);
  });
  if (!state.extensions_used.empty()) json.array("extensionsUsed", state.extensions_used);
  if (!state.extensions_required.empty()) json.array("extensionsRequired", state.extensions_required);
  write_buffers(json);
  if (!state.scenes.empty()) json.member("scene", state.default_scene);

  std::vector<Sampler> samplers;
  for (const GltfTexture& texture : state.textures) {
    const Sampler sampler{texture.wrap_s, texture.wrap_t, texture.mag_filter, texture.min_filter};
    if (sampler != kDefaultSampler && std::find(samplers.begin(), samplers.end(), sampler) == samplers.end())
      samplers.push_back(sampler);
  }
  const auto write_sampler = [](JsonWriter& out, const Sampler& sampler) {
    const auto& [wrap_s, wrap_t, mag_filter, min_filter] = sampler;
    if (mag_filter != 0) out.member("magFilter", uint32_t{mag_filter});
    if (min_filter != 0) out.member("minFilter", uint32_t{min_filter});
    if (wrap_s != format::Wrap::kRepeat) out.member("wrapS", wrap_number(wrap_s));
    if (wrap_t != format::Wrap::kRepeat) out.member("wrapT", wrap_number(wrap_t));
  };
  const auto write_texture = [&](JsonWriter& out, const GltfTexture& texture) {
    const Sampler sampler{texture.wrap_s, texture.wrap_t, texture.mag_filter, texture.min_filter};
    write_name(out, texture.name);
    if (sampler != kDefaultSampler)
      out.member("sampler",
                 static_cast<uint64_t>(std::find(samplers.begin(), samplers.end(), sampler) - samplers.begin()));
    if (texture.image != format::kNone) out.member("source", texture.image);
  };
  const auto write_scene = [](JsonWriter& out, const GltfScene& scene) {
    write_name(out, scene.name);
    if (!scene.nodes.empty()) out.array("nodes", scene.nodes);
  };

  SCREE_TRY(text.section("scenes", state.scenes, write_scene));
  SCREE_TRY(text.section("nodes", state.nodes, write_node));
  SCREE_TRY(text.section("cameras", state.cameras, write_camera));
  if (!state.lights.empty()) {
    json.line();
    json.key("extensions");
    json.begin_object();
    json.key(kLights);
    json.begin_object();
    SCREE_TRY(text.section("lights", state.lights, write_light));
    json.end_object();
    json.end_object();
  }
  SCREE_TRY(text.section("meshes", state.meshes, write_mesh));
  SCREE_TRY(text.section("materials", state.materials, write_material));
  SCREE_TRY(text.section("textures", state.textures, write_texture));
  SCREE_TRY(text.section("samplers", samplers, write_sampler));
  SCREE_TRY(text.section("images", state.images, write_image));
  SCREE_TRY(text.section("accessors", state.accessors, write_accessor));
  const uint64_t fallback = state.buffers.size() + (state.buffer_bytes != 0 ? 1 : 0);
  const auto write_view = [&](JsonWriter& out, const PlacedView& view) { write_buffer_view(out, view, fallback); };
  SCREE_TRY(text.section("bufferViews", state.buffer_views, write_view));
  json.line();
  json.end_object();
  json.line();
  if (json.met_non_finite())
    return Error{ErrorCode::kRange, state.path.string() + ": a number of the document is not finite"};

  if (state.glb) text.pad(format::align_up(text.end(), alignment()) - text.end());
  SCREE_TRY(text.drain());
  return text.end();
}

Result<void> GltfWriter::State::write_chunks(uint64_t document_end) {
  // Version 2: magic, version, length; then each chunk's length and type. Version 3: lengths have 64 bits, and a chunk
  // begins with its type, then 0 for its encoding.
  std::vector<std::byte> head;
  const auto put = [&](auto value) {
    head.resize(head.size() + sizeof value);
    format::store(head.data() + head.size() - sizeof value, value);
  };
  const auto put_length = [&](uint64_t length) { is_version_3 ? put(length) : put(static_cast<uint32_t>(length)); };
  const auto put_chunk = [&](uint32_t type, uint64_t length) {
    if (!is_version_3) put_length(length);
    put(type);
    if (!is_version_3) return;
    put(uint32_t{0});
    put_length(length);
  };
  put(kGlbMagic);
  put(uint32_t{is_version_3 ? 3u : 2u});
  put_length(file_bytes(document_end));
  put_chunk(kGlbJson, document_end - document_start());
  SCREE_TRY(document.write_at(0, head));
  if (buffer_bytes == 0) return {};
  head.clear();
  put_chunk(kGlbBinary, format::align_up(buffer_bytes, alignment()));
  SCREE_TRY(document.write_at(document_end, head));
  const uint64_t start = document_end + head.size();
  std::vector<std::byte> window(kDrainBytes);
  for (uint64_t done = 0; done < buffer_bytes; done += window.size()) {
    SCREE_TRY(check_stop());
    window.resize(std::min<uint64_t>(kDrainBytes, buffer_bytes - done));
    SCREE_TRY(binary.read_at(done, window));
    SCREE_TRY(document.write_at(start + done, window));
  }
  return document.resize(file_bytes(document_end));  // pads with zeros
}

Result<void> GltfWriter::finish() {
  State& state = *state_;
  SCREE_TRY(state.glb ? state.binary.resize(state.buffer_bytes) : state.end_buffer());
  state.is_version_3 = state.glb && state.buffer_bytes > state.most_version_2_bytes;
  uint64_t end = SCREE_TRY(state.write_document());
  if (state.glb && !state.is_version_3 && state.file_bytes(end) > state.most_version_2_bytes) {
    // The document's size alone is the cause. It is written again at the offset of version 3.
    state.is_version_3 = true;
    end = SCREE_TRY(state.write_document());
  }
  if (state.glb) SCREE_TRY(state.write_chunks(end));
  SCREE_TRY(state.check_stop());
  SCREE_TRY(state.commit_all());
  state.total_bytes = (state.glb ? state.file_bytes(end) : end) + state.image_bytes;
  for (const Buffer& buffer : state.buffers) state.total_bytes += buffer.bytes;
  return {};
}

}  // namespace scree::tools
