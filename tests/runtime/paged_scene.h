// .scree files with many geometry pages of all kinds, written without glTF.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "tests/kernels/scene_builder.h"
#include "tests/runtime/small_scene.h"

namespace scree::tests {

/// Writes one mesh per soup, drawn once. Chunks lie in pages of about `page_bytes` (a larger chunk has its own page).
/// Every `zstd_every`th page is compressed, split if it has clusters, and an image page follows every `image_every`th.
/// `change` may alter page `number` before it is written, `change_tables` the tables.
struct PagedScene {
  uint64_t page_bytes = 9000;
  uint32_t zstd_every = 3, image_every = 4, chunk_triangles = 300;
  bool drawn_twice = false;  // every mesh has two instances
  std::function<void(uint32_t number, format::SealedPage& page)> change;
  std::function<void(format::TableSet& tables)> change_tables;

  void write(const std::string& path, const std::vector<std::pair<Soup, Encoding>>& meshes) const {
    SceneBuilder builder;
    for (auto [soup, encoding] : meshes) {
      encoding.chunk_triangles = std::min(encoding.chunk_triangles, chunk_triangles);
      builder.mesh(soup, encoding);
    }
    format::ContainerWriter writer = must(format::ContainerWriter::create(path));
    format::TableSet tables;
    uint32_t pages = 0;
    std::vector<format::PageClusters> clusters;
    const auto append = [&](format::PageKind kind, std::vector<std::byte> raw, int level) {
      format::SealedPage page = format::seal_page(kind, std::move(raw), level, std::exchange(clusters, {}));
      if (change) change(pages, page);
      REQUIRE(writer.append(page));
      ++pages;
    };
    std::vector<std::byte> raw;
    const auto flush = [&] {
      if (raw.empty()) return;
      append(format::PageKind::kGeometry, std::move(raw), pages % zstd_every == 0 ? 3 : 0);
      raw.clear();
      if (pages % image_every == 0) append(format::PageKind::kImage, four_colors_png(), 0);
    };
    for (format::ChunkRecord& chunk : builder.chunks) {
      const std::vector<std::byte>& payload = builder.pages[chunk.page];
      if (raw.size() + chunk.bytes > page_bytes) flush();
      chunk.page = pages;
      chunk.offset = raw.size();
      if (chunk.encoding == format::ChunkEncoding::kClustered) clusters.push_back({raw.size(), chunk.cluster_count});
      raw.insert(raw.end(), payload.begin(), payload.begin() + static_cast<ptrdiff_t>(chunk.bytes));
    }
    flush();

    const uint32_t copies = drawn_twice ? 2 : 1;
    uint64_t triangles = 0;
    for (uint32_t m = 0; m < builder.meshes.size(); ++m) {
      format::MeshRecord& mesh = builder.meshes[m];
      mesh.group = m;
      mesh.max_position_error = mesh.position_encoding == format::PositionEncoding::kFloat32 ? 0 : 1;
      tables.groups.push_back({tables.strings.add("Mesh " + std::to_string(m)), m, 1, 0});
      for (uint32_t i = 0; i < copies; ++i) {
        tables.instances.push_back({m, static_cast<uint32_t>(tables.nodes.size()), 0, 0});
        tables.scene_roots.push_back(static_cast<uint32_t>(tables.nodes.size()));
        tables.nodes.push_back(SmallScene::node(tables, "Node", format::kNone, m, format::kNone));
        triangles += mesh.triangle_count;
      }
    }
    tables.meshes = builder.meshes;
    tables.chunks = builder.chunks;
    tables.matrices.push_back(SmallScene::identity());
    tables.scenes.push_back(
        {tables.strings.add("Main"), 1, 0, tables.instances.size(), 0, tables.scene_roots.size(), triangles});
    if (change_tables) change_tables(tables);
    REQUIRE(writer.finish(tables));
  }
};

}  // namespace scree::tests
