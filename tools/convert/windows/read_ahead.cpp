#include "tools/convert/windows/read_ahead.h"

#include <algorithm>
#include <deque>
#include <exception>
#include <new>
#include <utility>

#include "tools/convert/windows/locality.h"

namespace scree::convert {
namespace {

using Hint = void (ByteSource::*)(uint64_t offset, uint64_t bytes) const;

/// Prepares elements [first, end) and returns their bytes.
uint64_t prepare_elements(const Accessor& accessor, uint64_t first, uint64_t end, Hint hint) {
  end = std::min(end, accessor.count);
  if (accessor.source == nullptr || first >= end) return 0;
  const uint64_t bytes = (end - first - 1) * accessor.stride + accessor.element_bytes();
  (accessor.source.get()->*hint)(accessor.offset + first * accessor.stride, bytes);
  return bytes;
}

/// part / whole of `count`, which is below 2^32. Computed in floating point, because the product of two counts from a
/// file may exceed 64 bits.
uint64_t share(uint64_t count, uint64_t part, uint64_t whole) {
  return static_cast<uint64_t>(static_cast<double>(count) * static_cast<double>(part) / static_cast<double>(whole));
}

uint64_t prepare_indices(const Primitive& primitive, const WindowPlan& window, Hint hint) {
  if (!primitive.indices) return 0;
  const uint64_t corners = primitive.mode == PrimitiveMode::kTriangles ? 3 : 1;
  return prepare_elements(*primitive.indices, corners * window.first, corners * (window.first + window.count) + 2,
                          hint);
}

/// Calls `visit(accessor)` for the accessors whose vertices are prepared, and adds up the bytes.
template <class Visit>
uint64_t prepare_vertices(const Primitive& primitive, const WindowPlan& window, Hint hint, const Visit& visit) {
  const uint64_t vertices = primitive.vertex_count(), triangles = primitive.triangle_count();
  if (vertices > kMostVertices * triangles)
    return 0;  // most vertices belong to other primitives, and it is not known which belong to this one
  const uint64_t first = share(vertices, window.first, triangles);
  const uint64_t end = share(vertices, window.first + window.count, triangles) + 1;
  uint64_t bytes = 0;
  visit([&](const Accessor& accessor) { bytes += prepare_elements(accessor, first, end, hint); });
  return bytes;
}

}  // namespace

ReadAhead::ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, const AheadBytes& bytes,
                     bool attributes, bool normals)
    : scene_(scene), windows_(windows), attributes_(attributes), normals_(normals) {
  start(bytes.files, [this](const WindowPlan& window) { return ask(window); });
  if (bytes.unpacked == 0) return;
  start(bytes.unpacked, [this](const WindowPlan& window) {
    return prepare_indices(scene_.primitives[window.primitive], window, &ByteSource::unpack_ahead);
  });
  start(bytes.unpacked, [this](const WindowPlan& window) {
    const Primitive& primitive = scene_.primitives[window.primitive];
    return prepare_vertices(primitive, window, &ByteSource::unpack_ahead,
                            [&](const auto& prepare) { prepare(primitive.positions); });
  });
}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    closing_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ReadAhead::reached(uint64_t window) {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    reached_ = window;
  }
  changed_.notify_all();
}

void ReadAhead::start(uint64_t most_bytes, Prepare prepare) {
  try {
    threads_.emplace_back([this, most_bytes, prepare = std::move(prepare)] {
      try {
        run(most_bytes, prepare);
      } catch (const std::bad_alloc&) {  // handled like a thread that cannot start
      }
    });
  } catch (const std::exception&) {  // without this thread, measuring is only slower
  }
}

void ReadAhead::run(uint64_t most_bytes, const Prepare& prepare) {
  std::deque<uint64_t> prepared;  // bytes of the windows from number `first` on
  uint64_t first = 0, bytes = 0;
  std::unique_lock<std::mutex> hold(lock_);
  while (!closing_ && first + prepared.size() < windows_.size()) {
    for (; first < reached_; ++first) {
      if (prepared.empty()) continue;
      bytes -= prepared.front();
      prepared.pop_front();
    }
    const uint64_t next = first + prepared.size();
    if (bytes >= most_bytes || next >= windows_.size()) {
      if (next < windows_.size()) changed_.wait(hold, [&] { return closing_ || reached_ > first; });
      continue;
    }
    hold.unlock();
    prepared.push_back(prepare(windows_[next]));
    bytes += prepared.back();
    hold.lock();
  }
}

uint64_t ReadAhead::ask(const WindowPlan& window) const {
  const Primitive& primitive = scene_.primitives[window.primitive];
  constexpr Hint kHint = &ByteSource::will_need;
  return prepare_indices(primitive, window, kHint) +
         prepare_vertices(primitive, window, kHint, [&](const auto& prepare) {
           prepare(primitive.positions);
           if (attributes_) {
             visit_attributes(primitive, normals_, prepare);
           } else if (primitive.color) {
             prepare(*primitive.color);
           }
         });
}

}  // namespace scree::convert
