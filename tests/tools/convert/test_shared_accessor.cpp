// Primitives that share one accessor and use only small parts of it, as in models of buildings.
#include <fstream>
#include <string>

#include "tests/tools/convert/convert_fixture.h"
#include "tools/gltf/byte_source.h"

using namespace scree;
using tests::TempFolder;

TEST_CASE("primitives that share a large accessor read only their own parts of it", "[convert][shared_accessor]") {
  constexpr uint64_t kVertices = uint64_t{1} << 26;  // 805 MB of positions
  constexpr uint64_t kPrimitives = 400, kTriangles = 12, kUsed = kTriangles + 2;
  const TempFolder folder;
  std::ofstream data(folder.file("in.bin"), std::ios::binary);
  const auto put = [&](const auto& value) { data.write(reinterpret_cast<const char*>(&value), sizeof value); };
  std::string accessors = R"({"bufferView":0,"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[9,9,9],"count":)" +
                          std::to_string(kVertices) + "}";
  std::string primitives, meshes, nodes, roots;
  // The file has holes between the used vertices.
  for (uint64_t p = 0; p < kPrimitives; ++p) {
    const uint64_t first = p * (kVertices - kUsed) / kPrimitives;
    data.seekp(static_cast<std::streamoff>(12 * first));
    for (uint64_t i = 0; i < kUsed; ++i)
      for (const float value : {static_cast<float>(i), static_cast<float>(i % 2), static_cast<float>(p)}) put(value);
    const std::string number = std::to_string(p), comma = p == 0 ? "" : ",";
    accessors += R"(,{"bufferView":1,"componentType":5125,"type":"SCALAR","count":36,"byteOffset":)" +
                 std::to_string(12 * kTriangles * p) + "}";
    meshes += comma + R"({"primitives":[{"attributes":{"POSITION":0},"indices":)" + std::to_string(p + 1) + "}]}";
    nodes += comma + R"({"mesh":)" + number + "}";
    roots += comma + number;
  }
  data.seekp(static_cast<std::streamoff>(12 * kVertices));
  for (uint64_t p = 0; p < kPrimitives; ++p)
    for (uint64_t t = 0; t < kTriangles; ++t)
      for (uint64_t k = 0; k < 3; ++k) put(static_cast<uint32_t>(p * (kVertices - kUsed) / kPrimitives + t + k));
  data.close();
  const uint64_t index_bytes = 12 * kTriangles * kPrimitives;
  folder.write("in.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[)" + roots + R"(]}],"nodes":[)" +
                              nodes + R"(],"meshes":[)" + meshes + R"(],"accessors":[)" + accessors +
                              R"(],"bufferViews":[{"buffer":0,"byteLength":)" + std::to_string(12 * kVertices) +
                              R"(},{"buffer":0,"byteOffset":)" + std::to_string(12 * kVertices) + R"(,"byteLength":)" +
                              std::to_string(index_bytes) + R"(}],"buffers":[{"uri":"in.bin","byteLength":)" +
                              std::to_string(12 * kVertices + index_bytes) + "}]}");
  convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
  const uint64_t before = convert::read_totals().bytes;
  const convert::ConvertReport report = tests::must_convert(options);
  CHECK(report.triangles == kPrimitives * kTriangles);
  CHECK(report.meshes == kPrimitives);
  CHECK(convert::read_totals().bytes - before < 16 * (kPrimitives * (12 * kUsed + 12 * kTriangles)));
}
