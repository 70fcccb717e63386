#include "tools/convert/windows/window.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numeric>

#include "tools/convert/windows/radix_sort.h"

namespace scree::convert {
namespace {

/// A window with a larger span than this many vertex numbers per corner counts as scattered.
constexpr uint64_t kScatteredSpanPerCorner = 4;

/// Vectors of a released window have room for at most their size divided by this more values.
constexpr size_t kSpareShare = 8;

/// The number in the source of a primitive's vertex.
Result<uint32_t> source_vertex(const Primitive& primitive, uint32_t vertex) {
  if (!primitive.numbers) return vertex;
  uint32_t number = 0;
  const auto bytes = std::as_writable_bytes(std::span(&number, 1));
  SCREE_TRY(read_elements(primitive.numbers->vertices, vertex, 1, bytes));
  return primitive.numbers->first_vertex + number;
}

}  // namespace

Result<void> read_vertices(const Accessor& accessor, std::span<const uint32_t> ascending, std::vector<float>& out) {
  out.resize(ascending.size() * accessor.components);
  return read_vertices(accessor, ascending, std::span(out));
}

Result<void> read_vertices(const Accessor& accessor, std::span<const uint32_t> ascending, std::span<float> out) {
  if (ascending.empty()) return {};
  const uint64_t span = uint64_t{ascending.back()} - ascending.front() + 1;
  if (span == ascending.size()) return read_floats(accessor, ascending.front(), span, out);
  return gather_floats(accessor, ascending, out);
}

Result<void> Window::load(const Primitive& primitive, uint64_t first, uint64_t count, bool drop_nonfinite, Find find) {
  SCREE_TRY(load_triangles(primitive, first, count, find));
  return load_positions(primitive, drop_nonfinite);
}

Result<void> Window::load_triangles(const Primitive& primitive, uint64_t first, uint64_t count, Find find) {
  first_ = first;
  renumber_ = find == Find::kTriangles;
  dropped_degenerate_ = 0;
  dropped_nonfinite_ = 0;
  kept_.clear();
  span_ = 0;
  indices_.resize(3 * count);
  SCREE_TRY(read_triangles(primitive, first, count, indices_));
  numbers_.resize(primitive.numbers ? count : 0);
  if (primitive.numbers) {
    const auto bytes = std::as_writable_bytes(std::span(numbers_));
    SCREE_TRY(read_elements(primitive.numbers->triangles, first, count, bytes));
  }
  if (primitive.mode != PrimitiveMode::kTriangles) drop_degenerate();
  find_vertices(renumber_);
  return {};
}

Result<void> Window::load_positions(const Primitive& primitive, bool drop_nonfinite) {
  SCREE_TRY(read_positions(primitive));
  return check_positions(primitive, drop_nonfinite);
}

uint64_t Window::most_released_bytes() const {
  const uint64_t values = indices_.size() + kept_.size() + numbers_.size() + vertices_.size() + positions_.size();
  return 4 * (values + values / kSpareShare);
}

WindowContent Window::release() {
  // The vectors have room for every vertex number between the first and the last, or for a larger window before.
  const auto shrink = [](auto& values) {
    if (values.capacity() > values.size() + values.size() / kSpareShare) values.shrink_to_fit();
  };
  shrink(indices_);
  shrink(kept_);
  shrink(numbers_);
  shrink(vertices_);
  shrink(positions_);
  return std::exchange(static_cast<WindowContent&>(*this), WindowContent());
}

void Window::merge(std::span<const uint32_t> firsts) {
  places_.resize(firsts.size());
  uint32_t count = 0;
  for (size_t i = 0; i < firsts.size(); ++i) {
    if (firsts[i] != i) {
      places_[i] = places_[firsts[i]];  // firsts[i] precedes i, so its entry is already set
      continue;
    }
    vertices_[count] = vertices_[i];
    std::copy_n(&positions_[3 * i], 3, &positions_[3 * size_t{count}]);
    places_[i] = count++;
  }
  vertices_.resize(count);
  positions_.resize(3 * size_t{count});
  for (uint32_t& index : indices_) index = places_[index];
}

Result<void> Window::read_positions(const Primitive& primitive) {
  positions_.resize(vertices_.size() * primitive.positions.components);
  return read_vertices(primitive.positions, vertices_, std::span(positions_));
}

void Window::drop_degenerate() {
  std::vector<bool> keep(triangle_count());
  for (size_t i = 0; i < keep.size(); ++i) {
    const uint32_t* corner = &indices_[3 * i];
    keep[i] = corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0];
  }
  const uint64_t before = triangle_count();
  keep_triangles(keep);
  dropped_degenerate_ = before - triangle_count();
}

void Window::keep_triangles(const std::vector<bool>& keep) {
  const size_t before = keep.size();
  if (std::find(keep.begin(), keep.end(), false) == keep.end()) return;
  std::vector<uint32_t> kept;
  size_t count = 0;
  for (size_t i = 0; i < before; ++i) {
    if (!keep[i]) continue;
    kept.push_back(kept_.empty() ? static_cast<uint32_t>(i) : kept_[i]);
    for (size_t corner = 0; corner < 3; ++corner) indices_[3 * count + corner] = indices_[3 * i + corner];
    ++count;
  }
  indices_.resize(3 * count);
  kept_ = std::move(kept);
}

void Window::find_by_bitmap(uint32_t lo, uint64_t span, bool renumber) {
  used_.assign((span + 63) / 64, 0);
  ranks_.resize(used_.size());
  for (const uint32_t index : indices_) used_[(index - lo) / 64] |= uint64_t{1} << ((index - lo) % 64);
  vertices_.resize(std::min<uint64_t>(span, indices_.size()));  // upper bound
  uint32_t count = 0;
  for (size_t word = 0; word < used_.size(); ++word) {
    ranks_[word] = count;
    for (uint64_t bits = used_[word]; bits != 0; bits &= bits - 1)
      vertices_[count++] = lo + static_cast<uint32_t>(64 * word) + static_cast<uint32_t>(std::countr_zero(bits));
  }
  vertices_.resize(count);
  if (!renumber) return;
  for (uint32_t& index : indices_) {
    const size_t word = (index - lo) / 64;
    const uint64_t before = (uint64_t{1} << ((index - lo) % 64)) - 1;
    index = ranks_[word] + static_cast<uint32_t>(std::popcount(used_[word] & before));
  }
}

void Window::find_vertices(bool renumber) {
  is_scattered_ = false;
  vertices_.clear();
  if (indices_.empty()) return;
  uint32_t lo = indices_[0];
  uint32_t hi = indices_[0];
  for (const uint32_t index : indices_) {
    lo = std::min(lo, index);
    hi = std::max(hi, index);
  }
  const uint64_t span = uint64_t{hi} - lo + 1;
  span_ = std::max(span_, span);
  is_scattered_ = span > kScatteredSpanPerCorner * indices_.size() + 1024;
  if (span <= most_table_span(indices_.size())) {
    is_used_.assign(span, 0);
    for (const uint32_t index : indices_) is_used_[index - lo] = 1;
    vertices_.resize(span);
    if (std::memchr(is_used_.data(), 0, span) == nullptr) {  // the usual case: all are used
      std::iota(vertices_.begin(), vertices_.end(), lo);
      if (renumber)
        for (uint32_t& index : indices_) index -= lo;
      return;
    }
    uint32_t count = 0;
    places_.resize(span);
    for (uint64_t i = 0; i < span; ++i) {
      vertices_[count] = lo + static_cast<uint32_t>(i);
      places_[i] = count;
      count += is_used_[i];
    }
    vertices_.resize(count);
    if (renumber)
      for (uint32_t& index : indices_) index = places_[index - lo];
    return;
  }
  if (span <= kBitmapSpan) {
    find_by_bitmap(lo, span, renumber);
    return;
  }
  pairs_.resize(indices_.size());
  for (size_t i = 0; i < indices_.size(); ++i) pairs_[i] = uint64_t{indices_[i]} << 32 | i;
  sort_by_upper_half(pairs_, sorted_);
  for (const uint64_t pair : pairs_) {
    const uint32_t vertex = static_cast<uint32_t>(pair >> 32);
    if (vertices_.empty() || vertices_.back() != vertex) vertices_.push_back(vertex);
    if (renumber) indices_[pair & 0xffffffffu] = static_cast<uint32_t>(vertices_.size() - 1);
  }
}

Result<void> Window::check_positions(const Primitive& primitive, bool drop_nonfinite) {
  // NaN and infinity have all exponent bits set. The loop has no branches, because such values are rare.
  constexpr uint32_t kExponent = 0x7f800000u;
  uint32_t found = 0;
  for (const float value : positions_) found |= (std::bit_cast<uint32_t>(value) & kExponent) == kExponent ? 1u : 0u;
  if (found == 0) return {};

  std::vector<bool> bad(vertices_.size());
  for (size_t i = 0; i < bad.size(); ++i) {
    const float* p = &positions_[3 * i];
    bad[i] = !std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2]);
    if (!bad[i] || drop_nonfinite) continue;
    const uint32_t number = SCREE_TRY(source_vertex(primitive, vertices_[i]));
    char text[256];
    std::snprintf(text, sizeof text,
                  "mesh %u primitive %u: vertex %u: position (%g, %g, %g) is not finite "
                  "(--drop-nonfinite leaves its triangles out)",
                  primitive.mesh, primitive.place, number, static_cast<double>(p[0]), static_cast<double>(p[1]),
                  static_cast<double>(p[2]));
    return Error{ErrorCode::kRange, text};
  }
  std::vector<bool> keep(triangle_count(), true);
  for (size_t i = 0; i < indices_.size(); ++i) {
    size_t place = indices_[i];
    if (!renumber_)
      place =
          static_cast<size_t>(std::lower_bound(vertices_.begin(), vertices_.end(), indices_[i]) - vertices_.begin());
    if (bad[place]) keep[i / 3] = false;
  }
  if (renumber_)
    for (uint32_t& index : indices_) index = vertices_[index];
  const uint64_t before = triangle_count();
  keep_triangles(keep);
  dropped_nonfinite_ = before - triangle_count();
  find_vertices(renumber_);
  return read_positions(primitive);
}

}  // namespace scree::convert
