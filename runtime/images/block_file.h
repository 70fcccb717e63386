// KTX2 and DDS files with pixels and blocks that scree stores unchanged, or decodes to RGBA8 (UASTC, ETC1S): reads
// their headers and their levels. Sources: KTX File Format Specification 2.0; Microsoft's DDS documentation
// (DDS_HEADER, DDS_HEADER_DXT10).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "runtime/images/basis/basis_lz.h"
#include "runtime/images/image.h"

namespace scree::runtime {

/// A KTX2 or DDS file: one two-dimensional picture and its first levels.
struct BlockFile {
  enum class Packing : uint8_t { kNone, kZstd, kZlib };
  /// The unpacked content of the file: blocks of `format`, or other blocks, which become RGBA8.
  enum class Coding : uint8_t { kBlocks, kRgb8, kUastc, kBasisLz };
  struct Level {
    uint64_t offset;            // in the file; of kBasisLz, that of the slice of colours
    uint64_t bytes;             // in the file, packed
    uint64_t alpha_offset = 0;  // of kBasisLz with two slices
    uint64_t alpha_bytes = 0;   // 0 without a second slice
  };

  const char* kind = "";  // "KTX2" or "DDS", for messages
  format::BlockFormat format = format::BlockFormat::kNoBlocks;
  uint16_t swizzle = 0;  // ImageRecord::swizzle, of the format and KTXswizzle combined
  uint32_t width = 0;    // pixels, 1 to format::kMaxBlockImageSide
  uint32_t height = 0;
  Packing packing = Packing::kNone;
  Coding coding = Coding::kBlocks;
  std::vector<Level> levels;  // 1 to all of them, level 0 first; each lies within the file
  BasisLzHead basis_lz{};     // of kBasisLz; its parts lie within the file
  uint64_t basis_lz_offset = 0;
  std::shared_ptr<const BasisLz> codebooks{};  // of kBasisLz, once a level has been read

  /// Bytes of a level of this size in the file, unpacked. Not for kBasisLz, which has no unpacked form.
  uint64_t unpacked_bytes(uint32_t level_width, uint32_t level_height) const;
};

/// Reads the header of a file that has the signature of KTX2 or DDS. Errors kFormat (malformed), kTruncated, kRange
/// (too many pixels), kUnsupported (other formats, dimensions, arrays, cubes; the message has advice if the file can be
/// converted), and errors of reading the file.
Result<BlockFile> open_ktx2(ImageFile& file);
Result<BlockFile> open_dds(ImageFile& file);

/// Whether a file has one of the two signatures.
bool is_block_file(ImageFile& file);
/// Calls open_ktx2() or open_dds(), by the signature.
Result<BlockFile> open_block_file(ImageFile& file);

/// The blocks of a level, format::block_level_bytes() bytes. Holds the blocks and the packed bytes in memory. Errors
/// kFormat (they do not unpack to that many bytes, or are malformed), and errors of reading the file. Throws
/// std::bad_alloc.
Result<std::vector<std::byte>> read_block_level(ImageFile& file, BlockFile& head, uint32_t level);

/// A level of a block image as RGBA. `blocks`: the level's blocks, at a multiple of 16. Throws std::bad_alloc.
Image decode_block_level(format::BlockFormat format, uint16_t swizzle, uint32_t width, uint32_t height,
                         const std::byte* blocks);

}  // namespace scree::runtime
