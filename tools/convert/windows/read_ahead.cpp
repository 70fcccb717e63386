#include "tools/convert/windows/read_ahead.h"

#include <algorithm>
#include <utility>

#include "tools/convert/windows/locality.h"

namespace scree::convert {
namespace {

using Hint = void (ByteSource::*)(uint64_t offset, uint64_t bytes) const;

struct Elements {
  uint64_t first = 0;
  uint64_t end = 0;
};

/// part / whole of `count`, which is below 2^32. Computed in floating point, because the product of two counts from a
/// file may exceed 64 bits.
uint64_t share(uint64_t count, uint64_t part, uint64_t whole) {
  return static_cast<uint64_t>(static_cast<double>(count) * static_cast<double>(part) / static_cast<double>(whole));
}

Elements indices_of(const Primitive& primitive, const WindowPlan& window) {
  const uint64_t corners = primitive.mode == PrimitiveMode::kTriangles ? 3 : 1;
  return {corners * window.first, corners * (window.first + window.count) + 2};
}

/// None if most vertices belong to other primitives, because it is not known which belong to this one.
Elements vertices_of(const Primitive& primitive, const WindowPlan& window) {
  const uint64_t vertices = primitive.vertex_count(), triangles = primitive.triangle_count();
  if (vertices > kMostVertices * triangles) return {};
  return {share(vertices, window.first, triangles), share(vertices, window.first + window.count, triangles) + 1};
}

uint64_t bytes_of(const Accessor& accessor, Elements elements) {
  const uint64_t end = std::min(elements.end, accessor.count);
  if (accessor.source == nullptr || elements.first >= end) return 0;
  return (end - elements.first - 1) * accessor.stride + accessor.element_bytes();
}

void give_hint(const Accessor& accessor, Elements elements, Hint hint) {
  const uint64_t bytes = bytes_of(accessor, elements);
  if (bytes > 0) (accessor.source.get()->*hint)(accessor.offset + elements.first * accessor.stride, bytes);
}

}  // namespace

ReadAhead::ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, const AheadBytes& bytes,
                     uint32_t threads, bool attributes, bool normals)
    : scene_(scene), windows_(windows), attributes_(attributes), normals_(normals) {
  // Threads of one kind share the primitives, because a view is unpacked by one thread at a time.
  const uint32_t shares = unpacking_threads(threads) / 2;
  // One thread cannot allocate pages for a fast disk.
  const uint32_t readers = std::max(shares, 1u);
  for (uint32_t reader = 0; reader < readers; ++reader)
    start(bytes.files, [this, reader, readers](const WindowPlan& window) {
      if (window.primitive % readers != reader) return;
      visit(window,
            [](const Accessor& accessor, Elements elements) { give_hint(accessor, elements, &ByteSource::will_need); });
    });
  for (uint32_t share = 0; share < shares; ++share) {
    const auto start_unpacking = [&](const auto& unpack) {
      start(bytes.unpacked, [this, unpack, share, shares](const WindowPlan& window) {
        if (window.primitive % shares == share) unpack(scene_.primitives[window.primitive], window);
      });
    };
    start_unpacking([](const Primitive& primitive, const WindowPlan& window) {
      if (primitive.indices) give_hint(*primitive.indices, indices_of(primitive, window), &ByteSource::unpack_ahead);
    });
    start_unpacking([](const Primitive& primitive, const WindowPlan& window) {
      give_hint(primitive.positions, vertices_of(primitive, window), &ByteSource::unpack_ahead);
    });
  }
}

void ReadAhead::begun(uint64_t window) {
  for (const std::unique_ptr<PrepareAhead>& thread : threads_) thread->begun(window);
}

void ReadAhead::start(uint64_t most_bytes, Prepare prepare) {
  threads_.push_back(std::make_unique<PrepareAhead>(
      windows_.size(), most_bytes, [this](uint64_t window) { return bytes_of(windows_[window]); },
      [this, prepare = std::move(prepare)](uint64_t window) { prepare(windows_[window]); }));
}

/// Calls visit(accessor, elements) for the data of a window.
template <class Visit>
void ReadAhead::visit(const WindowPlan& window, const Visit& visit) const {
  const Primitive& primitive = scene_.primitives[window.primitive];
  if (primitive.indices) visit(*primitive.indices, indices_of(primitive, window));
  const Elements vertices = vertices_of(primitive, window);
  const auto visit_vertices = [&](const Accessor& accessor) { visit(accessor, vertices); };
  visit_vertices(primitive.positions);
  if (attributes_) {
    visit_attributes(primitive, normals_, visit_vertices);
  } else if (primitive.color) {
    visit_vertices(*primitive.color);
  }
}

uint64_t ReadAhead::bytes_of(const WindowPlan& window) const {
  uint64_t bytes = 0;
  visit(window, [&](const Accessor& accessor, Elements elements) { bytes += convert::bytes_of(accessor, elements); });
  return bytes;
}

}  // namespace scree::convert
