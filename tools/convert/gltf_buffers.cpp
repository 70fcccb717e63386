#include "tools/convert/gltf_buffers.h"

#include <algorithm>
#include <array>
#include <utility>

#include "format/bytes.h"
#include "tools/convert/byte_source.h"
#include "tools/convert/gltf_uri.h"

namespace scree::convert {
namespace {

using format::checked_add;
using format::checked_mul;
using format::range_within;

// An accessor without a buffer view is all zeros and costs a file nothing, so its count could say anything. Real ones
// are bases of sparse accessors.
constexpr uint64_t kMaxZeroElements = uint64_t{1} << 24;

std::string number(uint64_t value) {
  return std::to_string(value);
}

uint32_t component_bytes(int32_t type) {
  switch (type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

Error missing(const char* what, int32_t index, size_t count) {
  return {ErrorCode::kRange,
          std::string(what) + " " + std::to_string(index) + " is not there, the document has " + number(count)};
}

}  // namespace

GltfBuffers::GltfBuffers(const GltfDocument& document, std::string folder, std::shared_ptr<const ByteSource> bin)
    : document_(document),
      folder_(std::move(folder)),
      bin_(std::move(bin)),
      buffers_(document.buffers.size()),
      sparse_checked_(document.sparse.size()) {}

Result<std::shared_ptr<const ByteSource>> GltfBuffers::open_buffer(int32_t index) {
  const DocBuffer& buffer = document_.buffers[static_cast<size_t>(index)];
  if (buffer.is_data) {
    auto bytes = data_uri(document_, buffer.json);
    if (!bytes) return bytes.error();
    return memory_source(std::move(bytes).value());
  }
  if (!buffer.uri.empty()) {
    auto path = resolve_uri(folder_, buffer.uri);
    if (!path) return path.error();
    return open_file_source(*path);
  }
  if (buffer.meshopt_fallback) {
    return Error{ErrorCode::kUnsupported,
                 "a fallback buffer without data: its views are meshopt-compressed, which scree does not read yet"};
  }
  if (index == 0 && bin_ != nullptr) return bin_;
  return Error{ErrorCode::kFormat, bin_ == nullptr ? "uri is missing, and the file has no binary chunk"
                                                   : "uri is missing, only buffer 0 is the binary chunk"};
}

Result<std::shared_ptr<const ByteSource>> GltfBuffers::buffer(int32_t index) {
  if (index < 0 || static_cast<size_t>(index) >= document_.buffers.size())
    return missing("buffer", index, document_.buffers.size());
  auto& slot = buffers_[static_cast<size_t>(index)];
  if (slot != nullptr) return slot;
  const std::string place = "buffer " + std::to_string(index);
  auto opened = open_buffer(index);
  if (!opened) return at(place, opened.error());
  const uint64_t stated = document_.buffers[static_cast<size_t>(index)].bytes;
  if ((*opened)->size() < stated) {
    return Error{ErrorCode::kTruncated, place + ": byteLength is " + number(stated) + ", but there are " +
                                            number((*opened)->size()) + " bytes"};
  }
  slot = *opened;
  return slot;
}

Result<GltfBuffers::View> GltfBuffers::view(int32_t index) {
  if (index < 0 || static_cast<size_t>(index) >= document_.views.size())
    return missing("buffer view", index, document_.views.size());
  const DocBufferView& stated = document_.views[static_cast<size_t>(index)];
  const std::string place = "buffer view " + std::to_string(index);
  auto source = buffer(stated.buffer);
  if (!source) return at(place, source.error());
  const uint64_t limit = document_.buffers[static_cast<size_t>(stated.buffer)].bytes;
  if (!range_within(stated.offset, stated.bytes, limit)) {
    return Error{ErrorCode::kRange, place + ": " + number(stated.bytes) + " bytes at " + number(stated.offset) +
                                        ", but buffer " + std::to_string(stated.buffer) + " has " + number(limit)};
  }
  return View{*source, stated.offset, stated.bytes, stated.stride};
}

Result<Accessor> GltfBuffers::accessor(int32_t index) {
  if (index < 0 || static_cast<size_t>(index) >= document_.accessors.size())
    return missing("accessor", index, document_.accessors.size());
  const DocAccessor& stated = document_.accessors[static_cast<size_t>(index)];
  const std::string place = "accessor " + std::to_string(index);
  const uint32_t bytes = component_bytes(stated.type);
  if (bytes == 0)
    return Error{ErrorCode::kFormat,
                 place + ": componentType is " + std::to_string(stated.type) + ", expected 5120 to 5123, 5125 or 5126"};
  if (stated.components == 0) return Error{ErrorCode::kFormat, place + ": type is not read here"};

  Accessor accessor;
  accessor.index = static_cast<uint32_t>(index);
  accessor.type = static_cast<ComponentType>(stated.type);
  accessor.components = stated.components;
  accessor.normalized = stated.normalized;
  accessor.count = stated.count;
  const uint64_t element = accessor.element_bytes();
  accessor.stride = element;
  if (stated.view == kAbsent) {
    if (stated.count > kMaxZeroElements) {
      return Error{ErrorCode::kRange, place + ": " + number(stated.count) +
                                          " elements without a buffer view, at most " + number(kMaxZeroElements) +
                                          " are read"};
    }
  } else {
    auto held = view(stated.view);
    if (!held) return at(place, held.error());
    if (held->stride != 0) accessor.stride = held->stride;
    if (accessor.stride < element) {
      return Error{ErrorCode::kRange, place + ": elements of " + number(element) + " bytes overlap, byteStride is " +
                                          number(accessor.stride)};
    }
    const auto span = stated.count == 0 ? std::optional<uint64_t>(0) : checked_mul(stated.count - 1, accessor.stride);
    const auto end = span ? checked_add(*span, stated.count == 0 ? 0 : element) : std::nullopt;
    if (!end || !range_within(stated.offset, *end, held->bytes)) {
      return Error{ErrorCode::kRange, place + ": " + number(stated.count) + " elements of " + number(element) +
                                          " bytes at " + number(stated.offset) + ", stride " + number(accessor.stride) +
                                          ", pass the end of buffer view " + std::to_string(stated.view) + " (" +
                                          number(held->bytes) + " bytes)"};
    }
    accessor.source = held->source;
    accessor.offset = held->offset + stated.offset;
  }
  if (stated.sparse != kAbsent) {
    if (auto checked = check_sparse(document_.sparse[static_cast<size_t>(stated.sparse)], accessor); !checked)
      return at(place + " sparse", checked.error());
  }
  return accessor;
}

Result<void> GltfBuffers::check_sparse(const DocSparse& stated, Accessor& accessor) {
  const uint32_t index_bytes = component_bytes(stated.index_type);
  if (stated.index_type != 5121 && stated.index_type != 5123 && stated.index_type != 5125) {
    return Error{ErrorCode::kFormat,
                 "indices componentType is " + std::to_string(stated.index_type) + ", expected 5121, 5123 or 5125"};
  }
  if (stated.count > accessor.count) {
    return Error{ErrorCode::kRange,
                 number(stated.count) + " values, but the accessor has " + number(accessor.count) + " elements"};
  }
  auto indices = view(stated.index_view);
  if (!indices) return at("indices", indices.error());
  auto values = view(stated.value_view);
  if (!values) return at("values", values.error());
  // Below 2^31 elements of at most 64 bytes: nothing overflows.
  if (!range_within(stated.index_offset, uint64_t{stated.count} * index_bytes, indices->bytes))
    return Error{ErrorCode::kRange, "indices pass the end of buffer view " + std::to_string(stated.index_view)};
  if (!range_within(stated.value_offset, stated.count * accessor.element_bytes(), values->bytes))
    return Error{ErrorCode::kRange, "values pass the end of buffer view " + std::to_string(stated.value_view)};

  Accessor::Sparse sparse;
  sparse.count = stated.count;
  sparse.index_type = static_cast<ComponentType>(stated.index_type);
  sparse.index_source = indices->source;
  sparse.index_offset = indices->offset + stated.index_offset;
  sparse.value_source = values->source;
  sparse.value_offset = values->offset + stated.value_offset;

  const size_t slot = static_cast<size_t>(document_.accessors[accessor.index].sparse);
  if (!sparse_checked_[slot]) {
    std::array<std::byte, 16 << 10> window;
    const uint64_t step = window.size() / index_bytes;
    uint64_t next = 0;  // the smallest index that may follow
    for (uint64_t done = 0; done < sparse.count; done += step) {
      const uint64_t n = std::min(step, sparse.count - done);
      if (auto read = sparse.index_source->read(sparse.index_offset + done * index_bytes,
                                                std::span(window).first(n * index_bytes));
          !read)
        return read;
      for (uint64_t i = 0; i < n; ++i) {
        const std::byte* from = window.data() + i * index_bytes;
        const uint64_t value = index_bytes == 1   ? format::load<uint8_t>(from)
                               : index_bytes == 2 ? format::load<uint16_t>(from)
                                                  : uint64_t{format::load<uint32_t>(from)};
        if (value >= accessor.count || value < next) {
          return Error{ErrorCode::kRange,
                       "index " + number(value) + " at place " + number(done + i) +
                           (value < next ? ", expected ascending indices"
                                         : ", but there are " + number(accessor.count) + " elements")};
        }
        next = value + 1;
      }
    }
    sparse_checked_[slot] = true;
  }
  if (sparse.count > 0) accessor.sparse = std::move(sparse);
  return {};
}

Result<GltfBuffers::View> GltfBuffers::image(const DocImage& image) {
  if (image.view != kAbsent) return view(image.view);
  if (image.is_data) {
    auto bytes = data_uri(document_, image.json);
    if (!bytes) return bytes.error();
    auto source = memory_source(std::move(bytes).value());
    const uint64_t size = source->size();
    return View{std::move(source), 0, size, 0};
  }
  if (image.uri.empty()) return Error{ErrorCode::kFormat, "has neither uri nor bufferView"};
  auto path = resolve_uri(folder_, image.uri);
  if (!path) return path.error();
  auto source = open_file_source(*path);
  if (!source) return source.error();
  const uint64_t size = (*source)->size();
  return View{std::move(source).value(), 0, size, 0};
}

uint64_t GltfBuffers::stated_bytes(int32_t index) const {
  if (index < 0 || static_cast<size_t>(index) >= document_.accessors.size()) return 0;
  const DocAccessor& stated = document_.accessors[static_cast<size_t>(index)];
  return checked_mul(stated.count, uint64_t{component_bytes(stated.type)} * stated.components).value_or(0);
}

}  // namespace scree::convert
