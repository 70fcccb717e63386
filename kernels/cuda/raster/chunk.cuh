// An indexed chunk as stage 1 reads it on a GPU: its streams, unpacked by lanes, and the data for drawing it for an
// instance.
#pragma once

#include "kernels/raster/vertex.h"

namespace scree::kernels {

/// The data of an instance of the current chunk for the exact projection.
struct alignas(16) InstanceTransform {
  float x[4];  // rows of its transform
  float y[4];
  float w[4];
  union {
    int32_t base[3];  // lattice coordinate of code 0 minus the transform's reference
    float center[3];  // float32 positions
  };
  uint32_t flags;
  uint64_t first_id;  // id of the chunk's triangle 0
  uint32_t instance;
  float error[3];  // of x, y and w: set_error()
  uint32_t reserved[2];

  static constexpr uint32_t kMirrored = 1;
  static constexpr uint32_t kFarAway = 2;  // base + code does not fit int32

  __device__ InstanceTransform() {}
  __device__ InstanceTransform(const SceneView& scene, const Transform& transform, const TransformError& bound,
                               const format::MeshRecord& mesh, const format::ChunkRecord& chunk, uint32_t number) {
    const ChunkReader reader = make_reader(mesh, chunk, scene.pages[chunk.page], transform, 0);
    for (int i = 0; i < 4; ++i) {
      x[i] = transform.x[i];
      y[i] = transform.y[i];
      w[i] = transform.w[i];
    }
    for (int i = 0; i < 3; ++i) {
      if (reader.float32) {
        center[i] = reader.center[i];
      } else {
        base[i] = static_cast<int32_t>(reader.base[i]);
      }
    }
    flags = (transform.mirrored ? kMirrored : 0u) | (reader.narrow ? 0u : kFarAway);
    first_id = scene.instance_base[number] + chunk.first_triangle;
    instance = number;
    error[0] = bound.x;
    error[1] = bound.y;
    error[2] = bound.w;
  }
};

/// How a stream is read: from a window of three words that holds a whole item, at 32-bit bit offsets; as plain 32-bit
/// values; or value by value, for any width.
enum class Fetch : uint32_t { kWindow, kWords, kGeneric };

/// A chunk's stored indices and positions and how they are unpacked. The same for all lanes.
struct PackedChunkView {
  const uint32_t* indices;
  const uint32_t* positions;
  uint32_t index_bits;
  uint32_t index_mask;
  uint32_t index_min;
  uint32_t triangle_bits;
  uint32_t stride;
  uint32_t first_position_bit;  // kWindow: bit of vertex index_min
  uint32_t bits[3];
  uint32_t mask[3];
  Fetch index_fetch;
  Fetch position_fetch;

  __device__ PackedChunkView() {}
  __device__ PackedChunkView(const SceneView& scene, const format::MeshRecord& mesh, const format::ChunkRecord& chunk) {
    constexpr uint64_t kShort = uint64_t{1} << 32;
    const std::byte* payload = scene.pages[chunk.page] + chunk.offset;
    const format::ChunkStreams streams = streams_of(mesh, chunk);
    indices = reinterpret_cast<const uint32_t*>(payload + streams.indices.offset);
    positions = reinterpret_cast<const uint32_t*>(payload + streams.positions.offset);
    index_bits = chunk.index_bits;
    index_mask = index_bits == 0 ? 0 : ~0u >> (32 - index_bits);
    index_min = chunk.index_min;
    triangle_bits = 3 * index_bits;
    const bool windowed_indices =
        index_bits != 0 && index_bits <= 21 && uint64_t{chunk.triangle_count} * triangle_bits < kShort;
    index_fetch = windowed_indices ? Fetch::kWindow : index_bits == 32 ? Fetch::kWords : Fetch::kGeneric;
    stride = 0;
    bool windowed = true;
    for (int i = 0; i < 3; ++i) {
      bits[i] = chunk.position_bits[i];
      mask[i] = bits[i] == 0 ? 0 : ~0u >> (32 - bits[i]);
      stride += bits[i];
      windowed = windowed && bits[i] <= 23;
    }
    windowed = windowed && stride != 0 && stride <= 64 && uint64_t{chunk.vertex_count} * stride < kShort;
    const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
    position_fetch = float32 ? Fetch::kWords : windowed ? Fetch::kWindow : Fetch::kGeneric;
    first_position_bit = index_min * stride;
  }

  /// The words that hold a triangle's indices, or the indices themselves.
  struct IndexWords {
    uint32_t word[3];
    uint32_t shift;  // kWindow: bit of the first index in them, modulo 32
  };

  template <Fetch kFetch>
  __device__ IndexWords load_indices(uint32_t triangle) const {
    IndexWords out;
    if constexpr (kFetch == Fetch::kWindow) {
      // An item begins in the first word. The stream's slack covers two more.
      out.shift = triangle * triangle_bits;
      const uint32_t* from = indices + (out.shift >> 5);
      for (int i = 0; i < 3; ++i) out.word[i] = __ldg(from + i);
    } else if constexpr (kFetch == Fetch::kWords) {
      const uint32_t* from = indices + 3 * uint64_t{triangle};
      for (int i = 0; i < 3; ++i) out.word[i] = __ldg(from + i);
    } else {
      const uint64_t bit = uint64_t{triangle} * triangle_bits;
      for (uint32_t i = 0; i < 3; ++i) out.word[i] = unpack_bits(indices, bit + i * index_bits, index_bits);
    }
    return out;
  }

  /// Vertex numbers minus index_min.
  template <Fetch kFetch>
  __device__ void decode_indices(const IndexWords& words, uint32_t out[3]) const {
    if constexpr (kFetch == Fetch::kWindow) {
      const uint32_t low = __funnelshift_r(words.word[0], words.word[1], words.shift);
      const uint32_t high = __funnelshift_r(words.word[1], words.word[2], words.shift);
      const uint64_t window = (uint64_t{high} << 32) | low;
      out[0] = low & index_mask;
      out[1] = static_cast<uint32_t>(window >> index_bits) & index_mask;
      out[2] = static_cast<uint32_t>(window >> (2 * index_bits)) & index_mask;
    } else {
      for (int i = 0; i < 3; ++i) out[i] = words.word[i];
    }
  }

  /// The words that hold a stored position, or the position itself. `vertex` is relative to index_min.
  struct PositionWords {
    uint32_t word[3];
    uint32_t shift;  // kWindow: first bit, modulo 32
  };

  template <Fetch kFetch>
  __device__ PositionWords load_position(uint32_t vertex) const {
    PositionWords out;
    if constexpr (kFetch == Fetch::kWindow) {
      out.shift = first_position_bit + vertex * stride;
      const uint32_t* from = positions + (out.shift >> 5);
      for (int i = 0; i < 3; ++i) out.word[i] = __ldg(from + i);
    } else if constexpr (kFetch == Fetch::kWords) {
      const uint32_t* from = positions + 3 * (uint64_t{index_min} + vertex);
      for (int i = 0; i < 3; ++i) out.word[i] = __ldg(from + i);
    } else {
      uint64_t bit = (uint64_t{index_min} + vertex) * stride;
      for (int i = 0; i < 3; ++i) {
        out.word[i] = unpack_bits(positions, bit, bits[i]);
        bit += bits[i];
      }
    }
    return out;
  }

  /// The bits of the three coordinates. In a window, bits of the next position follow above them.
  template <Fetch kFetch>
  __device__ void shift_position(const PositionWords& words, uint32_t out[3]) const {
    if constexpr (kFetch == Fetch::kWindow) {
      out[0] = __funnelshift_r(words.word[0], words.word[1], words.shift);
      const uint64_t window = (uint64_t{__funnelshift_r(words.word[1], words.word[2], words.shift)} << 32) | out[0];
      out[1] = static_cast<uint32_t>(window >> bits[0]);
      out[2] = static_cast<uint32_t>(window >> (bits[0] + bits[1]));
    } else {
      for (int i = 0; i < 3; ++i) out[i] = words.word[i];
    }
  }

  /// A stored position as floats, exact.
  template <Fetch kFetch>
  __device__ void position(const PositionWords& words, float out[3]) const {
    uint32_t code[3];
    shift_position<kFetch>(words, code);
    for (int i = 0; i < 3; ++i) {
      if constexpr (kFetch == Fetch::kWindow) {
        // 2^23 + code as a float has the code as its mantissa.
        out[i] = __uint_as_float((code[i] & mask[i]) | 0x4b000000u) - 8388608.0f;
      } else if constexpr (kFetch == Fetch::kWords) {
        out[i] = __uint_as_float(code[i]);
      } else {
        out[i] = static_cast<float>(code[i]);
      }
    }
  }

  /// The position relative to an instance's reference, rounded once: ChunkReader::relative().
  template <Fetch kFetch>
  __device__ void relative(uint32_t vertex, const InstanceTransform& instance, float out[3]) const {
    uint32_t code[3];
    shift_position<kFetch>(load_position<kFetch>(vertex), code);
    for (int i = 0; i < 3; ++i) {
      if constexpr (kFetch == Fetch::kWords) {
        out[i] = __uint_as_float(code[i]) - instance.center[i];
      } else {
        const uint32_t bits_of_code = kFetch == Fetch::kWindow ? code[i] & mask[i] : code[i];
        out[i] = static_cast<float>(instance.base[i] + static_cast<int32_t>(bits_of_code));
      }
    }
  }
};

}  // namespace scree::kernels
