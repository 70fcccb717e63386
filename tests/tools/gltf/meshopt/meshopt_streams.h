// Streams of EXT_meshopt_compression written by the library, and documents with them.
#pragma once

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "tests/catch.h"
#include "tests/tools/temp_folder.h"
#include "tools/gltf/document/document.h"

namespace scree::tests {

using Bytes = std::vector<std::byte>;
using convert::DocMeshopt;
using Mode = DocMeshopt::Mode;

template <class T>
Bytes bytes_of(const std::vector<T>& values) {
  Bytes bytes(values.size() * sizeof(T));
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

/// A stream and its unpacked content.
struct Packed {
  DocMeshopt stated;
  Bytes stream, raw;
};

inline Packed packed(Mode mode, uint64_t count, uint64_t stride, const unsigned char* stream, size_t bytes, Bytes raw) {
  Packed out{.stated = {.mode = mode, .bytes = bytes, .stride = stride, .count = count}};
  out.stream.resize(bytes);
  std::memcpy(out.stream.data(), stream, bytes);
  out.raw = std::move(raw);
  return out;
}

inline Packed pack_attributes(const Bytes& raw, size_t stride) {
  const size_t count = raw.size() / stride;
  std::vector<unsigned char> stream(meshopt_encodeVertexBufferBound(count, stride));
  const size_t bytes = meshopt_encodeVertexBuffer(stream.data(), stream.size(), raw.data(), count, stride);
  return packed(Mode::kAttributes, count, stride, stream.data(), bytes, raw);
}

/// The codec may rotate triangles, so the library's decoder gives the unpacked content.
inline Packed pack_triangles(const std::vector<uint32_t>& indices, size_t vertices) {
  std::vector<unsigned char> stream(meshopt_encodeIndexBufferBound(indices.size(), vertices));
  const size_t bytes = meshopt_encodeIndexBuffer(stream.data(), stream.size(), indices.data(), indices.size());
  std::vector<uint32_t> turned(indices.size());
  REQUIRE(meshopt_decodeIndexBuffer(turned.data(), turned.size(), stream.data(), bytes) == 0);
  return packed(Mode::kTriangles, indices.size(), 4, stream.data(), bytes, bytes_of(turned));
}

inline Packed pack_indices(const std::vector<uint32_t>& indices, size_t vertices) {
  std::vector<unsigned char> stream(meshopt_encodeIndexSequenceBound(indices.size(), vertices));
  const size_t bytes = meshopt_encodeIndexSequence(stream.data(), stream.size(), indices.data(), indices.size());
  return packed(Mode::kIndices, indices.size(), 4, stream.data(), bytes, bytes_of(indices));
}

inline std::vector<uint32_t> grid_indices(uint32_t n) {
  std::vector<uint32_t> indices;
  for (uint32_t j = 0; j < n; ++j)
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t a = j * (n + 1) + i;
      indices.insert(indices.end(), {a, a + 1, a + n + 2, a, a + n + 2, a + n + 1});
    }
  return indices;
}

inline std::vector<float> grid_positions(uint32_t n) {
  std::vector<float> positions;
  for (uint32_t j = 0; j <= n; ++j)
    for (uint32_t i = 0; i <= n; ++i)
      positions.insert(positions.end(),
                       {static_cast<float>(i), static_cast<float>(j), std::sin(0.3f * static_cast<float>(i + j))});
  return positions;
}

inline std::string view_json(const char* extension, const Packed& packed, uint64_t offset) {
  const char* const modes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
  return R"({"buffer":1,"byteLength":)" + std::to_string(packed.raw.size()) + R"(,"extensions":{")" + extension +
         R"(":{"buffer":0,"byteOffset":)" + std::to_string(offset) + R"(,"byteLength":)" +
         std::to_string(packed.stream.size()) + R"(,"byteStride":)" + std::to_string(packed.stated.stride) +
         R"(,"count":)" + std::to_string(packed.stated.count) + R"(,"mode":")" +
         modes[static_cast<size_t>(packed.stated.mode)] + R"("}}})";
}

/// A document with one mesh, whose indices and positions are compressed in mesh.bin, and with a missing fallback
/// buffer.
inline std::string meshopt_document(const TempFolder& folder, const Packed& indices, const Packed& positions,
                                    const char* extension = "EXT_meshopt_compression") {
  Bytes bin = indices.stream;
  bin.insert(bin.end(), positions.stream.begin(), positions.stream.end());
  folder.write("mesh.bin", std::string(reinterpret_cast<const char*>(bin.data()), bin.size()));
  return R"({"asset":{"version":"2.0"},"extensionsUsed":[")" + std::string(extension) +
         R"("],"extensionsRequired":[")" + extension + R"("],"buffers":[{"uri":"mesh.bin","byteLength":)" +
         std::to_string(bin.size()) + R"(},{"byteLength":)" +
         std::to_string(std::max(indices.raw.size(), positions.raw.size())) + R"(,"extensions":{")" + extension +
         R"(":{"fallback":true}}}],"bufferViews":[)" + view_json(extension, indices, 0) + "," +
         view_json(extension, positions, indices.stream.size()) +
         R"(],"accessors":[{"bufferView":0,"componentType":5125,"count":)" + std::to_string(indices.stated.count) +
         R"(,"type":"SCALAR"},{"bufferView":1,"componentType":5126,"count":)" + std::to_string(positions.stated.count) +
         R"(,"type":"VEC3"}],"meshes":[{"primitives":[{"indices":0,"attributes":{"POSITION":1}}]}],)"
         R"("nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0})";
}

}  // namespace scree::tests
