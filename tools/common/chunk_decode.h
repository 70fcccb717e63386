// Decodes chunks of an opened container to plain arrays, for inspect --verify, export and the tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::tools {

/// Streams of a chunk, as a mask.
enum ChunkPart : uint32_t {
  kPartIndices = 1,
  kPartPositions = 2,
  kPartUvs = 4,
  kPartColors = 8,
  kPartNormals = 16,
  kPartSourceIds = 32,
  kPartSecondUvs = 64,
  kPartTangents = 128,  // with kPartNormals
  kPartAll = 255,
};

/// The decoded streams of one chunk. A stream that the mesh lacks, or that was not requested, is empty.
struct DecodedChunk {
  std::vector<uint32_t> indices;     // 3 per triangle, each < vertex_count of the chunk
  std::vector<float> positions;      // x y z, model units, finite
  std::vector<float> uvs;            // u v
  std::vector<float> colors;         // linear RGBA, 0 to 1
  std::vector<float> normals;        // x y z, unit length
  std::vector<uint64_t> source_ids;  // 1 per triangle: its number in the source primitive
  std::vector<float> second_uvs;     // u v
  std::vector<float> tangents;       // x y z, unit length, and the bitangent's sign
};

/// Decodes the requested streams of a chunk of `file` into `out`, whose memory is reused. Checks every byte of these
/// streams, and with kPartAll every byte of the chunk. `page`: the raw bytes of the chunk's page, from
/// Container::load_page. Errors kRange, kTruncated, kTrailing, kFormat (with chunk and stream), kMemory; `out` is then
/// unspecified. Reentrant.
Result<void> decode_chunk(const format::Container& file, uint64_t chunk, std::span<const std::byte> page,
                          uint32_t parts, DecodedChunk& out);

/// Reads chunks one after another and keeps the page of the last one. Use one reader per thread.
class ChunkReader {
 public:
  /// `file` must outlive the reader.
  explicit ChunkReader(const format::Container& file) : file_(&file) {}

  /// The chunk, valid until the next call. Errors as load_page (with the page) and decode_chunk.
  Result<const DecodedChunk*> read(uint64_t chunk, uint32_t parts = kPartAll);

 private:
  const format::Container* file_;
  std::vector<std::byte> scratch_;
  std::span<const std::byte> page_;
  uint32_t page_number_ = format::kNone;
  DecodedChunk chunk_;
};

}  // namespace scree::tools
