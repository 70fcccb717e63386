#include "tools/gltf/buffers.h"

#include <algorithm>
#include <array>
#include <utility>

#include "format/bytes.h"
#include "format/fail.h"
#include "tools/common/options/options.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/document/check.h"
#include "tools/gltf/document/uri.h"

namespace scree::convert {
namespace {

// Sparse indices must be strictly ascending and below the accessor's count.
Result<void> check_ascending(const Accessor::Sparse& sparse, uint64_t count) {
  const uint64_t index_bytes = component_bytes(sparse.index_type);
  std::array<std::byte, 16 << 10> window;
  const uint64_t step = window.size() / index_bytes;
  uint64_t next = 0;  // the smallest index that may follow
  for (uint64_t done = 0; done < sparse.count; done += step) {
    const uint64_t n = std::min(step, sparse.count - done);
    SCREE_TRY(
        sparse.index_source->read(sparse.index_offset + done * index_bytes, std::span(window).first(n * index_bytes)));
    for (uint64_t i = 0; i < n; ++i) {
      const std::byte* from = window.data() + i * index_bytes;
      const uint64_t value = index_bytes == 1   ? format::load<uint8_t>(from)
                             : index_bytes == 2 ? format::load<uint16_t>(from)
                                                : uint64_t{format::load<uint32_t>(from)};
      if (value >= count || value < next) {
        return fail(ErrorCode::kRange, "index ", value, " at element ", done + i,
                    value < next ? std::string(", expected ascending indices")
                                 : ", but there are " + std::to_string(count) + " elements");
      }
      next = value + 1;
    }
  }
  return {};
}

}  // namespace

GltfBuffers::GltfBuffers(const GltfDocument& document, std::string folder,
                         std::vector<std::shared_ptr<const ByteSource>> chunks, const ImportOptions& options)
    : document_(document),
      folder_(std::move(folder)),
      options_(options),
      chunks_(std::move(chunks)),
      buffers_(document.buffers.size()),
      // Threads read a few windows of meshopt views at a time, but whole Draco primitives.
      meshopt_(document.draco.empty() ? options.kept_view_bytes / 2 : options.kept_view_bytes),
      unpacked_(document.meshopt.size()),
      sparse_checked_(document.sparse.size()) {}

Result<std::shared_ptr<const ByteSource>> GltfBuffers::open_buffer(int32_t index) {
  const DocBuffer& buffer = document_.buffers[static_cast<size_t>(index)];
  if (buffer.is_data) {
    auto bytes = SCREE_TRY(data_uri(document_, buffer.json, options_.memory));
    return memory_source(std::move(bytes));
  }
  if (!buffer.uri.empty()) {
    auto path = SCREE_TRY(resolve_uri(folder_, buffer.uri, options_.allow_outside));
    return open_file_source(path);
  }
  if (buffer.meshopt_fallback) {
    return Error{ErrorCode::kUnsupported, "a fallback buffer without data, but a buffer view of it is not compressed"};
  }
  if (buffer.chunk != kAbsent) {
    const auto number = static_cast<size_t>(buffer.chunk);
    if (number < chunks_.size() && chunks_[number] != nullptr) return chunks_[number];
    return fail(ErrorCode::kFormat, "chunk ", number, " is no binary chunk of the file");
  }
  constexpr size_t kImplied = 1;  // the chunk of buffer 0
  const bool has_implied = kImplied < chunks_.size() && chunks_[kImplied] != nullptr;
  if (index == 0 && has_implied) return chunks_[kImplied];
  return Error{ErrorCode::kFormat, has_implied ? "uri is missing, only buffer 0 is the binary chunk"
                                               : "uri is missing, and the file has no binary chunk"};
}

Result<std::shared_ptr<const ByteSource>> GltfBuffers::buffer(int32_t index) {
  auto& slot = buffers_[static_cast<size_t>(index)];
  if (slot != nullptr) return slot;
  const std::string place = "buffer " + std::to_string(index);
  auto opened = SCREE_TRY_AT(place, open_buffer(index));
  const uint64_t stated = document_.buffers[static_cast<size_t>(index)].bytes;
  if (opened->size() < stated) {
    return fail(ErrorCode::kTruncated, place, ": byteLength is ", stated, ", but there are ", opened->size(), " bytes");
  }
  slot = opened;
  return slot;
}

Result<GltfBuffers::View> GltfBuffers::view(int32_t index) {
  const DocBufferView& stated = document_.views[static_cast<size_t>(index)];
  if (stated.meshopt != kAbsent) {
    // The compressed stream is read even if the view's own buffer has the unpacked data. That buffer is a fallback,
    // which many writers leave out.
    auto& unpacked = unpacked_[static_cast<size_t>(stated.meshopt)];
    if (unpacked == nullptr) {
      const DocMeshopt& meshopt = document_.meshopt[static_cast<size_t>(stated.meshopt)];
      if (meshopt.unknown_filter) {
        return fail(ErrorCode::kUnsupported, "buffer view ", meshopt.view, ": ", meshopt.extension(), ": filter is \"",
                    *meshopt.unknown_filter, "\", expected NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR");
      }
      auto stream = SCREE_TRY(buffer(meshopt.buffer));
      const auto made = meshopt_.view(meshopt, stream);
      count(made->memory());
      unpacked = made;
    }
    return View{unpacked, 0, stated.bytes};
  }
  auto source = SCREE_TRY(buffer(stated.buffer));
  return View{source, stated.offset, stated.bytes};
}

PackedViewMemory GltfBuffers::view_memory() const {
  PackedViewMemory memory = view_memory_;
  memory.kept_bytes = std::min(memory.kept_bytes, meshopt_.kept()->most());
  return memory;
}

void GltfBuffers::count(const PackedViewMemory& memory) {
  view_memory_.reader_bytes = std::max(view_memory_.reader_bytes, memory.reader_bytes);
  view_memory_.place_bytes += memory.place_bytes;
  view_memory_.kept_bytes += memory.kept_bytes;
}

Result<std::shared_ptr<const ByteSource>> GltfBuffers::draco(int32_t index, const DracoPrimitive& primitive) {
  const auto [first, last] = draco_.equal_range(index);
  for (auto known = first; known != last; ++known)
    if (known->second.first == primitive) return known->second.second;
  auto stream = SCREE_TRY(view(index));
  const PackedViewMemory taken = draco_memory(primitive, stream.bytes);
  if (taken.reader_bytes > options_.memory)
    return fail(ErrorCode::kUsage, "--memory: ", tools::format_bytes(options_.memory), ", but unpacking its ",
                primitive.triangles, " triangles (Draco) takes ", (taken.reader_bytes >> 20) + 1, " MiB");
  auto made = draco_source(primitive, stream.source, stream.offset, stream.bytes, meshopt_.kept());
  count(taken);
  draco_.emplace(index, std::pair(primitive, made));
  return made;
}

Result<Accessor> GltfBuffers::accessor(int32_t index) {
  SCREE_TRY(check_stop());
  const DocAccessor& stated = document_.accessors[static_cast<size_t>(index)];
  const std::string place = "accessor " + std::to_string(index);
  if (stated.components == 0 || stated.components > 4)
    return Error{ErrorCode::kFormat, place + ": a matrix, expected a scalar or vector"};

  Accessor accessor;
  accessor.index = static_cast<uint32_t>(index);
  accessor.type = static_cast<ComponentType>(stated.type);
  accessor.components = stated.components;
  accessor.normalized = stated.normalized;
  accessor.count = stated.count;
  accessor.stride = accessor.element_bytes();
  if (stated.view != kAbsent) {
    auto held = SCREE_TRY(view(stated.view));
    const uint64_t stride = document_.views[static_cast<size_t>(stated.view)].stride;
    if (stride != 0) accessor.stride = stride;
    accessor.source = held.source;
    accessor.offset = held.offset + stated.offset;
  }
  if (stated.sparse != kAbsent) {
    SCREE_TRY_AT(place + " sparse", read_sparse(static_cast<size_t>(stated.sparse), accessor));
  }
  return accessor;
}

Result<void> GltfBuffers::read_sparse(size_t slot, Accessor& accessor) {
  const DocSparse& stated = document_.sparse[slot];
  if (stated.count == 0) return {};
  auto indices = SCREE_TRY_AT("indices", view(stated.index_view));
  auto values = SCREE_TRY_AT("values", view(stated.value_view));

  Accessor::Sparse sparse{.count = stated.count,
                          .index_type = static_cast<ComponentType>(stated.index_type),
                          .index_source = indices.source,
                          .index_offset = indices.offset + stated.index_offset,
                          .value_source = values.source,
                          .value_offset = values.offset + stated.value_offset};

  if (!sparse_checked_[slot]) {
    SCREE_TRY(check_ascending(sparse, accessor.count));
    sparse_checked_[slot] = true;
  }
  accessor.sparse = std::move(sparse);
  return {};
}

Result<GltfBuffers::View> GltfBuffers::image(const DocImage& image) {
  SCREE_TRY(check_stop());
  if (image.view != kAbsent) return view(image.view);
  if (image.is_data) {
    auto bytes = SCREE_TRY(data_uri(document_, image.json, options_.memory));
    auto source = memory_source(std::move(bytes));
    const uint64_t size = source->size();
    return View{std::move(source), 0, size};
  }
  if (image.uri.empty()) return Error{ErrorCode::kFormat, "has neither uri nor bufferView"};
  auto path = SCREE_TRY(resolve_uri(folder_, image.uri, options_.allow_outside));
  auto source = SCREE_TRY(open_file_source(path));
  const uint64_t size = source->size();
  return View{std::move(source), 0, size};
}

uint64_t GltfBuffers::stated_count(int32_t index) const {
  return index < 0 || static_cast<size_t>(index) >= document_.accessors.size()
             ? 0
             : document_.accessors[static_cast<size_t>(index)].count;
}

uint64_t GltfBuffers::stated_bytes(int32_t index) const {
  if (index < 0 || static_cast<size_t>(index) >= document_.accessors.size()) return 0;
  const DocAccessor& stated = document_.accessors[static_cast<size_t>(index)];
  return format::checked_mul(stated.count, uint64_t{component_bytes(stated.type)} * stated.components).value_or(0);
}

}  // namespace scree::convert
