#include "tools/clusters/fifo_order.h"

#include <cassert>

namespace scree::tools {
namespace {

constexpr uint32_t kNoTriangle = ~0u;

// 16 entries agree with the paper's hardware measurements and with meshoptimizer's own default.
constexpr uint32_t kCacheSize = 16;

}  // namespace

std::span<const uint32_t> FifoOrder::run(std::span<const uint32_t> indices, uint32_t vertex_count) {
  assert(indices.size() % 3 == 0 && indices.size() < kNoTriangle);
  if (indices.empty()) return {};
  const size_t count = indices.size() / 3;
  make_room(count);
  list_triangles(indices, vertex_count);
  is_taken_.assign(count, 0);
  taken_count_ = 0;
  seen_count_ = 0;
  time_ = kCacheSize + 1;
  first_left_ = 0;
  for (uint32_t center = 0; center != kNoTriangle;) {
    const size_t first_seen = seen_count_;
    take_around(indices, center);
    center = next_center(first_seen);
  }
  assert(taken_count_ == count);
  return {order_.get(), count};
}

void FifoOrder::make_room(size_t triangles) {
  if (triangles <= room_) return;
  at_vertex_ = std::make_unique_for_overwrite<uint32_t[]>(3 * triangles);
  order_ = std::make_unique_for_overwrite<uint32_t[]>(triangles + 1);
  seen_ = std::make_unique_for_overwrite<uint32_t[]>(3 * triangles + 1);
  room_ = triangles;
}

void FifoOrder::list_triangles(std::span<const uint32_t> indices, uint32_t vertex_count) {
  vertices_.assign(size_t{vertex_count} + 1, {});
  for (const uint32_t index : indices) ++vertices_[index].left;
  uint32_t end = 0;
  for (Vertex& vertex : vertices_) vertex.first = end += vertex.left;
  for (size_t i = indices.size(); i-- > 0;) at_vertex_[--vertices_[indices[i]].first] = static_cast<uint32_t>(i / 3);
}

/// Takes all remaining triangles of a vertex.
void FifoOrder::take_around(std::span<const uint32_t> indices, uint32_t center) {
  // Entries that are not needed are written and then overwritten by the next one, because a branch would often be
  // mispredicted. Local pointers are used because the compiler must assume that a store to is_taken may change any
  // member.
  const uint32_t* const corners = indices.data();
  const uint32_t* const at_vertex = at_vertex_.get();
  Vertex* const vertices = vertices_.data();
  uint8_t* const is_taken = is_taken_.data();
  uint32_t* const fan = order_.get() + taken_count_;
  const uint32_t end = vertices[center + 1].first;
  size_t count = 0;
  for (uint32_t i = vertices[center].first; i < end; ++i) {
    const uint32_t triangle = at_vertex[i];
    fan[count] = triangle;
    count += 1u - is_taken[triangle];
    is_taken[triangle] = 1;
    __builtin_prefetch(corners + 3 * size_t{triangle});
  }
  taken_count_ += count;
  uint32_t* seen = seen_.get() + seen_count_;
  uint32_t time = time_;
  const auto touch = [&](uint32_t index) {
    Vertex& vertex = vertices[index];
    const uint32_t left = --vertex.left;
    if (time - vertex.time > kCacheSize) {
      vertex.time = time++;
      __builtin_prefetch(at_vertex + vertex.first);  // this may be the next center
    }
    *seen = index;
    seen += left != 0 ? 1 : 0;
  };
  if (time - vertices[center].time + 2 * count <= kCacheSize) {
    // The usual case: the center stays in the cache, so only the other two corners are touched.
    for (size_t i = 0; i < count; ++i) {
      const uint32_t* const corner = corners + 3 * size_t{fan[i]};
      touch(corner[0] != center ? corner[0] : corner[1]);
      touch(corner[2] == center && corner[0] != center ? corner[1] : corner[2]);
    }
  } else {
    for (size_t i = 0; i < count; ++i)
      for (size_t k = 0; k < 3; ++k) touch(corners[3 * size_t{fan[i]} + k]);
  }
  vertices[center].left = 0;
  seen_count_ = static_cast<size_t>(seen - seen_.get());
  time_ = time;
}

/// Chooses among the vertices just seen: the one that has been in the cache for longest and will still be there after
/// its triangles, else the first one. If no vertex was just seen, the last one seen before; if there is none, the first
/// vertex with triangles left.
uint32_t FifoOrder::next_center(size_t first_seen) {
  uint32_t best = kNoTriangle;
  uint32_t best_age = 0;
  for (size_t i = first_seen; i < seen_count_; ++i) {
    const Vertex& vertex = vertices_[seen_[i]];
    if (vertex.left == 0) continue;
    uint32_t age = time_ - vertex.time;
    if (2 * vertex.left + age > kCacheSize) age = 0;
    if (best != kNoTriangle && age <= best_age) continue;
    best = seen_[i];
    best_age = age;
  }
  if (best != kNoTriangle) return best;
  while (seen_count_ > 0) {
    const uint32_t vertex = seen_[--seen_count_];
    if (vertices_[vertex].left != 0) return vertex;
  }
  for (; first_left_ + 1 < vertices_.size(); ++first_left_)
    if (vertices_[first_left_].left != 0) return first_left_;
  return kNoTriangle;
}

}  // namespace scree::tools
