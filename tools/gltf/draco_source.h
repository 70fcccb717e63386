// Primitives that are compressed by KHR_draco_mesh_compression: their arrays, unpacked when they are read. A stream has
// no windows: a primitive is unpacked whole, by one thread, and others unpack other primitives meanwhile.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/meshopt_windows.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// An attribute that is taken out of a stream.
struct DracoArray {
  std::string name;  // for messages
  uint32_t id = 0;   // the stream's
  ComponentType type = ComponentType::kFloat32;
  uint32_t components = 3;

  bool operator==(const DracoArray&) const = default;
};

/// What the document says of a primitive. Unpacked it is the corners of the triangles, 32 bits each, and the arrays one
/// behind another, each tightly packed and at a multiple of 4.
struct DracoPrimitive {
  uint64_t triangles = 0;
  uint64_t vertices = 0;  // below 2^32
  std::vector<DracoArray> arrays;
  uint64_t other_components = 0;  // of attributes that are in the stream and not taken

  /// Where array `number` begins; of the number behind the last one, where all end. Nothing where that passes 64 bits.
  std::optional<uint64_t> offset_of(size_t number) const;
  bool operator==(const DracoPrimitive&) const = default;
};

/// libdraco's version, such as "1.5.5"; empty where scree is built without it, and decode_draco() is kUnsupported.
std::string draco_version();

/// Unpacks a stream into `out`, offset_of(arrays.size()) bytes. The sizes that the stream's head states are held
/// against the primitive's before anything of that size is allocated, and its attributes before their values are. Safe
/// on any input. Errors kFormat, kRange, kTruncated, kUnsupported (point clouds, versions), kMemory.
Result<void> decode_draco(const DracoPrimitive& primitive, std::span<const std::byte> stream, std::span<std::byte> out);

/// At most what decode_draco() takes beside `out` for a stream of so many bytes, with the stream.
uint64_t draco_scratch_bytes(const DracoPrimitive& primitive, uint64_t stream_bytes);

/// A primitive whose stream is [offset, offset + bytes) of `stream`. Unpacked bytes are kept in `kept`, and unpacked
/// again where it let them go. Reads have decode_draco()'s errors.
std::shared_ptr<const ByteSource> draco_source(DracoPrimitive primitive, std::shared_ptr<const ByteSource> stream,
                                               uint64_t offset, uint64_t bytes, std::shared_ptr<KeptWindows> kept);

/// What such a source takes.
PackedViewMemory draco_memory(const DracoPrimitive& primitive, uint64_t stream_bytes);

}  // namespace scree::convert
