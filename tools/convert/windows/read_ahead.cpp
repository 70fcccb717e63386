#include "tools/convert/windows/read_ahead.h"

#include <algorithm>
#include <deque>
#include <exception>
#include <new>

#include "tools/convert/windows/locality.h"

namespace scree::convert {
namespace {

/// Starts the read-ahead of elements [first, end) and returns their bytes.
uint64_t ask_elements(const Accessor& accessor, uint64_t first, uint64_t end) {
  end = std::min(end, accessor.count);
  if (accessor.source == nullptr || first >= end) return 0;
  const uint64_t bytes = (end - first - 1) * accessor.stride + accessor.element_bytes();
  accessor.source->will_need(accessor.offset + first * accessor.stride, bytes);
  return bytes;
}

/// part / whole of `count`, which is below 2^32. Computed in floating point, because the product of two counts from a
/// file may exceed 64 bits.
uint64_t share(uint64_t count, uint64_t part, uint64_t whole) {
  return static_cast<uint64_t>(static_cast<double>(count) * static_cast<double>(part) / static_cast<double>(whole));
}

}  // namespace

ReadAhead::ReadAhead(const SourceScene& scene, const std::vector<WindowPlan>& windows, uint64_t most_bytes,
                     bool attributes, bool normals)
    : scene_(scene), windows_(windows), most_bytes_(most_bytes), attributes_(attributes), normals_(normals) {
  try {
    thread_ = std::thread([this] {
      try {
        run();
      } catch (const std::bad_alloc&) {  // handled like a thread that cannot start
      }
    });
  } catch (const std::exception&) {  // without this thread, measuring is only slower
  }
}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    closing_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void ReadAhead::reached(uint64_t window) {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    reached_ = window;
  }
  changed_.notify_all();
}

void ReadAhead::run() {
  std::deque<uint64_t> asked;  // bytes of the windows from number `first` on
  uint64_t first = 0, bytes = 0;
  std::unique_lock<std::mutex> hold(lock_);
  while (!closing_ && first + asked.size() < windows_.size()) {
    for (; first < reached_; ++first) {
      if (asked.empty()) continue;
      bytes -= asked.front();
      asked.pop_front();
    }
    const uint64_t next = first + asked.size();
    if (bytes >= most_bytes_ || next >= windows_.size()) {
      if (next < windows_.size()) changed_.wait(hold, [&] { return closing_ || reached_ > first; });
      continue;
    }
    hold.unlock();
    asked.push_back(ask(windows_[next]));
    bytes += asked.back();
    hold.lock();
  }
}

uint64_t ReadAhead::ask(const WindowPlan& window) const {
  const Primitive& primitive = scene_.primitives[window.primitive];
  const uint64_t end = window.first + window.count;
  const uint64_t corners = primitive.mode == PrimitiveMode::kTriangles ? 3 : 1;
  uint64_t bytes = 0;
  if (primitive.indices) bytes += ask_elements(*primitive.indices, corners * window.first, corners * end + 2);
  const uint64_t vertices = primitive.vertex_count(), triangles = primitive.triangle_count();
  if (vertices > kMostVertices * triangles)
    return bytes;  // most vertices belong to other primitives, and it is not known which belong to this one
  const uint64_t first_vertex = share(vertices, window.first, triangles);
  const uint64_t end_vertex = share(vertices, end, triangles) + 1;
  bytes += ask_elements(primitive.positions, first_vertex, end_vertex);
  const auto ask_vertices = [&](const Accessor& accessor) {
    bytes += ask_elements(accessor, first_vertex, end_vertex);
  };
  if (attributes_) {
    visit_attributes(primitive, normals_, ask_vertices);
  } else if (primitive.color) {
    ask_vertices(*primitive.color);
  }
  return bytes;
}

}  // namespace scree::convert
