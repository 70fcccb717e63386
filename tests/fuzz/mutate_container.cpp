#include "tests/fuzz/mutate_container.h"

#include <random>
#include <span>
#include <vector>

#include "format/bytes.h"
#include "format/layout.h"
#include "tests/format/container/reseal.h"

namespace scree::fuzz {
namespace {

using namespace scree::format;

struct Piece {
  size_t offset, bytes;
};

/// The meaningful parts of the file: records, pages, entries of the table of contents, the header. Most of a small file
/// is padding, in which a random mutation would be wasted.
std::vector<Piece> pieces_of(std::span<const std::byte> file) {
  std::vector<Piece> pieces = {{0, sizeof(FileHeader)}};
  const auto header = load<FileHeader>(file.data());
  const uint64_t toc_bytes = uint64_t{header.toc_count} * sizeof(TocEntry);
  if (!range_within(header.toc_offset, toc_bytes, file.size())) return pieces;
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const size_t at = header.toc_offset + i * sizeof(TocEntry);
    pieces.push_back({at, sizeof(TocEntry)});
    const auto entry = load<TocEntry>(file.data() + at);
    const auto bytes = checked_mul(entry.record_bytes, entry.record_count);
    if (!bytes || *bytes == 0 || !range_within(entry.offset, *bytes, file.size())) continue;
    if (entry.kind == TableKind::kStrings) {
      pieces.push_back({entry.offset, *bytes});
      continue;
    }
    for (uint64_t r = 0; r < entry.record_count && r < 64; ++r) {
      const size_t record = entry.offset + r * entry.record_bytes;
      pieces.push_back({record, entry.record_bytes});
      if (entry.kind != TableKind::kPages || entry.record_bytes < sizeof(PageRecord)) continue;
      const auto page = load<PageRecord>(file.data() + record);
      if (page.stored_bytes > 0 && range_within(page.offset, page.stored_bytes, file.size()))
        pieces.insert(pieces.end(), 4, {page.offset, page.stored_bytes});
    }
  }
  return pieces;
}

/// Sets a field of 1, 2, 4 or 8 bytes to a value near a limit or near its old value.
void change_field(std::span<std::byte> piece, std::minstd_rand& random) {
  const size_t width = std::min<size_t>(size_t{1} << random() % 4, piece.size());
  const size_t at = random() % (piece.size() / width) * width;
  uint64_t value = 0;
  std::memcpy(&value, piece.data() + at, width);
  switch (random() % 6) {
    case 0:
      value = 0;
      break;
    case 1:
      value = ~uint64_t{0};
      break;
    case 2:
      value += random() % 17 - 8;
      break;
    case 3:
      value ^= uint64_t{1} << random() % (8 * width);
      break;
    case 4:
      value = uint64_t{random()} << 32 | random();
      break;
    default:
      value = uint64_t{1} << random() % (8 * width);
      break;
  }
  std::memcpy(piece.data() + at, &value, width);
}

}  // namespace

size_t mutate_container(uint8_t* data, size_t size, size_t max_size, unsigned seed, Mutate* mutate) {
  std::minstd_rand random(seed);
  if (size < sizeof(FileHeader) || random() % 64 == 0) {
    size = mutate(data, size, max_size);
  } else {
    const std::span<std::byte> file(reinterpret_cast<std::byte*>(data), size);
    const std::vector<Piece> pieces = pieces_of(file);
    for (uint32_t i = 0; i < 1 + random() % 3; ++i) {
      const Piece& piece = pieces[random() % pieces.size()];
      if (random() % 2 == 0) {
        change_field(file.subspan(piece.offset, piece.bytes), random);
      } else {
        mutate(data + piece.offset, piece.bytes, piece.bytes);
      }
    }
  }
  if (size < sizeof(FileHeader) || random() % 32 == 0) return size;
  const std::span<std::byte> file(reinterpret_cast<std::byte*>(data), size);
  auto header = load<FileHeader>(file.data());
  header.file_bytes = size;
  store(file.data(), header);
  if (random() % 16 != 0) tests::reseal_pages(file);
  tests::reseal(file);
  return size;
}

}  // namespace scree::fuzz
