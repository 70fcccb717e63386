#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>
#include <limits>
#include <memory>
#include <type_traits>

#include "format/bytes.h"
#include "tools/gltf/document/check.h"
#include "tools/gltf/source.h"

namespace scree::convert {

uint64_t component_bytes(ComponentType type) {
  return component_bytes(static_cast<int32_t>(type));
}

namespace {

constexpr uint64_t kStackWindowBytes = 64 << 10;
constexpr uint64_t kGatherWindowBytes = 1 << 20;
constexpr uint64_t kGatherGapBytes = 4096;  // reading an unneeded page costs less than another system call

// The number of elements in a window of `bytes`. The last one needs no full stride.
uint64_t elements_in(uint64_t bytes, const Accessor& accessor) {
  return (bytes - accessor.element_bytes()) / accessor.stride + 1;
}

uint64_t window_bytes(const Accessor& accessor, uint64_t count) {
  return (count - 1) * accessor.stride + accessor.element_bytes();
}

uint32_t load_index(ComponentType type, const std::byte* at) {
  if (type == ComponentType::kUint8) return format::load<uint8_t>(at);
  if (type == ComponentType::kUint16) return format::load<uint16_t>(at);
  return format::load<uint32_t>(at);
}

// Writes the sparse values of elements [first, first + count) over a window of these elements.
Result<void> overlay_sparse(const Accessor& accessor, uint64_t first, uint64_t count, std::span<std::byte> window) {
  const Accessor::Sparse& sparse = *accessor.sparse;
  const uint64_t index_bytes = component_bytes(sparse.index_type);
  const uint64_t value_bytes = accessor.element_bytes();

  // Finds the first sparse index that is at least `first`. The indices ascend.
  uint64_t low = 0;
  uint64_t high = sparse.count;
  while (low < high) {
    const uint64_t middle = low + (high - low) / 2;
    std::array<std::byte, 4> bytes;
    SCREE_TRY(
        sparse.index_source->read(sparse.index_offset + middle * index_bytes, std::span(bytes).first(index_bytes)));
    if (load_index(sparse.index_type, bytes.data()) < first) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }

  std::array<std::byte, 2048> indices;
  std::array<std::byte, 8192> values;
  const uint64_t block = std::min(indices.size() / index_bytes, values.size() / value_bytes);
  for (uint64_t at = low; at < sparse.count; at += block) {
    const uint64_t n = std::min(block, sparse.count - at);
    SCREE_TRY(
        sparse.index_source->read(sparse.index_offset + at * index_bytes, std::span(indices).first(n * index_bytes)));
    uint64_t inside = 0;
    while (inside < n && load_index(sparse.index_type, indices.data() + inside * index_bytes) < first + count) ++inside;
    if (inside == 0) return {};
    SCREE_TRY(sparse.value_source->read(sparse.value_offset + at * value_bytes,
                                        std::span(values).first(inside * value_bytes)));
    for (uint64_t i = 0; i < inside; ++i) {
      const uint64_t element = load_index(sparse.index_type, indices.data() + i * index_bytes);
      if (element < first) continue;  // only if the file changed after it was checked
      std::memcpy(window.data() + (element - first) * accessor.stride, values.data() + i * value_bytes, value_bytes);
    }
    if (inside < n) return {};
  }
  return {};
}

// Reads elements [first, first + count) as stored, accessor.stride bytes apart. `window` has window_bytes(count).
Result<void> load_window(const Accessor& accessor, uint64_t first, uint64_t count, std::span<std::byte> window) {
  if (accessor.source == nullptr) {
    std::fill(window.begin(), window.end(), std::byte{0});
  } else if (auto read = accessor.source->read(accessor.offset + first * accessor.stride, window); !read) {
    return read;
  }
  if (accessor.sparse) return overlay_sparse(accessor, first, count, window);
  return {};
}

// Reads elements [first, first + count) in windows on the stack. Calls `use(done, window, n)` for the n elements after
// the first `done`; the window is as load_window() fills it.
template <class Use>
Result<void> each_window(const Accessor& accessor, uint64_t first, uint64_t count, const Use& use) {
  std::array<std::byte, kStackWindowBytes> window;
  const uint64_t step = elements_in(window.size(), accessor);
  for (uint64_t done = 0; done < count; done += step) {
    const uint64_t n = std::min(step, count - done);
    SCREE_TRY(load_window(accessor, first + done, n, std::span(window).first(window_bytes(accessor, n))));
    use(done, window.data(), n);
  }
  return {};
}

// glTF 2.0, 3.11 and KHR_mesh_quantization: c / 127 with -128 clamped to -1, c / 255, and so on.
float normalized_float(float value, float largest) {
  return std::max(value / largest, -1.0f);
}

template <class T>
float to_float(T value, bool normalized) {
  if constexpr (std::is_floating_point_v<T>) {
    return value;
  } else {
    const float scaled = static_cast<float>(value);
    return normalized ? normalized_float(scaled, static_cast<float>(std::numeric_limits<T>::max())) : scaled;
  }
}

// Converts `count` elements of a window. Element i of the output is element place(i) of the window.
template <class T, class Place>
void convert_elements(const Accessor& accessor, const std::byte* window, uint64_t count, Place place, float* out) {
  const uint32_t components = accessor.components;
  for (uint64_t i = 0; i < count; ++i) {
    const std::byte* element = window + place(i) * accessor.stride;
    for (uint32_t c = 0; c < components; ++c)
      *out++ = to_float(format::load<T>(element + c * sizeof(T)), accessor.normalized);
  }
}

template <class Place>
void convert_window(const Accessor& accessor, const std::byte* window, uint64_t count, Place place, float* out) {
  visit_component(accessor.type, [&]<class T>(T) { convert_elements<T>(accessor, window, count, place, out); });
}

bool lies_as_floats(const Accessor& accessor) {
  return accessor.type == ComponentType::kFloat32 && accessor.stride == accessor.element_bytes();
}

Error range_error(const Primitive& primitive, uint32_t index, uint64_t place) {
  return {ErrorCode::kRange, "mesh " + std::to_string(primitive.mesh) + " primitive " +
                                 std::to_string(primitive.place) + ": index " + std::to_string(index) + " at element " +
                                 std::to_string(place) + ", but the mesh has " +
                                 std::to_string(primitive.vertex_count()) + " vertices"};
}

// Reads `out.size()` vertex numbers of the index accessor from index `first` on, and checks them. Without an accessor
// it counts up.
Result<void> read_indices(const Primitive& primitive, uint64_t first, std::span<uint32_t> out) {
  if (!primitive.indices) {
    for (size_t i = 0; i < out.size(); ++i) out[i] = static_cast<uint32_t>(first + i);
    return {};
  }
  const Accessor& accessor = *primitive.indices;
  uint32_t highest = 0;
  const auto note = [&](std::span<const uint32_t> indices) {
    for (const uint32_t index : indices) highest = std::max(highest, index);
  };
  if (accessor.type == ComponentType::kUint32 && accessor.stride == sizeof(uint32_t)) {
    constexpr size_t kAtOnce = 1 << 16;  // still in the cache when they are checked
    for (size_t done = 0; done < out.size(); done += kAtOnce) {
      const std::span<uint32_t> some = out.subspan(done, std::min(kAtOnce, out.size() - done));
      SCREE_TRY(load_window(accessor, first + done, some.size(), std::as_writable_bytes(some)));
      note(some);
    }
  } else {
    const auto use = [&](uint64_t done, const std::byte* window, uint64_t n) {
      uint32_t* to = out.data() + done;
      if (accessor.type == ComponentType::kUint16 && accessor.stride == sizeof(uint16_t)) {
        for (uint64_t i = 0; i < n; ++i) to[i] = format::load<uint16_t>(window + i * sizeof(uint16_t));
      } else {
        for (uint64_t i = 0; i < n; ++i) to[i] = load_index(accessor.type, window + i * accessor.stride);
      }
      note({to, n});
    };
    SCREE_TRY(each_window(accessor, first, out.size(), use));
  }
  if (highest < primitive.vertex_count()) return {};
  for (size_t i = 0; i < out.size(); ++i) {
    if (out[i] >= primitive.vertex_count()) return range_error(primitive, out[i], first + i);
  }
  return {};
}

// Strips and fans: every triangle shares two vertices with the previous one.
Result<void> read_joined_triangles(const Primitive& primitive, uint64_t first, std::span<uint32_t> out) {
  constexpr uint64_t kAtOnce = 4096;
  std::array<uint32_t, kAtOnce + 2> indices;
  const bool fan = primitive.mode == PrimitiveMode::kFan;
  uint32_t hub = 0;
  if (fan) SCREE_TRY(read_indices(primitive, 0, std::span(&hub, 1)));
  const uint64_t count = out.size() / 3;
  for (uint64_t done = 0; done < count; done += kAtOnce) {
    const uint64_t n = std::min(kAtOnce, count - done);
    const uint64_t place = first + done;
    SCREE_TRY(read_indices(primitive, place + (fan ? 1 : 0), std::span(indices).first(n + (fan ? 1 : 2))));
    uint32_t* to = out.data() + done * 3;
    for (uint64_t i = 0; i < n; ++i, to += 3) {
      // glTF 2.0, 3.7.2.1: strip {v(i), v(i + 1 + i % 2), v(i + 2 - i % 2)}, fan {v(i + 1), v(i + 2), v(0)}.
      const uint64_t odd = (place + i) % 2;
      to[0] = indices[i];
      to[1] = fan ? indices[i + 1] : indices[i + 1 + odd];
      to[2] = fan ? hub : indices[i + 2 - odd];
    }
  }
  return {};
}

}  // namespace

float float_of(const Accessor& accessor, float component) {
  if (!accessor.normalized || accessor.type == ComponentType::kFloat32) return component;
  const bool is_signed = accessor.type == ComponentType::kInt8 || accessor.type == ComponentType::kInt16;
  const uint64_t bits = 8 * component_bytes(accessor.type) - (is_signed ? 1 : 0);
  return normalized_float(component, static_cast<float>((uint64_t{1} << bits) - 1));
}

uint64_t Accessor::element_bytes() const {
  return component_bytes(type) * components;
}

uint64_t Primitive::triangle_count() const {
  const uint64_t places = indices ? indices->count : positions.count;
  if (mode == PrimitiveMode::kTriangles) return places / 3;
  return places < 3 ? 0 : places - 2;
}

Result<void> read_floats(const Accessor& accessor, uint64_t first, uint64_t count, std::span<float> out) {
  assert(first <= accessor.count && count <= accessor.count - first);
  assert(out.size() == count * accessor.components);
  if (count == 0) return {};
  if (lies_as_floats(accessor)) return load_window(accessor, first, count, std::as_writable_bytes(out));
  return each_window(accessor, first, count, [&](uint64_t done, const std::byte* window, uint64_t n) {
    convert_window(
        accessor, window, n, [](uint64_t i) { return i; }, out.data() + done * accessor.components);
  });
}

Result<void> read_elements(const Accessor& accessor, uint64_t first, uint64_t count, std::span<std::byte> out) {
  const uint64_t bytes = accessor.element_bytes();
  assert(first <= accessor.count && count <= accessor.count - first);
  assert(out.size() == count * bytes);
  if (count == 0) return {};
  if (accessor.stride == bytes) return load_window(accessor, first, count, out);
  return each_window(accessor, first, count, [&](uint64_t done, const std::byte* window, uint64_t n) {
    for (uint64_t i = 0; i < n; ++i) std::memcpy(out.data() + (done + i) * bytes, window + i * accessor.stride, bytes);
  });
}

Result<void> gather_floats(const Accessor& accessor, std::span<const uint32_t> ascending, std::span<float> out) {
  assert(out.size() == ascending.size() * accessor.components);
  thread_local std::unique_ptr<std::byte[]> window;
  const uint64_t most = elements_in(kGatherWindowBytes, accessor);
  const uint64_t gap = kGatherGapBytes / accessor.stride + 1;
  for (size_t i = 0; i < ascending.size();) {
    const uint32_t first = ascending[i];
    size_t end = i + 1;
    bool dense = true;
    while (end < ascending.size() && ascending[end] - first < most && ascending[end] - ascending[end - 1] <= gap) {
      dense = dense && ascending[end] - ascending[end - 1] == 1;
      ++end;
    }
    const uint64_t count = uint64_t{ascending[end - 1]} - first + 1;
    assert(ascending[end - 1] >= first && ascending[end - 1] < accessor.count);
    float* to = out.data() + i * accessor.components;
    if (dense && lies_as_floats(accessor)) {
      const std::span<float> target(to, count * accessor.components);
      SCREE_TRY(load_window(accessor, first, count, std::as_writable_bytes(target)));
    } else {
      if (window == nullptr) window.reset(new std::byte[kGatherWindowBytes]);
      SCREE_TRY(load_window(accessor, first, count, {window.get(), window_bytes(accessor, count)}));
      const uint32_t* numbers = ascending.data() + i;
      convert_window(
          accessor, window.get(), end - i, [&](uint64_t k) { return numbers[k] - first; }, to);
    }
    i = end;
  }
  return {};
}

Result<void> read_triangles(const Primitive& primitive, uint64_t first, [[maybe_unused]] uint64_t count,
                            std::span<uint32_t> out) {
  assert(first <= primitive.triangle_count() && count <= primitive.triangle_count() - first);
  assert(out.size() == count * 3);
  if (primitive.mode == PrimitiveMode::kTriangles) return read_indices(primitive, first * 3, out);
  return read_joined_triangles(primitive, first, out);
}

}  // namespace scree::convert
