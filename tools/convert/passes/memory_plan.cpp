#include "tools/convert/passes/memory_plan.h"

#include <algorithm>
#include <bit>
#include <memory>
#include <string>

#include "tools/common/options/options.h"
#include "tools/common/process/memory_use.h"
#include "tools/convert/passes/encode_pass.h"
#include "tools/convert/passes/resume.h"
#include "tools/convert/plan/mesh_plan.h"
#include "tools/convert/plan/scene_tables.h"
#include "tools/convert/windows/held_windows.h"
#include "tools/convert/windows/locality.h"
#include "tools/convert/windows/read_ahead.h"
#include "tools/gltf/meshopt/source.h"

namespace scree::convert {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;

// The allocator's rounding, code that is not counted below, and a thread's memory beside its scratch memory.
constexpr uint64_t kOtherBytes = 12 * kMiB;
constexpr uint64_t kThreadBytes = 3 * kMiB;

// Bytes of encoded windows in flight if memory suffices; a higher limit would not be faster.
constexpr uint64_t kFlightBytes = 64 * kMiB;
constexpr uint64_t kFlightBytesPerThread = 12 * kMiB;

// Bytes of measured windows that are held until they are encoded: about seven windows of scene C per thread.
constexpr uint64_t kHeldBytesPerThread = 40 * kMiB;

// Memory per primitive (measured, planned, recorded) and per instance (its matrix, and its entry in a hash table).
constexpr uint64_t kPrimitiveBytes = 600;
constexpr uint64_t kInstanceBytes = 400;

/// Least memory for the new vertex numbers of a primitive that is sorted.
constexpr uint64_t kLeastMapBytes = kMiB;

// A typical window of indexed triangles that share vertices: one vertex per triangle, and two at the beginning, as in a
// strip. A closed surface has half as many vertices. Its last triangles use its first vertices, so a span of vertex
// numbers may be the whole primitive's.
constexpr uint64_t kFirstVertices = 2;

/// The minimum in the error is a multiple of this, so that it still suffices if the process takes a few pages more.
constexpr uint64_t kLeastStep = 4 * kMiB;

uint64_t chunks_of(uint64_t triangles, uint64_t chunk_triangles) {
  return chunk_triangles == 0 ? 1 : triangles / chunk_triangles + 2;
}

}  // namespace

bool may_sort(const ConvertOptions& options) {
  return options.chunk_triangles != 0 && options.order != Order::kNone;
}

uint64_t kept_view_bytes(uint64_t memory) {
  return std::min(MeshoptCache::kKeptBytes, memory / 4);
}

uint64_t read_ahead_bytes(uint64_t memory) {
  return std::min(512 * kMiB, memory / 4);
}

Result<MemoryPlan> MemoryPlan::make(const ConvertOptions& options, const SourceScene& scene,
                                    const std::vector<bool>& wanted, uint64_t image_bytes, uint32_t threads) {
  MemoryPlan plan;
  plan.memory_ = options.memory;
  plan.threads_ = threads;
  plan.chunk_triangles_ = options.chunk_triangles;
  plan.zstd_level_ = options.zstd_level;
  plan.clustered_ = options.encoding == Encoding::kClustered;
  plan.source_ids_ = options.source_ids;
  plan.views_ = scene.view_memory;
  plan.vertex_bits_ = 96;
  plan.primitives_ = wanted.size();
  uint64_t sort_bytes = 0, of_group = 0;
  bool has_uv = false, has_color = false, has_normal = false, has_second_uv = false, has_tangent = false;
  for (size_t i = 0; i < wanted.size(); ++i) {
    if (!wanted[i]) continue;
    const Primitive& primitive = scene.primitives[i];
    const uint64_t all = primitive.triangle_count();
    const uint64_t triangles = options.chunk_triangles == 0 ? all : std::min(all, kWindowTriangles);
    plan.most_.triangles = std::max(plan.most_.triangles, triangles);
    plan.most_.vertices = std::max(plan.most_.vertices, std::min(3 * triangles, primitive.vertex_count()));
    plan.most_.span = std::max(plan.most_.span, primitive.indices ? primitive.vertex_count() : 3 * triangles);
    plan.most_.chunks += chunks_of(all, options.chunk_triangles);
    const uint64_t usual_vertices = primitive.indices ? triangles + kFirstVertices : 3 * triangles;
    const uint64_t usual_span = primitive.indices ? std::min(kBitmapSpan, primitive.vertex_count()) : 3 * triangles;
    plan.usual_.vertices = std::max(plan.usual_.vertices, std::min(usual_vertices, primitive.vertex_count()));
    plan.usual_.span = std::max(plan.usual_.span, usual_span);
    plan.id_bits_ = std::max(plan.id_bits_, static_cast<uint32_t>(std::bit_width(all)));
    if (may_sort(options) && all > triangles) {
      const SortNeeds needs = sort_needs(primitive, std::min(primitive.vertex_count(), kMostVertices * all),
                                         options.normals != Normals::kNever);
      sort_bytes = std::max(sort_bytes, needs.shared_bytes + needs.thread_bytes + kThreadBytes + kLeastMapBytes);
    }
    const uint64_t windows = triangles == 0 ? 0 : (all - 1) / triangles + 1;
    plan.windows_ += windows;
    of_group = (i > 0 && scene.primitives[i - 1].group == primitive.group ? of_group : 0) + windows;
    plan.group_windows_ = std::max(plan.group_windows_, of_group);
    has_uv |= primitive.uv.has_value();
    has_color |= primitive.color.has_value();
    has_normal |= primitive.normal.has_value();
    has_second_uv |= primitive.second_uv() != nullptr;
    has_tangent |= primitive.tangent() != nullptr;
  }
  plan.usual_.triangles = plan.most_.triangles;
  plan.usual_.chunks = plan.most_.chunks;
  has_tangent = has_tangent && options.normals != Normals::kNever;
  plan.vertex_bits_ += (has_uv ? 48u : 0u) + (has_color ? 32u : 0u) +
                       (has_normal && options.normals != Normals::kNever ? 2 * kNormalBits : 0u) +
                       (has_second_uv ? 48u : 0u) + (has_tangent ? kTangentBits : 0u);
  // While a window is encoded, the second texture coordinates stay in memory beside another attribute. Tangents are
  // measured together with normals and texture coordinates.
  plan.attribute_components_ = has_tangent ? 9
                                           : (has_color    ? 4
                                              : has_normal ? 3
                                              : has_uv     ? 2
                                                           : 0) +
                                                 (has_second_uv ? 2 : 0);

  uint64_t held_instances = 0;
  for (const SourceNode& node : scene.nodes) held_instances += node.instances ? node.instances->count : 1;
  held_instances = std::min(held_instances, kMaxHeldInstances + scene.nodes.size());
  const uint64_t tables = 3 * sizeof(WindowPlan) * plan.windows_ + kPrimitiveBytes * wanted.size() +
                          kInstanceBytes * held_instances + plan.table_bytes(plan.most_);
  const uint64_t encode_bytes =
      plan.encode_thread_bytes(plan.most_) + plan.encoded_bytes(plan.most_) + 4 * plan.page_bytes(plan.most_);
  const uint64_t geometry = tables + std::max({plan.measure_thread_bytes(plan.most_), sort_bytes, encode_bytes});
  const uint64_t rest = tools::memory_use().anonymous + kOtherBytes + std::max(geometry, image_bytes + kThreadBytes);
  const uint64_t reader = plan.views_.reader_bytes;
  // The cache of unpacked views gets a quarter of the total.
  const uint64_t beside = rest + plan.views_.place_bytes + reader;
  const uint64_t least = beside + std::max(reader, std::min(plan.views_.kept_bytes, beside / 3));
  if (least > options.memory)
    return Error{ErrorCode::kUsage,
                 "--memory: " + tools::format_bytes(options.memory) + ", but " + scene.file_name + " needs at least " +
                     std::to_string((least / kLeastStep + 2) * kLeastStep / kMiB) + " MiB with these options"};
  return plan;
}

StageLimits MemoryPlan::measure() const {
  const uint64_t a_thread = measure_thread_bytes(most_) + views_.reader_bytes;
  const uint64_t left = free_bytes(unpacking_threads(threads_) * views_.reader_bytes);
  return {static_cast<uint32_t>(std::clamp<uint64_t>(left / a_thread, 1, threads_)), 0};
}

SortLimits MemoryPlan::sort(const SortNeeds& needs) const {
  const uint64_t left = free_bytes(needs.shared_bytes + views_.reader_bytes);
  const uint64_t a_thread = needs.thread_bytes + kThreadBytes + views_.reader_bytes;
  const uint64_t map = std::min(needs.map_bytes, left / 2);
  const uint64_t threads = std::clamp<uint64_t>((left - map) / a_thread, 1, threads_);
  const uint64_t map_bytes = left - std::min(left, threads * a_thread);
  return {static_cast<uint32_t>(threads), std::max(map_bytes, kLeastMapBytes) / sizeof(uint32_t)};
}

StageLimits MemoryPlan::images(uint64_t most) const {
  const uint64_t threads = std::clamp<uint64_t>(free_bytes() / 4 / kThreadBytes, 1, threads_);
  const uint64_t taken = threads * kThreadBytes;
  return {static_cast<uint32_t>(threads), std::min(most, free_bytes(taken))};
}

std::optional<AheadLimits> MemoryPlan::ahead() const {
  const std::optional<AheadLimits> any = ahead_of(most_);
  return any ? any : ahead_of(usual_);
}

uint64_t MemoryPlan::most_stored_bytes(const Primitive& primitive) const {
  const uint64_t triangles = primitive.triangle_count();
  const uint64_t step = chunk_triangles_ == 0 ? std::max<uint64_t>(triangles, 1) : kWindowTriangles;
  uint64_t bytes = 512 * chunks_of(triangles, chunk_triangles_);
  for (uint64_t first = 0; first < triangles; first += step) {
    WindowNeeds needs;
    needs.triangles = std::min(step, triangles - first);
    needs.vertices = std::min(3 * needs.triangles, primitive.vertex_count());
    bytes += encoded_bytes(needs) + 1024;
  }
  return bytes;
}

StageLimits MemoryPlan::encode(const std::vector<WindowPlan>& windows) const {
  WindowNeeds needs;
  for (const WindowPlan& window : windows) {
    needs.triangles = std::max(needs.triangles, window.count);
    needs.vertices = std::max(needs.vertices, uint64_t{window.vertices});
    needs.span = std::max(needs.span, uint64_t{window.span});
    needs.chunks += chunks_of(window.kept, chunk_triangles_);
  }
  const uint64_t tables = table_bytes(needs) + 2 * page_bytes(needs);  // one page is being filled, one written
  const uint64_t left = free_bytes(tables);
  const uint64_t a_result = encoded_bytes(needs);
  const uint64_t a_thread = encode_thread_bytes(needs) + views_.reader_bytes + 2 * page_bytes(needs);
  const uint64_t threads = std::clamp<uint64_t>(left / (a_thread + a_result), 1, threads_);
  const uint64_t flight = left - std::min(left, threads * a_thread);
  return {static_cast<uint32_t>(threads),
          std::clamp(flight, threads * a_result, threads * a_result + kFlightBytes + kFlightBytesPerThread * threads)};
}

uint64_t MemoryPlan::free_bytes(uint64_t beside) const {
  tools::trim_heap();  // free memory that earlier stages left in the heap would count twice
  const uint64_t kept = std::max(views_.reader_bytes, std::min(views_.kept_bytes, kept_view_bytes(memory_)));
  const uint64_t taken = tools::memory_use().anonymous + kOtherBytes + kept + views_.place_bytes;
  return memory_ - std::min(memory_, taken + beside);
}

std::optional<AheadLimits> MemoryPlan::ahead_of(const WindowNeeds& window) const {
  // Beside the tables, the result of each window and the plan of each mesh are kept until everything is measured.
  // The windows of a glTF mesh are collected in three lists: as measured, as held, and as items to encode.
  constexpr uint64_t kWaitingBytes = sizeof(WindowPlan) + 2 * sizeof(std::unique_ptr<HeldWindow>) + sizeof(EncodeItem);
  const uint64_t outcomes = window.chunks * (sizeof(format::ChunkRecord) + sizeof(uint64_t)) +
                            windows_ * sizeof(WindowOutcome) + primitives_ * sizeof(PlannedMesh) +
                            group_windows_ * kWaitingBytes;
  // One page is being filled, one is being written, and one is copied for a rollback.
  const uint64_t tables = table_bytes(window) + 2 * outcomes + 3 * page_bytes(window);
  const uint64_t left = free_bytes(tables + unpacking_threads(threads_) * views_.reader_bytes);
  const uint64_t a_result = encoded_bytes(window);
  // A thread measures and encodes in the same window.
  const uint64_t a_thread = measure_thread_bytes(most_) + encode_thread_bytes(window) - window_bytes(window) -
                            kThreadBytes + views_.reader_bytes + 2 * page_bytes(window);
  const uint64_t threads = std::min<uint64_t>(left / (a_thread + a_result), threads_);
  if (4 * threads < 3 * uint64_t{measure().threads}) return std::nullopt;
  const uint64_t rest = left - threads * (a_thread + a_result);
  const uint64_t held = std::min(rest / 4 * 3, kHeldBytesPerThread * threads);
  return AheadLimits{static_cast<uint32_t>(threads),
                     threads * a_result + std::min(rest - held, kFlightBytes + kFlightBytesPerThread * threads), held,
                     window};
}

/// The vectors of Window. They keep the size of the largest window, and windows are numbered in three ways
/// (window.cpp).
uint64_t MemoryPlan::window_bytes(const WindowNeeds& needs) const {
  const uint64_t table = std::min(needs.span, most_table_span(3 * needs.triangles));
  uint64_t bytes = 20 * needs.triangles + 4 * table + 12 * needs.vertices;
  bytes += std::max(5 * table, std::min(needs.span, kBitmapSpan) * 3 / 16);
  if (needs.span > kBitmapSpan) bytes += 48 * needs.triangles;
  return bytes;
}

uint64_t MemoryPlan::measure_thread_bytes(const WindowNeeds& needs) const {
  return window_bytes(needs) + 2 * 4 * attribute_components_ * needs.vertices + 12 * needs.triangles + kThreadBytes;
}

/// EncodeScratch, and the encoder's memory while it works.
uint64_t MemoryPlan::encode_thread_bytes(const WindowNeeds& needs) const {
  const uint64_t t = needs.triangles, v = needs.vertices;
  uint64_t bytes = window_bytes(needs);
  bytes += 4 * v + 12 * v + 4 * attribute_components_ * v;  // slots, coordinates, floats
  bytes += 8 * std::min(3 * t, v + v / 2);                  // vertices of all chunks
  bytes += 29 * t + 12 * v;                                 // FifoOrder
  const uint64_t scattered = std::min(t, needs.span / 12);  // triangles of a window that is numbered by first use
  bytes += 12 * scattered + 4 * std::min(v, 3 * scattered);
  bytes += 4 * std::bit_ceil(v + v / 4 + 2) + 13 * v;  // Welder
  if (clustered_) bytes += 30 * t + 20 * v + 2 * encoded_bytes(needs);
  if (clustered_ && source_ids_) bytes += 4 * t;  // the order of triangles
  const uint64_t chunk = chunk_triangles_ == 0 ? t : std::min(t, chunk_triangles_);
  bytes += 108 * chunk;  // one chunk's indices, coordinates and floats
  if (zstd_level_ > 0) bytes += (zstd_level_ < 10 ? 8 : 20) * std::min(page_bytes(needs), 128 * kMiB);
  return bytes + kThreadBytes;
}

/// As encoded_bytes_estimate(), for the worst window.
uint64_t MemoryPlan::encoded_bytes(const WindowNeeds& needs) const {
  const uint64_t index_bits = 3 * static_cast<uint64_t>(std::bit_width(needs.vertices));
  const uint64_t id_bits = source_ids_ ? id_bits_ : 0;
  return (needs.triangles * (index_bits + id_bits) + needs.vertices * vertex_bits_ * 3 / 2) / 8 + 256;
}

uint64_t MemoryPlan::page_bytes(const WindowNeeds& needs) const {
  const uint64_t page =
      chunk_triangles_ == 0 ? std::max(format::kPageTargetBytes, encoded_bytes(needs)) : format::kPageTargetBytes;
  return zstd_level_ > 0 ? 2 * page : page;
}

/// Tables that grow while chunks are written. A growing vector briefly holds its content twice.
uint64_t MemoryPlan::table_bytes(const WindowNeeds& needs) const {
  return 3 * needs.chunks * (sizeof(format::ChunkRecord) + sizeof(format::PageRecord));
}

}  // namespace scree::convert
