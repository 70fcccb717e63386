// The index stream of a chunk: bit-packed differences from the smallest index. Source: spec/codecs.md, indices.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "format/bitpack.h"
#include "format/result.h"

namespace scree::format {

struct IndexRange {
  uint32_t min;
  uint32_t bits;  // bit_width(max - min), 0 to 32
};

/// Writes exactly packed_bytes(indices.size(), range.bits) bytes to `out`, slack zeroed. All indices must lie in
/// `range`.
void encode_indices(std::span<std::byte> out, std::span<const uint32_t> indices, IndexRange range);

/// Decodes one index stream: out.size() indices, each < vertex_count. `bytes`: exactly one stream, of any alignment.
/// Safe on any input; errors kTruncated, kTrailing (size is not the stream's, or slack is not zero), kRange (bits over
/// 32, index out of range), after which `out` is unspecified. No allocation; reentrant.
Result<void> decode_indices(std::span<uint32_t> out, uint32_t vertex_count, IndexRange range,
                            std::span<const std::byte> bytes);

/// The same checks without the output, for validating a page.
Result<void> check_indices(uint64_t index_count, uint32_t vertex_count, IndexRange range,
                           std::span<const std::byte> bytes);

}  // namespace scree::format
