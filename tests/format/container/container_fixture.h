// Small .scree files for the container's tests, and functions that change their bytes and update the checksums.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "tests/exact_copy.h"
#include "tests/format/container/reseal.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

using Bytes = std::vector<std::byte>;

/// Checks everything: open() and every page.
inline std::optional<Error> verify(std::span<const std::byte> file) {
  const auto container = format::Container::open(file);
  if (!container) return container.error();
  Bytes scratch;
  for (uint32_t i = 0; i < container->pages().size(); ++i) {
    const auto page = container->load_page(i, scratch);
    if (!page) return page.error();
  }
  return std::nullopt;
}

inline std::optional<Error> verify_copy(std::span<const std::byte> file) {
  return verify(ExactCopy(file).bytes());
}

/// The parts of a file.
struct Parts {
  std::vector<format::SealedPage> pages;
  format::TableSet tables;
};

/// The worked example of spec/container.md: one triangle, drawn once.
Parts tiny_parts();

/// Every table, both position encodings, all attributes, raw and zstd pages, an image, an empty mesh.
Parts full_parts();

/// The file's bytes. If they cannot be written, the test fails.
Bytes file_of(const Parts& parts);

/// Offset of a table's entry in a valid file's table of contents. The table must exist.
size_t toc_entry_offset(const Bytes& file, format::TableKind kind);

/// Offset of record `index` of a table.
size_t record_offset(const Bytes& file, format::TableKind kind, uint64_t index);

/// `file` with one record changed and resealed.
template <class Record>
Bytes patched(Bytes file, format::TableKind kind, uint64_t index, const std::function<void(Record&)>& change) {
  const size_t offset = record_offset(file, kind, index);
  Record record;
  std::memcpy(&record, file.data() + offset, sizeof record);
  change(record);
  std::memcpy(file.data() + offset, &record, sizeof record);
  reseal(file);
  return file;
}

/// Raw tables and pages of a file. build() lays them out again, possibly as a newer version would: with longer records,
/// unknown kinds and so on, which no writer of this version makes.
struct RawTable {
  format::TableKind kind;
  uint32_t record_bytes;
  Bytes bytes;
};
struct RawFile {
  uint16_t version_major = format::kVersionMajor, version_minor = format::kVersionMinor;
  Bytes page_area;  // from kPageAlignment on
  std::vector<RawTable> tables;

  explicit RawFile(const Bytes& file);
  Bytes build() const;
  RawTable& table(format::TableKind kind);
};

}  // namespace scree::tests
