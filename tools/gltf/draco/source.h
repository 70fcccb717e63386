// Primitives that are compressed by KHR_draco_mesh_compression: their arrays, unpacked when they are read. A stream has
// no windows: one thread unpacks a primitive whole, while other threads unpack others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/meshopt/windows.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// An attribute that is read from a stream.
struct DracoArray {
  std::string name;  // for messages
  uint32_t id = 0;   // in the stream
  ComponentType type = ComponentType::kFloat32;
  uint32_t components = 3;

  bool operator==(const DracoArray&) const = default;
};

/// A compressed primitive as the document states it. Unpacked, it consists of the triangles' corners, 32 bits each,
/// then the arrays, each tightly packed and at a multiple of 4.
struct DracoPrimitive {
  uint64_t triangles = 0;
  uint64_t vertices = 0;  // below 2^32
  std::vector<DracoArray> arrays;
  uint64_t other_components = 0;  // of attributes in the stream that are not read

  /// Offset of array `number`; for the number after the last one, the end of all. Nothing if it exceeds 64 bits.
  std::optional<uint64_t> offset_of(size_t number) const;
  bool operator==(const DracoPrimitive&) const = default;
};

/// libdraco's version, such as "1.5.5". Empty if scree is built without it; decode_draco() then fails with
/// kUnsupported.
std::string draco_version();

/// Unpacks a stream into `out`, offset_of(arrays.size()) bytes. Compares the sizes in the stream's header with the
/// primitive's before it allocates that much memory, and checks the attributes before it decodes their values. Safe on
/// any input. Errors kFormat, kRange, kTruncated, kUnsupported (point clouds, versions), kMemory.
Result<void> decode_draco(const DracoPrimitive& primitive, std::span<const std::byte> stream, std::span<std::byte> out);

/// A primitive whose stream is [offset, offset + bytes) of `stream`. Unpacked bytes are kept in `kept`, and unpacked
/// again if they were dropped. Reads have decode_draco()'s errors.
std::shared_ptr<const ByteSource> draco_source(DracoPrimitive primitive, std::shared_ptr<const ByteSource> stream,
                                               uint64_t offset, uint64_t bytes, std::shared_ptr<KeptWindows> kept);

/// Memory of such a source.
PackedViewMemory draco_memory(const DracoPrimitive& primitive, uint64_t stream_bytes);

}  // namespace scree::convert
