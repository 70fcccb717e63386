// A scene with more buffer files than are kept open.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// Writes scene.gltf: one mesh with one primitive per entry of `points` (3 floats per corner, 3 corners per triangle),
/// each of which lies in its own file 0.bin, 1.bin, ... Returns the path.
inline std::string write_many_files(const TempFolder& folder, const std::vector<std::vector<float>>& points) {
  std::string buffers, views, accessors, primitives;
  for (size_t i = 0; i < points.size(); ++i) {
    const std::string number = std::to_string(i);
    const std::string comma = i == 0 ? "" : ",";
    std::string bytes(points[i].size() * sizeof(float), '\0');
    std::memcpy(bytes.data(), points[i].data(), bytes.size());
    folder.write(number + ".bin", bytes);
    const std::string length = std::to_string(bytes.size());
    buffers += comma + R"({"byteLength":)" + length + R"(,"uri":")" + number + R"(.bin"})";
    views += comma + R"({"byteLength":)" + length + R"(,"buffer":)" + number + "}";
    accessors += comma + R"({"componentType":5126,"count":)" + std::to_string(points[i].size() / 3) +
                 R"(,"type":"VEC3","bufferView":)" + number + "}";
    primitives += comma + R"({"attributes":{"POSITION":)" + number + "}}";
  }
  return folder.write("scene.gltf", R"({"asset":{"version":"2.0"},"buffers":[)" + buffers + R"(],"bufferViews":[)" +
                                        views + R"(],"accessors":[)" + accessors + R"(],"meshes":[{"primitives":[)" +
                                        primitives + R"(]}],"nodes":[{"mesh":0}]})");
}

/// `count` triangles. The x of each one's first corner is its index.
inline std::vector<std::vector<float>> many_triangles(size_t count) {
  std::vector<std::vector<float>> points;
  for (size_t i = 0; i < count; ++i) points.push_back({static_cast<float>(i), 0, 0, 1, 0, 0, 0, 1, 0});
  return points;
}

}  // namespace scree::tests
