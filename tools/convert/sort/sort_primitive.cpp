#include "tools/convert/sort/sort_primitive.h"

#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "format/bytes.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/convert/sort/curve.h"
#include "tools/convert/sort/spill_buckets.h"
#include "tools/convert/windows/radix_sort.h"
#include "tools/gltf/byte_source.h"

namespace scree::convert {
namespace {

constexpr uint64_t kBlock = 16384;  // vertices or triangles per read job
constexpr uint64_t kJobsPerThread = 3;

// Buckets have about this many vertices, but there are at most kMostBuckets, since each has a block in memory.
constexpr uint64_t kBucketVertices = 32768;
constexpr uint64_t kMostBuckets = 2048;
constexpr uint64_t kSamplesPerBucket = 64;
constexpr uint64_t kPieceTriangles = 262144;  // in a thread's memory at a time

constexpr uint32_t kTriangleBytes = 16;  // three vertices and the source's number

uint64_t bucket_vertices(uint64_t vertices) {
  return std::max(kBucketVertices, vertices / kMostBuckets + 1);
}

uint32_t bucket_count(uint64_t vertices) {
  return static_cast<uint32_t>((vertices - 1) / bucket_vertices(vertices) + 1);
}

/// Triangles are sorted into buckets of 2^shift vertices.
uint32_t triangle_shift(uint64_t vertices) {
  constexpr int kLeast = 15, kMostBucketBits = 11;
  return static_cast<uint32_t>(std::max(kLeast, static_cast<int>(std::bit_width(vertices - 1)) - kMostBucketBits));
}

uint32_t triangle_buckets(uint64_t vertices) {
  return static_cast<uint32_t>(((vertices - 1) >> triangle_shift(vertices)) + 1);
}

uint32_t middle(uint32_t a, uint32_t b, uint32_t c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

/// Bytes stored per vertex while sorting: its number, and its key within the bucket; then its elements.
constexpr uint32_t kVertexHeadBytes = 8;

std::vector<const Accessor*> vertex_accessors(const Primitive& primitive, bool normals) {
  std::vector<const Accessor*> out{&primitive.positions};
  visit_attributes(primitive, normals, [&](const Accessor& accessor) { out.push_back(&accessor); });
  return out;
}

uint32_t element_bytes(const std::vector<const Accessor*>& accessors) {
  uint64_t sum = 0;
  for (const Accessor* accessor : accessors) sum += accessor->element_bytes();
  return static_cast<uint32_t>(sum);
}

/// Most elements are three floats, and a copy of constant size needs no call.
void copy_element(std::byte* to, const std::byte* from, uint64_t bytes) {
  if (bytes == 12) {
    std::memcpy(to, from, 12);
  } else {
    std::memcpy(to, from, bytes);
  }
}

/// The memory of a thread.
struct Scratch {
  std::vector<float> floats;
  std::vector<std::byte> elements;
  std::vector<std::byte> records;
  std::vector<std::byte> sorted;
  std::vector<uint64_t> pairs, other;
  std::vector<uint32_t> corners;
  std::vector<uint32_t> numbers;
  std::vector<uint32_t> buckets;
  std::vector<uint32_t> places;
  std::vector<CurvePlace> curve_places;
  std::vector<uint64_t> firsts;  // by vertex: its first triangle in the copy
  Grouping grouping;
};

class Sorter {
 public:
  Sorter(const Primitive& primitive, const ScatteredPrimitive& scattered, bool normals, const SortLimits& limits,
         std::shared_ptr<const format::PartFile> file, uint64_t offset, const std::atomic<bool>* stop,
         const std::function<void(uint64_t)>& progress)
      : source_(primitive),
        first_vertex_(scattered.first_vertex),
        vertices_(scattered.vertex_count),
        triangles_(primitive.triangle_count()),
        limits_(limits),
        file_(std::move(file)),
        progress_(progress),
        accessors_(vertex_accessors(primitive, normals)),
        vertex_bytes_(kVertexHeadBytes + element_bytes(accessors_)),
        scratch_(limits.threads),
        pool_(limits.threads, stop) {
    uint64_t end = offset;
    const auto take = [&](uint64_t bytes) { return std::exchange(end, end + bytes); };
    for (const Accessor* accessor : accessors_) element_offsets_.push_back(take(vertices_ * accessor->element_bytes()));
    numbers_offset_ = take(4 * vertices_);
    corners_offset_ = take(12 * triangles_);
    ids_offset_ = take(4 * triangles_);
    buckets_offset_ = end;
  }

  Result<Primitive> run() {
    SCREE_TRY(survey());
    SCREE_TRY(sort_vertices());
    for (uint64_t first = 0; map_.size() < vertices_ && first < vertices_; first += limits_.map_vertices)
      SCREE_TRY(renumber(first, std::min(limits_.map_vertices, vertices_ - first)));
    const uint64_t kept = SCREE_TRY(sort_triangles());
    SCREE_TRY(file_->resize(buckets_offset_));
    return copy(kept);
  }

 private:
  Error changed() const {
    return {ErrorCode::kFormat, "mesh " + std::to_string(source_.mesh) + " primitive " + std::to_string(source_.place) +
                                    " changed while it was converted"};
  }

  template <class T, class Work, class Take>
  Result<void> run_blocks(uint64_t count, Work work, Take take) {
    const auto run = [&](uint64_t block, uint32_t worker) -> Result<T> {
      const uint64_t first = block * kBlock;
      return work(first, std::min(kBlock, count - first), scratch_[worker]);
    };
    const auto zero_cost = [](uint64_t) { return uint64_t{0}; };
    return run_ordered<T>(pool_, (count + kBlock - 1) / kBlock, {kJobsPerThread * pool_.threads(), UINT64_MAX}, run,
                          zero_cost, [&](uint64_t, T result) { return take(std::move(result)); });
  }

  Result<void> read_positions(uint64_t first, uint64_t count, Scratch& s) const {
    s.floats.resize(3 * count);
    return read_floats(source_.positions, first_vertex_ + first, count, s.floats);
  }

  /// Chooses the box of the curve, and the buckets along it.
  Result<void> survey() {
    struct Found {
      Box box = empty_box();
      std::vector<CurveSample> samples;
    };
    const uint64_t step = std::max<uint64_t>(1, vertices_ / (kSamplesPerBucket * bucket_count(vertices_)));
    Found all;
    const auto work = [&](uint64_t first, uint64_t count, Scratch& s) -> Result<Found> {
      SCREE_TRY(read_positions(first, count, s));
      Found found;
      for (uint64_t i = 0; i < count; ++i) {
        const float* p = &s.floats[3 * i];
        if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2])) continue;
        grow(found.box, box_of({p, 3}));
        if ((first + i) % step == 0) found.samples.push_back({{p[0], p[1], p[2]}, static_cast<uint32_t>(first + i)});
      }
      return found;
    };
    const auto take = [&](Found found) -> Result<void> {
      grow(all.box, found.box);
      all.samples.insert(all.samples.end(), found.samples.begin(), found.samples.end());
      return {};
    };
    SCREE_TRY(run_blocks<Found>(vertices_, work, take));
    curve_ = Curve(box_of_most(all.box, all.samples));
    std::vector<CurvePlace> places;
    for (const auto& [point, number] : all.samples) places.push_back({curve_.key(point.data()), number});
    std::sort(places.begin(), places.end());
    std::vector<CurvePlace> borders;
    for (size_t i = kSamplesPerBucket; i < places.size(); i += kSamplesPerBucket) borders.push_back(places[i]);
    parts_ = CurveParts(std::move(borders));
    return {};
  }

  Result<Grouped> group_vertices(uint64_t first, uint64_t count, Scratch& s) {
    SCREE_TRY(read_positions(first, count, s));
    s.curve_places.resize(count);
    s.buckets.resize(count);
    for (uint64_t i = 0; i < count; ++i) {
      s.curve_places[i] = {curve_.key(&s.floats[3 * i]), static_cast<uint32_t>(first + i)};
      s.buckets[i] = parts_.find(s.curve_places[i]);
    }
    Grouped out;
    s.grouping.start(s.buckets, parts_.count(), vertex_bytes_, out);
    s.places.resize(count);
    for (uint64_t i = 0; i < count; ++i) {
      s.places[i] = s.grouping.place(s.buckets[i]);
      std::byte* const record = &out.records[uint64_t{s.places[i]} * vertex_bytes_];
      format::store(record, s.curve_places[i].number);
      format::store(record + 4, parts_.short_key(s.curve_places[i].key, s.buckets[i]));
    }
    uint64_t inside = kVertexHeadBytes;
    for (const Accessor* accessor : accessors_) {
      const uint64_t bytes = accessor->element_bytes();
      s.elements.resize(count * bytes);
      SCREE_TRY(read_elements(*accessor, first_vertex_ + first, count, s.elements));
      for (uint64_t i = 0; i < count; ++i)
        copy_element(&out.records[uint64_t{s.places[i]} * vertex_bytes_ + inside], &s.elements[i * bytes], bytes);
      inside += bytes;
    }
    return out;
  }

  void note(uint64_t more) {
    done_ += more;
    progress_(done_);
  }

  /// Writes the vertices in the order of the curve. Stores their new numbers in map_ if it has room for all.
  Result<void> sort_vertices() {
    SpillBuckets buckets(*file_, buckets_offset_, parts_.count(), vertex_bytes_);
    const auto group = [&](uint64_t first, uint64_t count, Scratch& s) { return group_vertices(first, count, s); };
    const auto take = [&](Grouped grouped) -> Result<void> {
      note(grouped.records.size() / vertex_bytes_);
      return buckets.append(grouped);
    };
    SCREE_TRY(run_blocks<Grouped>(vertices_, group, take));
    SCREE_TRY(buckets.finish());

    // A bucket that is far too large (unrepresentative samples) is sorted in pieces. Then the vertices do not all lie
    // along the curve, but the copy is the same for any amount of memory.
    struct Piece {
      uint32_t bucket;
      uint64_t first;
      uint64_t count;
      uint64_t number;  // new number of its first vertex
    };
    std::vector<Piece> pieces;
    const uint64_t most = 2 * bucket_vertices(vertices_);
    uint64_t number = 0;
    for (uint32_t bucket = 0; bucket < buckets.buckets(); ++bucket) {
      for (uint64_t first = 0; first < buckets.count(bucket); first += most) {
        pieces.push_back({bucket, first, std::min(most, buckets.count(bucket) - first), number});
        number += pieces.back().count;
      }
    }
    if (limits_.map_vertices >= vertices_) make_map();
    const auto work = [&](uint64_t i, uint32_t worker) -> Result<uint64_t> {
      const Piece& piece = pieces[i];
      Scratch& s = scratch_[worker];
      s.records.resize(piece.count * vertex_bytes_);
      SCREE_TRY(buckets.read(piece.bucket, piece.first, s.records));
      SCREE_TRY(write_vertices(piece.number, piece.count, s));
      return piece.count;
    };
    return run_pieces(pieces.size(), work);
  }

  /// Allocates the map, which is read and written at random. Large pages, if available, halve the time of these
  /// accesses.
  void make_map() {
    map_.reserve(vertices_);
    constexpr uint64_t kPage = 4096;
    const uint64_t begin = (reinterpret_cast<uintptr_t>(map_.data()) + kPage - 1) / kPage * kPage;
    const uint64_t end = reinterpret_cast<uintptr_t>(map_.data() + vertices_) / kPage * kPage;
    if (begin < end) (void)::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
    map_.resize(vertices_);
  }

  template <class Work>
  Result<void> run_pieces(uint64_t count, Work work) {
    const auto zero_cost = [](uint64_t) { return uint64_t{0}; };
    return run_ordered<uint64_t>(pool_, count, {kJobsPerThread * pool_.threads(), UINT64_MAX}, work, zero_cost,
                                 [&](uint64_t, uint64_t records) -> Result<void> {
                                   note(records);
                                   return {};
                                 });
  }

  /// Sorts the vertices in s.records and writes them from number `first` on.
  Result<void> write_vertices(uint64_t first, uint64_t count, Scratch& s) {
    s.pairs.resize(count);
    for (uint64_t i = 0; i < count; ++i)
      s.pairs[i] = uint64_t{format::load<uint32_t>(&s.records[i * vertex_bytes_ + 4])} << 32 | i;
    sort_by_upper_half(s.pairs, s.other);
    s.numbers.resize(count);
    for (uint64_t i = 0; i < count; ++i) {
      s.numbers[i] = format::load<uint32_t>(&s.records[(s.pairs[i] & 0xffffffffu) * vertex_bytes_]);
      if (!map_.empty()) map_[s.numbers[i]] = static_cast<uint32_t>(first + i);
    }
    SCREE_TRY(file_->write_at(numbers_offset_ + 4 * first, std::as_bytes(std::span(s.numbers))));
    uint64_t inside = kVertexHeadBytes;
    for (size_t a = 0; a < accessors_.size(); ++a) {
      const uint64_t bytes = accessors_[a]->element_bytes();
      s.sorted.resize(count * bytes);
      for (uint64_t i = 0; i < count; ++i)
        copy_element(&s.sorted[i * bytes], &s.records[(s.pairs[i] & 0xffffffffu) * vertex_bytes_ + inside], bytes);
      SCREE_TRY(file_->write_at(element_offsets_[a] + first * bytes, s.sorted));
      inside += bytes;
    }
    return {};
  }

  /// Reads source triangles, with vertices numbered from first_vertex_ on. Triangles that only join the parts of a
  /// strip or fan are not kept. All their corners are set to one vertex: measuring did not count them, so their
  /// vertices may be outside the measured range.
  Result<void> read_corners(uint64_t first, uint64_t count, Scratch& s) const {
    s.corners.resize(3 * count);
    SCREE_TRY(read_triangles(source_, first, count, s.corners));
    if (source_.mode != PrimitiveMode::kTriangles) {
      for (uint64_t i = 0; i < count; ++i) {
        uint32_t* const c = &s.corners[3 * i];
        if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0]) std::fill_n(c, 3, first_vertex_);
      }
    }
    for (uint32_t& corner : s.corners) {
      if (corner < first_vertex_ || corner - first_vertex_ >= vertices_) return changed();
      corner -= first_vertex_;
    }
    return {};
  }

  /// Used if there is no memory for all new numbers. Writes the new numbers of source vertices [first, first + count)
  /// into the copy's triangles, which keep the source's order until they are sorted.
  Result<void> renumber(uint64_t first, uint64_t count) {
    std::vector<uint32_t> map(count);
    const auto fill = [&](uint64_t number, uint64_t n, Scratch& s) -> Result<std::monostate> {
      s.numbers.resize(n);
      SCREE_TRY(file_->read_at(numbers_offset_ + 4 * number, std::as_writable_bytes(std::span(s.numbers))));
      for (uint64_t i = 0; i < n; ++i)
        if (s.numbers[i] - first < count) map[s.numbers[i] - first] = static_cast<uint32_t>(number + i);
      return std::monostate{};
    };
    const auto nothing = [](std::monostate) -> Result<void> { return {}; };
    SCREE_TRY(run_blocks<std::monostate>(vertices_, fill, nothing));
    const auto apply = [&](uint64_t triangle, uint64_t n, Scratch& s) -> Result<std::monostate> {
      SCREE_TRY(read_corners(triangle, n, s));
      s.numbers.resize(3 * n);
      const auto bytes = std::as_writable_bytes(std::span(s.numbers));
      if (first > 0) SCREE_TRY(file_->read_at(corners_offset_ + 12 * triangle, bytes));
      for (uint64_t i = 0; i < 3 * n; ++i)
        if (s.corners[i] - first < count) s.numbers[i] = map[s.corners[i] - first];
      SCREE_TRY(file_->write_at(corners_offset_ + 12 * triangle, bytes));
      return std::monostate{};
    };
    return run_blocks<std::monostate>(triangles_, apply, nothing);
  }

  Result<Grouped> group_triangles(uint64_t first, uint64_t count, Scratch& s) {
    SCREE_TRY(read_corners(first, count, s));
    s.numbers.clear();
    for (uint64_t i = 0; i < count; ++i) {
      const uint32_t* c = &s.corners[3 * i];
      if (source_.mode == PrimitiveMode::kTriangles || (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]))
        s.numbers.push_back(static_cast<uint32_t>(i));
    }
    if (!map_.empty()) {
      for (uint32_t& corner : s.corners) corner = map_[corner];
    } else {
      const auto bytes = std::as_writable_bytes(std::span(s.corners));
      SCREE_TRY(file_->read_at(corners_offset_ + 12 * first, bytes));
    }
    const uint32_t shift = triangle_shift(vertices_);
    s.buckets.resize(s.numbers.size());
    for (size_t i = 0; i < s.numbers.size(); ++i) {
      const uint32_t* c = &s.corners[3 * size_t{s.numbers[i]}];
      s.buckets[i] = middle(c[0], c[1], c[2]) >> shift;
    }
    Grouped out;
    s.grouping.start(s.buckets, triangle_buckets(vertices_), kTriangleBytes, out);
    for (size_t i = 0; i < s.numbers.size(); ++i) {
      std::byte* const record = &out.records[uint64_t{s.grouping.place(s.buckets[i])} * kTriangleBytes];
      std::memcpy(record, &s.corners[3 * size_t{s.numbers[i]}], 12);
      format::store(record + 12, static_cast<uint32_t>(first + s.numbers[i]));
    }
    return out;
  }

  /// Writes the triangles in the order of their middle vertex. Returns their number.
  Result<uint64_t> sort_triangles() {
    SpillBuckets buckets(*file_, buckets_offset_, triangle_buckets(vertices_), kTriangleBytes);
    const auto group = [&](uint64_t first, uint64_t count, Scratch& s) { return group_triangles(first, count, s); };
    const auto take = [&](Grouped grouped) -> Result<void> {
      note(grouped.records.size() / kTriangleBytes);
      return buckets.append(grouped);
    };
    SCREE_TRY(run_blocks<Grouped>(triangles_, group, take));
    SCREE_TRY(buckets.finish());
    map_ = {};
    std::vector<uint64_t> firsts{0};
    for (uint32_t bucket = 0; bucket < buckets.buckets(); ++bucket)
      firsts.push_back(firsts.back() + buckets.count(bucket));
    const auto work = [&](uint64_t bucket, uint32_t worker) -> Result<uint64_t> {
      SCREE_TRY(sort_bucket(buckets, static_cast<uint32_t>(bucket), firsts[bucket], scratch_[worker]));
      return buckets.count(static_cast<uint32_t>(bucket));
    };
    SCREE_TRY(run_pieces(buckets.buckets(), work));
    return firsts.back();
  }

  /// Reads a piece of a bucket, and finds each triangle's middle vertex among the bucket's vertices.
  Result<void> read_piece(const SpillBuckets& buckets, uint32_t bucket, uint64_t first, uint64_t count,
                          Scratch& s) const {
    s.records.resize(count * kTriangleBytes);
    SCREE_TRY(buckets.read(bucket, first, s.records));
    const uint32_t base = bucket << triangle_shift(vertices_);
    s.places.resize(count);
    for (uint64_t i = 0; i < count; ++i) {
      const auto c = format::load<std::array<uint32_t, 3>>(&s.records[i * kTriangleBytes]);
      s.places[i] = middle(c[0], c[1], c[2]) - base;
    }
    return {};
  }

  /// Sorts a bucket of any size by counting: pieces of it are written to their final positions.
  Result<void> sort_bucket(const SpillBuckets& buckets, uint32_t bucket, uint64_t first, Scratch& s) {
    const uint64_t count = buckets.count(bucket);
    s.firsts.assign(uint64_t{1} << triangle_shift(vertices_), 0);
    for (uint64_t from = 0; from < count; from += kPieceTriangles) {
      SCREE_TRY(read_piece(buckets, bucket, from, std::min(kPieceTriangles, count - from), s));
      for (const uint32_t place : s.places) ++s.firsts[place];
    }
    uint64_t sum = first;
    for (uint64_t& place : s.firsts) sum += std::exchange(place, sum);
    const bool is_whole = count <= kPieceTriangles;
    for (uint64_t from = 0; from < count; from += kPieceTriangles) {
      const uint64_t n = std::min(kPieceTriangles, count - from);
      if (!is_whole) SCREE_TRY(read_piece(buckets, bucket, from, n, s));
      s.pairs.resize(n);
      for (uint64_t i = 0; i < n; ++i) {
        const uint64_t number = s.firsts[s.places[i]]++;
        s.pairs[is_whole ? number - first : i] = number << 32 | i;
      }
      if (!is_whole) sort_by_upper_half(s.pairs, s.other);
      SCREE_TRY(write_triangles(s));
    }
    return {};
  }

  /// Writes the triangles of s.records that s.pairs selects to their positions in the copy.
  Result<void> write_triangles(Scratch& s) {
    for (size_t begin = 0; begin < s.pairs.size();) {
      const uint64_t number = s.pairs[begin] >> 32;
      s.corners.clear();
      s.numbers.clear();
      size_t end = begin;
      for (; end < s.pairs.size() && s.pairs[end] >> 32 == number + (end - begin); ++end) {
        const std::byte* const record = &s.records[(s.pairs[end] & 0xffffffffu) * kTriangleBytes];
        const auto c = format::load<std::array<uint32_t, 3>>(record);
        s.corners.insert(s.corners.end(), c.begin(), c.end());
        s.numbers.push_back(format::load<uint32_t>(record + 12));
      }
      SCREE_TRY(file_->write_at(corners_offset_ + 12 * number, std::as_bytes(std::span(s.corners))));
      SCREE_TRY(file_->write_at(ids_offset_ + 4 * number, std::as_bytes(std::span(s.numbers))));
      begin = end;
    }
    return {};
  }

  Primitive copy(uint64_t triangles) const {
    const std::shared_ptr<const ByteSource> source = part_source(file_, buckets_offset_);
    const auto numbers = [&](uint64_t offset, uint64_t count) {
      Accessor accessor;
      accessor.source = source;
      accessor.offset = offset;
      accessor.stride = sizeof(uint32_t);
      accessor.count = count;
      accessor.type = ComponentType::kUint32;
      accessor.components = 1;
      return accessor;
    };
    Primitive out = source_;
    out.mode = PrimitiveMode::kTriangles;
    out.indices = numbers(corners_offset_, 3 * triangles);
    size_t next = 0;
    const auto move = [&](Accessor& accessor) {
      accessor.source = source;
      accessor.offset = element_offsets_[next++];
      accessor.stride = accessor.element_bytes();
      accessor.count = vertices_;
      accessor.sparse.reset();
    };
    SurfaceAttributes surface;
    if (out.surface) surface = *out.surface;
    // In the order of visit_attributes().
    move(out.positions);
    for (std::optional<Accessor>* accessor : {&out.uv, &out.color, &surface.second_uv})
      if (*accessor) move(**accessor);
    for (std::optional<Accessor>* accessor : {&out.normal, &surface.tangent}) {
      if (!*accessor) continue;
      if (next < element_offsets_.size()) {
        move(**accessor);
      } else {
        accessor->reset();
      }
    }
    if (out.surface) out.surface = std::make_shared<const SurfaceAttributes>(std::move(surface));
    auto origin = std::make_shared<SourceNumbers>();
    origin->triangles = numbers(ids_offset_, triangles);
    origin->vertices = numbers(numbers_offset_, vertices_);
    origin->first_vertex = first_vertex_;
    out.numbers = std::move(origin);
    return out;
  }

  const Primitive& source_;
  const uint32_t first_vertex_;
  const uint64_t vertices_;
  const uint64_t triangles_;
  const SortLimits limits_;
  const std::shared_ptr<const format::PartFile> file_;
  const std::function<void(uint64_t)>& progress_;
  const std::vector<const Accessor*> accessors_;
  const uint32_t vertex_bytes_;
  std::vector<uint64_t> element_offsets_;  // in the file, by accessor of accessors_
  uint64_t numbers_offset_ = 0;            // of the source's vertex numbers
  uint64_t corners_offset_ = 0;
  uint64_t ids_offset_ = 0;
  uint64_t buckets_offset_ = 0;
  Curve curve_{empty_box()};
  CurveParts parts_;           // the buckets of the vertices
  std::vector<uint32_t> map_;  // new numbers; empty if there is no memory for all
  uint64_t done_ = 0;
  std::vector<Scratch> scratch_;
  WorkerPool pool_;
};

}  // namespace

SortNeeds sort_needs(const Primitive& primitive, uint64_t vertex_count, bool normals) {
  const uint64_t vertices = std::max<uint64_t>(vertex_count, 1), triangles = primitive.triangle_count();
  const uint32_t elements = element_bytes(vertex_accessors(primitive, normals));
  const uint32_t vertex_bytes = kVertexHeadBytes + elements;
  const uint32_t buckets = bucket_count(vertices) + bucket_count(vertices) / 256 + 2;  // as many as samples divide
  SortNeeds needs;
  needs.kept_file_bytes = vertices * (elements + 4) + 16 * triangles;
  needs.file_bytes = needs.kept_file_bytes +
                     std::max(SpillBuckets::most_file_bytes(vertices, buckets, vertex_bytes),
                              SpillBuckets::most_file_bytes(triangles, triangle_buckets(vertices), kTriangleBytes));
  needs.shared_bytes = std::max(SpillBuckets::most_memory(vertices, buckets, vertex_bytes),
                                SpillBuckets::most_memory(triangles, triangle_buckets(vertices), kTriangleBytes)) +
                       kSamplesPerBucket * buckets * 4 * sizeof(CurvePlace);
  const uint64_t piece = 2 * bucket_vertices(vertices);
  const uint64_t a_block = kBlock * (64 + 2 * elements + kJobsPerThread * std::max(vertex_bytes, kTriangleBytes)) +
                           4 * (kJobsPerThread + 1) * uint64_t{std::max(buckets, triangle_buckets(vertices))};
  const uint64_t vertex_piece = piece * (vertex_bytes + 20 + 16);
  const uint64_t triangle_piece = kPieceTriangles * (kTriangleBytes + 36) + (uint64_t{8} << triangle_shift(vertices));
  needs.thread_bytes = a_block + vertex_piece + triangle_piece;
  needs.map_bytes = 4 * vertices;
  return needs;
}

Result<Primitive> sort_primitive(const Primitive& primitive, const ScatteredPrimitive& scattered, bool normals,
                                 const SortLimits& limits, std::shared_ptr<const format::PartFile> file,
                                 uint64_t offset, const std::atomic<bool>* stop,
                                 const std::function<void(uint64_t)>& progress) {
  return Sorter(primitive, scattered, normals, limits, std::move(file), offset, stop, progress).run();
}

}  // namespace scree::convert
