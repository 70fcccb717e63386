#include "tools/gltf/document/glb.h"

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "format/fail.h"

namespace scree::convert {
namespace {

constexpr uint32_t kMagic = 0x46546c67;      // "glTF"
constexpr uint32_t kJsonChunk = 0x4e4f534a;  // "JSON"
constexpr uint32_t kBinChunk = 0x004e4942;   // "BIN\0"
constexpr uint64_t kHeaderBytes = 12;
constexpr uint64_t kChunkHeaderBytes = 8;
constexpr uint64_t kWideHeaderBytes = 16;  // version 3: its own header and that of each chunk
constexpr uint64_t kWideAlignment = 8;     // version 3: alignment of its chunks
constexpr uint64_t kWrap = uint64_t{1} << 32;
// glTF has two chunks, and extensions may add a few. Without a limit 4 GiB of zeros would read as half a billion empty
// chunks.
constexpr uint32_t kMaxChunks = 64;
constexpr uint32_t kMaxWideChunks = 4096;  // version 3 allows any number of binary chunks
constexpr uint64_t kMaxPadding = 4096;     // bytes after the end, all zero or blank: some writers pad to a sector

struct ChunkHeader {
  uint64_t bytes;
  uint32_t type;
};

Result<ChunkHeader> read_chunk_header(const ByteSource& file, uint64_t offset) {
  std::array<std::byte, kChunkHeaderBytes> bytes;
  SCREE_TRY(file.read(offset, bytes));
  return ChunkHeader{format::load<uint32_t>(bytes.data()), format::load<uint32_t>(bytes.data() + 4)};
}

Result<void> check_padding(const ByteSource& file, uint64_t from) {
  const uint64_t rest = file.size() - from;
  std::vector<std::byte> bytes(std::min(rest, kMaxPadding));
  SCREE_TRY(file.read(from, bytes));
  const bool blank =
      std::all_of(bytes.begin(), bytes.end(), [](std::byte b) { return b == std::byte{0} || b == std::byte{0x20}; });
  if (rest <= kMaxPadding && blank) return {};
  return fail(ErrorCode::kTrailing, "GLB header: length is ", from, ", but the file has ", file.size(), " bytes");
}

/// Version 3: chunks may come in any order, and the first JSON chunk is the document.
Result<GlbLayout> read_wide_layout(const ByteSource& file) {
  GlbLayout layout{.is_glb = true};
  std::array<std::byte, kWideHeaderBytes> header;
  if (file.size() < kWideHeaderBytes)
    return fail(ErrorCode::kTruncated, "GLB header: the file ends after ", file.size(), " bytes");
  SCREE_TRY(file.read(0, header));
  const uint64_t length = format::load<uint64_t>(header.data() + 8);
  if (length > file.size())
    return fail(ErrorCode::kTruncated, "GLB header: length is ", length, ", but the file has ", file.size(), " bytes");
  if (length < 2 * kWideHeaderBytes)
    return fail(ErrorCode::kFormat, "GLB header: length is ", length, ", too short for a chunk");
  if (length < file.size()) SCREE_TRY(check_padding(file, length));
  for (uint64_t at = kWideHeaderBytes; at < length; at = format::align_up(at, kWideAlignment)) {
    const std::string place = "GLB chunk " + std::to_string(layout.chunks.size());
    if (layout.chunks.size() == kMaxWideChunks)
      return fail(ErrorCode::kFormat, place, ": at most ", kMaxWideChunks, " are read");
    if (length - at < kWideHeaderBytes)
      return fail(ErrorCode::kTruncated, place, ": ", length - at, " bytes left for its header");
    SCREE_TRY_AT(place, file.read(at, header));
    at += kWideHeaderBytes;
    const uint32_t type = format::load<uint32_t>(header.data()), encoding = format::load<uint32_t>(header.data() + 4);
    const uint64_t bytes = format::load<uint64_t>(header.data() + 8);
    if (bytes > length - at)
      return fail(ErrorCode::kTruncated, place, ": length is ", bytes, ", but ", length - at, " bytes are left");
    if (encoding != 0 && (type == kJsonChunk || type == kBinChunk))
      return fail(ErrorCode::kUnsupported, place, ": encoded by method ", encoding, ", expected 0, not encoded");
    if (type == kJsonChunk && layout.json_bytes == 0) {
      if (bytes == 0) return Error{ErrorCode::kFormat, place + ": the JSON chunk is empty"};
      layout.json_offset = at;
      layout.json_bytes = bytes;
    }
    layout.chunks.push_back({type == kBinChunk, at, bytes});
    at += bytes;
  }
  if (layout.json_bytes == 0) return Error{ErrorCode::kFormat, "GLB: there is no JSON chunk"};
  return layout;
}

}  // namespace

Result<GlbLayout> read_glb_layout(const ByteSource& file) {
  GlbLayout layout;
  std::array<std::byte, kHeaderBytes> header{};
  const uint64_t head = std::min<uint64_t>(file.size(), kHeaderBytes);
  SCREE_TRY(file.read(0, std::span(header).first(head)));
  if (head < 4 || format::load<uint32_t>(header.data()) != kMagic) {
    layout.json_bytes = file.size();
    return layout;
  }
  layout.is_glb = true;
  if (head < kHeaderBytes) return fail(ErrorCode::kTruncated, "GLB header: the file ends after ", head, " bytes");
  const uint32_t version = format::load<uint32_t>(header.data() + 4);
  if (version == 3) return read_wide_layout(file);
  if (version != 2) return fail(ErrorCode::kVersion, "GLB header: version is ", version, ", expected 2 or 3");

  // Above 4 GiB the length is modulo 2^32. It is accepted if it then matches the size of the file.
  uint64_t length = format::load<uint32_t>(header.data() + 8);
  const bool wrapped = file.size() >= kWrap && file.size() % kWrap == length;
  if (wrapped) length = file.size();
  if (length > file.size())
    return fail(ErrorCode::kTruncated, "GLB header: length is ", length, ", but the file has ", file.size(), " bytes");
  if (length < kHeaderBytes + kChunkHeaderBytes)
    return fail(ErrorCode::kFormat, "GLB header: length is ", length, ", too short for a chunk");
  if (length < file.size()) SCREE_TRY(check_padding(file, length));

  uint64_t at = kHeaderBytes;
  for (uint32_t number = 0; at < length; ++number) {
    const std::string place = "GLB chunk " + std::to_string(number);
    if (number == kMaxChunks) return fail(ErrorCode::kFormat, place, ": at most ", kMaxChunks, " are read");
    if (length - at < kChunkHeaderBytes) {
      if (number > 0 && length - at < 4) break;  // padding was counted into the length
      return fail(ErrorCode::kTruncated, place, ": ", length - at, " bytes left for its header");
    }
    auto chunk = SCREE_TRY_AT(place, read_chunk_header(file, at));
    at += kChunkHeaderBytes;
    if (wrapped && chunk.type == kBinChunk && number == 1 && (length - at) % kWrap == chunk.bytes)
      chunk.bytes = length - at;
    if (chunk.bytes > length - at)
      return fail(ErrorCode::kTruncated, place, ": length is ", chunk.bytes, ", but ", length - at, " bytes are left");
    // Lengths should be multiples of 4. Some writers omit the padding (trimesh once did) and put the next chunk
    // immediately after.
    if (number == 0) {
      if (chunk.type != kJsonChunk) return Error{ErrorCode::kFormat, place + ": expected the JSON chunk first"};
      if (chunk.bytes == 0) return Error{ErrorCode::kFormat, place + ": the JSON chunk is empty"};
      layout.json_offset = at;
      layout.json_bytes = chunk.bytes;
    } else if (chunk.type == kJsonChunk) {
      return Error{ErrorCode::kFormat, place + ": a second JSON chunk"};
    } else if (chunk.type == kBinChunk) {
      if (number != 1) return Error{ErrorCode::kFormat, place + ": the BIN chunk, expected as chunk 1"};
    }
    layout.chunks.push_back({chunk.type == kBinChunk, at, chunk.bytes});
    at += chunk.bytes;
  }
  return layout;
}

}  // namespace scree::convert
