// A GPU joins split pages as join_page() does, and refuses the pages that join_page() or check_chunk() refuses.
#include <algorithm>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "format/geometry/cluster_page.h"
#include "format/geometry/split_streams.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/join/join.h"
#include "runtime/scene/pages.h"
#include "runtime/stream/join_plan.h"
#include "tests/format/geometry/cluster_lists.h"
#include "tests/gpu.h"
#include "tests/results.h"

using namespace scree;
using namespace scree::tests;
using kernels::DeviceBuffer;
using kernels::JoinTask;
using runtime::JoinChunk;

namespace {

using Bytes = std::vector<std::byte>;

/// A page with its chunks.
struct Page {
  Bytes raw;
  std::vector<std::pair<format::MeshRecord, format::ChunkRecord>> chunks;

  void add(const ClusteredChunk& chunk) {
    auto& [mesh, record] = chunks.emplace_back(chunk.mesh, chunk.record);
    record.offset = raw.size();
    raw.insert(raw.end(), chunk.payload.begin(), chunk.payload.end());
    record.bytes = raw.size() - record.offset;
  }
  void add_plain(size_t bytes) { raw.resize(raw.size() + bytes, std::byte{0x5a}); }

  Bytes split() const {
    std::vector<format::PageClusters> clusters;
    for (const auto& [mesh, record] : chunks)
      if (record.encoding == format::ChunkEncoding::kClustered)
        clusters.push_back({record.offset, record.cluster_count});
    Bytes bytes = format::split_page(raw, clusters).bytes;
    REQUIRE(!bytes.empty());
    return bytes;
  }
  std::vector<JoinChunk> drawn() const {
    std::vector<JoinChunk> drawn;
    for (const auto& [mesh, record] : chunks) drawn.push_back({&mesh, &record});
    return drawn;
  }
};

Page page_of(const List& list) {
  Page page;
  page.add(encode(list));
  return page;
}

/// The raw page, joined and checked by the CPU; none if the CPU refuses it.
std::optional<Bytes> join_here(const Bytes& split, const Page& page) {
  Bytes raw(page.raw.size());
  if (!format::join_page(split, raw)) return std::nullopt;
  for (const auto& [mesh, record] : page.chunks)
    if (!runtime::check_chunk(mesh, record, raw)) return std::nullopt;
  return raw;
}

DeviceBuffer to_device(std::span<const std::byte> bytes, size_t room) {
  DeviceBuffer buffer = must(DeviceBuffer::allocate(room, "a test"));
  must(kernels::cuda_check(cudaMemcpy(buffer.data(), bytes.data(), bytes.size(), cudaMemcpyHostToDevice), "a test"));
  return buffer;
}

/// As above, by the GPU. `shift`: offset of the split page in its slot.
std::optional<Bytes> join_there(const Bytes& split, const Page& page, uint32_t shift = 0) {
  runtime::JoinPlan plan;
  if (!plan.add_split(split, page.raw.size(), page.drawn(), {shift, 0})) return std::nullopt;
  Bytes slot(shift);
  slot.insert(slot.end(), split.begin(), split.end());
  const DeviceBuffer from = to_device(slot, format::align_up(slot.size(), 4));
  const auto task_bytes = std::as_bytes(std::span(plan.tasks()));
  const DeviceBuffer tasks = to_device(task_bytes, task_bytes.size());
  const DeviceBuffer history =
      must(DeviceBuffer::allocate(std::max<uint64_t>(plan.history_words(), 1) * sizeof(uint32_t), "a test"));
  const DeviceBuffer arena = to_device(Bytes(page.raw.size(), std::byte{0xee}), page.raw.size());
  kernels::PinnedBuffer failed;
  must(failed.allocate(sizeof(uint32_t), "a test"));
  auto* const is_bad = reinterpret_cast<uint32_t*>(failed.data());
  *is_bad = 0;
  const kernels::JoinSlot memory{reinterpret_cast<const JoinTask*>(tasks.data()),
                                 static_cast<uint32_t>(plan.tasks().size()), from.data(),
                                 reinterpret_cast<uint32_t*>(history.data()), is_bad};
  must(kernels::join_parts({&memory, 1}, arena.data(), nullptr));
  Bytes raw(page.raw.size());
  must(kernels::cuda_check(cudaMemcpy(raw.data(), arena.data(), raw.size(), cudaMemcpyDeviceToHost), "a test"));
  if (*is_bad != 0) return std::nullopt;
  return raw;
}

void check_page(const Page& page) {
  const Bytes split = page.split();
  REQUIRE(join_here(split, page) == page.raw);
  for (const uint32_t shift : {0u, 5u}) CHECK(join_there(split, page, shift) == page.raw);
}

/// A chunk with colours behind its clusters.
ClusteredChunk with_colors(const List& list, uint32_t color) {
  ClusteredChunk chunk = encode(list);
  chunk.mesh.attributes = format::kHasColor;
  for (uint32_t v = 0; v < chunk.record.vertex_count; ++v) {
    const uint32_t value = color + v * 3;
    const auto* const bytes = reinterpret_cast<const std::byte*>(&value);
    chunk.payload.insert(chunk.payload.end(), bytes, bytes + 4);
  }
  chunk.payload.resize(format::chunk_streams(chunk.mesh, chunk.record).bytes);
  return chunk;
}

/// A page of several chunks, some with attributes, and of bytes that belong to none.
Page mixed_page() {
  std::mt19937 random(5);
  Page page;
  page.add_plain(48);
  page.add(with_colors(grid_list(9, 300, 20), 7));
  page.add(encode(soup(random, 100, 60, 10)));
  page.add(with_colors(grid_list(13, 40, 11), 1 << 20));
  page.add_plain(100'000);
  page.add(encode(grid_list(3, 1, 1)));
  page.add_plain(13);
  return page;
}

}  // namespace

TEST_CASE("a GPU joins split pages byte for byte", "[cuda][cluster_page]") {
  if (!has_gpu()) return;
  check_page(page_of(grid_list(1, 1, 0)));
  check_page(page_of(grid_list(8, 100, 3)));
  check_page(page_of(grid_list(20, 1, 0)));                               // no bits of z
  check_page(page_of(grid_list(kEmulatesGpu ? 40 : 200, 83800, 80000)));  // 24 bits
  check_page(page_of(grid_list(kEmulatesGpu ? 68 : 300, 377, 50)));       // more than two groups of clusters
  std::mt19937 random(7);
  for (const uint32_t bits : {8u, 15u, 16u, 24u})
    for (const uint32_t vertices : {40u, 70u, 900u}) check_page(page_of(soup(random, 700, vertices, bits)));
  check_page(mixed_page());
}

TEST_CASE("a GPU refuses the split pages that a CPU refuses", "[cuda][cluster_page]") {
  if (!has_gpu()) return;
  std::mt19937 random(11);
  std::vector<Page> pages = {page_of(grid_list(12, 3000, 200)), page_of(grid_list(17, 11, 3)), mixed_page()};
  for (const uint32_t vertices : {40u, 70u, 300u}) pages.push_back(page_of(soup(random, 400, vertices, 13)));
  size_t accepted = 0, refused = 0;
  for (size_t i = 0; i < pages.size(); ++i) {
    const Page& page = pages[i];
    const Bytes split = page.split();
    const auto streams = must(format::split_streams::open_streams(split));
    for (int round = 0; round < (kEmulatesGpu ? 150 : 1500); ++round) {
      Bytes changed = split;
      // Few bytes are changed, and all streams equally often: most bytes are residuals, which may have any value.
      for (auto changes = random() % 3 + 1; changes != 0; --changes) {
        const auto& stream = streams.bytes[random() % format::split_streams::kStreams];
        const size_t at = stream.empty() || random() % 16 == 0
                              ? random() % changed.size()
                              : static_cast<size_t>(stream.data() - split.data()) + random() % stream.size();
        changed[at] = random() % 2 == 0 ? static_cast<std::byte>(random()) : changed[at] ^ std::byte{1};
      }
      const auto here = join_here(changed, page);
      const auto there = join_there(changed, page);
      CAPTURE(i, round);
      if (here != there)
        FAIL("the GPU " << (there ? "accepts" : "refuses") << ", the CPU " << (here ? "accepts" : "refuses"));
      (here ? accepted : refused) += 1;
    }
  }
  CHECK(accepted > 50);
  CHECK(refused > 50);
}

TEST_CASE("split pages whose clusters are not those of the drawn chunks are left to the CPU", "[cluster_page]") {
  const Page page = mixed_page();
  const Bytes split = page.split();
  const auto is_planned = [&](std::span<const JoinChunk> chunks) {
    runtime::JoinPlan plan;
    const bool planned = plan.add_split(split, page.raw.size(), chunks, {});
    CHECK(planned == !plan.tasks().empty());
    return planned;
  };
  std::vector<JoinChunk> chunks = page.drawn();
  CHECK(is_planned(chunks));
  CHECK_FALSE(is_planned(std::span(chunks).first(3)));
  CHECK_FALSE(is_planned(std::span(chunks).subspan(1)));
  std::swap(chunks[0], chunks[1]);
  CHECK_FALSE(is_planned(chunks));
  chunks = page.drawn();
  format::ChunkRecord other = *chunks[1].chunk;
  chunks[1].chunk = &other;
  for (uint32_t format::ChunkRecord::*const field :
       {&format::ChunkRecord::cluster_count, &format::ChunkRecord::triangle_count,
        &format::ChunkRecord::vertex_count}) {
    ++(other.*field);
    CHECK_FALSE(is_planned(chunks));
    --(other.*field);
  }
  other.position_bits[1] = 25;
  CHECK_FALSE(is_planned(chunks));
}
