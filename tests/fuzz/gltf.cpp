// A .gltf or .glb through convert. The output has to pass the verification.
#include "tools/convert/convert.h"

#include "runtime/files/mapped_file.h"
#include "tests/fuzz/input.h"
#include "tools/inspect/verify.h"

namespace scree::fuzz {
namespace {

/// Accessors without a buffer view are zeros, and a node states its number of instances. So a few bytes can cause hours
/// of work, which tests nothing.
bool is_small(const convert::SourceScene& scene) {
  uint64_t work = 0;
  for (const convert::Primitive& primitive : scene.primitives) {
    if (primitive.triangle_count() > 100000 || primitive.vertex_count() > 1000000) return false;
    work += primitive.triangle_count();
  }
  uint64_t instances = scene.nodes.size();
  for (const convert::SourceNode& node : scene.nodes) {
    if (!node.instances) continue;
    if (node.instances->count > 10000) return false;
    instances += node.instances->count;
  }
  return work < 100000 && instances * (scene.scenes.size() + 1) * (scene.primitives.size() + 1) < 200000;
}

}  // namespace

void gltf(Bytes bytes) {
  static constexpr std::byte kOutside[256]{};
  static const std::string kBuffer = Folder::write("data.bin", kOutside);  // a file that a document may refer to
  // The bytes also select options, because a document has no place for them. FNV-1a.
  uint32_t choice = 2166136261u;
  for (const std::byte byte : bytes) choice = (choice ^ static_cast<uint32_t>(byte)) * 16777619u;
  const bool is_glb = bytes.size() >= 4 && std::memcmp(bytes.data(), "glTF", 4) == 0;
  convert::ConvertOptions options;
  options.input = Folder::write(is_glb ? "in.glb" : "in.gltf", bytes);
  options.output = Folder::file("out.scree");
  options.threads = 1;
  options.normals = choice & 1 ? convert::Normals::kAlways : convert::Normals::kAuto;
  options.encoding = choice & 2 ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
  options.float32 = choice & 4;
  options.drop_nonfinite = choice & 8;
  options.source_ids = choice & 16;
  options.zstd_level = choice & 32 ? 1 : 0;
  {
    const auto scene = convert::import_gltf(options.input, {});
    if (!scene || !is_small(*scene)) return;
  }
  std::error_code ignored;
  std::filesystem::remove(options.output, ignored);
  const auto converted = convert::convert(options);
  must(std::filesystem::exists(options.output) == bool(converted),
       "a conversion leaves a file where it worked and none where it did not");
  if (!converted) return;
  const auto map = runtime::MappedFile::open(options.output);
  must(bool(map), "what convert wrote is there");
  const auto file = format::Container::open(map->bytes());
  must(bool(file), "what convert wrote can be opened");
  const inspect::VerifyReport report = inspect::verify(*file, map->bytes(), 1);
  if (report.failure_count > 0) std::fprintf(stderr, "%s\n", report.failures[0].error.message.c_str());
  must(report.failure_count == 0, "what convert wrote verifies");
}

}  // namespace scree::fuzz
