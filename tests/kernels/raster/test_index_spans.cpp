// Draws indices of every width of the format: the same triangles over adjacent vertices and over vertices up to 2^32
// apart. A valid file states no more bits than its vertices need (spec/container.md 5.2), so 32 bits would need a chunk
// of 716 million triangles. The kernels use the widths of a record without that check; here only the few used vertices
// take memory.
#include <bit>
#include <memory>
#include <span>
#include <vector>

#include "kernels/frame.h"
#include "tests/format/geometry/guarded_bytes.h"
#include "tests/kernels/scene_builder.h"
#include "tests/kernels/shade_samples.h"
#include "tests/sanitized.h"

using namespace scree;
using namespace scree::tests;
using kernels::SceneView;
using kernels::View;

namespace {

constexpr uint32_t kLastVertex = UINT32_MAX - 1;  // for the largest vertex_count

/// A sphere with texture coordinates, colours and normals, all different.
Soup ball() {
  Soup soup = sphere(8, 0.2);
  for (size_t v = 0; v < soup.positions.size() / 3; ++v) {
    const float* const p = &soup.positions[3 * v];
    soup.uvs.insert(soup.uvs.end(), {3 * p[0] + 1, 2 * p[1]});
    soup.colors.insert(soup.colors.end(), {std::fabs(p[0]) / 2, std::fabs(p[1]) / 2, std::fabs(p[2]) / 2, 1});
    soup.normals.insert(soup.normals.end(), p, p + 3);
  }
  return soup;
}

/// The sphere's chunk as encoded, drawn twice.
void build(SceneBuilder& builder, const Encoding& encoding) {
  const uint32_t mesh = builder.mesh(ball(), encoding);
  REQUIRE(builder.chunks.size() == 1);
  builder.instance(mesh, builder.identity());
  builder.instance(mesh, builder.matrix({-0.6, 0.1, 0, 1.3, 0, 0.5, 0.2, 0.4, 0, 0, 0.7, -0.3}));
}

std::vector<Encoding> encodings() {
  Encoding fine;  // more than 64 bits per vertex
  fine.exponent = -20;
  return {Encoding{}, fine, float32()};
}

std::vector<uint32_t> indices_of(SceneBuilder& builder) {
  const format::ChunkRecord& chunk = builder.chunks[0];
  const format::ChunkStreams streams = format::chunk_streams(builder.meshes[0], chunk);
  std::vector<uint32_t> indices(3 * size_t{chunk.triangle_count});
  REQUIRE(format::decode_indices(indices, chunk.vertex_count, {chunk.index_min, chunk.index_bits},
                                 std::span(builder.pages[0]).subspan(streams.indices.offset, streams.indices.bytes)));
  return indices;
}

/// All results for a scene: samples by each path of the CPU, and shaded pictures.
struct Pictures {
  std::vector<uint64_t> samples;
  std::vector<float> shaded;
  bool operator==(const Pictures&) const = default;
};

Pictures pictures(const SceneView& scene) {
  Pictures out;
  for (const View& view :
       {look_at({0.4, 0.7, 3}, {0.3, 0, 0}, 120, 90), look_at({0.1, 0, 0.3}, {1, 0.2, 0}, 40, 40, 0.01),
        orthographic(look_at({0.4, 0.7, 3}, {0.3, 0, 0}, 80, 60), 1.4, 0.5, 8)}) {
    const std::vector<uint64_t> samples = draw(scene, view);
    CHECK(covered(samples) > 300);
    CHECK(draw(scene, view, 2) == samples);
    CHECK(draw_with(scene, view, 2, kernels::InstructionSet::kBaseline, {.block_triangles = 50}) == samples);
    out.samples.insert(out.samples.end(), samples.begin(), samples.end());
    for (const kernels::Show show : {kernels::Show::kColor, kernels::Show::kUv, kernels::Show::kNormal}) {
      const kernels::ShadeOptions options{.show = show};
      std::vector<float> shaded(4 * samples.size());
      scree::tests::shade_samples(scene, view, samples, options, shaded);
      out.shaded.insert(out.shaded.end(), shaded.begin(), shaded.end());
    }
  }
  return out;
}

/// Copies the item of `bits` bits at index `from_item` of a stream to index `to_item` of another, which must be zero
/// there.
void copy_item(const std::byte* from, uint64_t from_item, std::byte* to, uint64_t to_item, uint32_t bits) {
  for (uint64_t i = 0; i < bits; ++i) {
    const uint64_t at = from_item * bits + i, place = to_item * bits + i;
    const auto bit = std::to_integer<uint32_t>(from[at / 8] >> (at % 8)) & 1u;
    to[place / 8] |= static_cast<std::byte>(bit << (place % 8));
  }
}

/// The payload of the builder's chunk with its vertices spread out: the first at number `first`, the last `span` behind
/// it. Changes the chunk's record, whose page has to be set to the result. Null if the system grants no such address
/// range.
std::unique_ptr<SparseBytes> spread(SceneBuilder& builder, std::vector<uint32_t> indices, uint32_t first,
                                    uint32_t span) {
  const format::MeshRecord& mesh = builder.meshes[0];
  format::ChunkRecord& chunk = builder.chunks[0];
  const format::ChunkStreams from = format::chunk_streams(mesh, chunk);
  const uint64_t vertices = chunk.vertex_count;
  const auto place = [&](uint64_t vertex) { return first + vertex * span / (vertices - 1); };
  for (uint32_t& index : indices) index = static_cast<uint32_t>(place(index));
  const format::IndexRange range = scree::tests::index_range(indices);
  REQUIRE(range.min == first);
  chunk.index_min = range.min;
  chunk.index_bits = static_cast<uint8_t>(range.bits);
  chunk.vertex_count = first + span + 1;
  const format::ChunkStreams to = format::chunk_streams(mesh, chunk);
  chunk.bytes = to.bytes;
  auto out = std::make_unique<SparseBytes>(to.bytes);
  if (!*out) return nullptr;
  const std::byte* const page = builder.pages[0].data();
  format::encode_indices(out->bytes().first(to.indices.bytes), indices, range);
  const auto copy = [&](const format::ChunkStream& a, const format::ChunkStream& b, uint32_t bits) {
    for (uint64_t vertex = 0; vertex < vertices; ++vertex)
      copy_item(page + a.offset, vertex, out->bytes().data() + b.offset, place(vertex), bits);
  };
  uint32_t position_bits = 0;
  for (const uint8_t bits : chunk.position_bits) position_bits += bits;
  copy(from.positions, to.positions, position_bits);
  copy(from.uvs, to.uvs, uint32_t{chunk.uv_bits[0]} + chunk.uv_bits[1]);
  copy(from.colors, to.colors, 32);
  copy(from.normals, to.normals, 2 * uint32_t{chunk.normal_bits});
  return out;
}

}  // namespace

TEST_CASE("hard: indices with more bits than needed, up to 32, draw the same", "[raster][hard]") {
  for (const Encoding& encoding : encodings()) {
    SceneBuilder builder;
    build(builder, encoding);
    const std::vector<uint32_t> indices = indices_of(builder);
    const Pictures expected = pictures(builder.view());
    format::ChunkRecord& chunk = builder.chunks[0];
    const std::vector<std::byte> page = builder.pages[0];
    const uint64_t tight_bytes = format::chunk_streams(builder.meshes[0], chunk).indices.bytes;
    REQUIRE(chunk.index_bits < 10);
    for (uint32_t bits = chunk.index_bits + 1u; bits <= 32; ++bits) {
      CAPTURE(bits, encoding.exponent, encoding.float32);
      chunk.index_bits = static_cast<uint8_t>(bits);
      std::vector<std::byte>& wide = builder.pages[0];
      wide.resize(format::packed_bytes(indices.size(), bits));
      format::encode_indices(wide, indices, {chunk.index_min, bits});
      wide.insert(wide.end(), page.begin() + static_cast<ptrdiff_t>(tight_bytes), page.end());
      CHECK((pictures(builder.view()) == expected));
    }
  }
}

TEST_CASE("hard: index spans around 2^7 to 2^32 are drawn", "[raster][hard]") {
  std::vector<uint32_t> spans{kLastVertex};
  // The CPU changes its way of reading at 20 bits.
  for (uint32_t k = 7; k < 32; k = k == 8 ? 16 : k + (kIsSanitized && k >= 16 ? 4 : 1))
    for (const uint32_t span : {(1u << k) - 1, 1u << k, (1u << k) + 1}) spans.push_back(span);
  for (const Encoding& encoding : encodings()) {
    SceneBuilder builder;
    build(builder, encoding);
    const std::vector<uint32_t> indices = indices_of(builder);
    const Pictures expected = pictures(builder.view());
    const format::ChunkRecord chunk = builder.chunks[0];
    for (const uint32_t span : spans) {
      for (const uint32_t first : {0u, kLastVertex - span}) {
        if (first == 0 && !std::has_single_bit(span)) continue;  // at the end only, where vertices are farther away
        CAPTURE(span, first, encoding.exponent, encoding.float32);
        builder.chunks[0] = chunk;
        const std::unique_ptr<SparseBytes> page = spread(builder, indices, first, span);
        if (!page) {
          WARN("no room for a sparse page: skipped");
          return;
        }
        const SceneView scene = builder.view();
        builder.page_pointers[0] = page->bytes().data();
        CHECK((pictures(scene) == expected));
      }
    }
  }
}
