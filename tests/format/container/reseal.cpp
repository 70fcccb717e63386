#include "tests/format/container/reseal.h"

#include <cstdint>

#include "format/bytes.h"
#include "format/container/checksum.h"
#include "format/layout.h"

namespace scree::tests {

using namespace scree::format;

namespace {

/// Calls visit(offset of the entry, the entry) for each entry of the table of contents whose table lies in the file.
/// Returns false if the table of contents does not lie in the file.
template <class Visit>
bool for_each_table(std::span<std::byte> file, const Visit& visit) {
  const auto header = load<FileHeader>(file.data());
  if (!range_within(header.toc_offset, uint64_t{header.toc_count} * sizeof(TocEntry), file.size())) return false;
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    std::byte* const at = file.data() + header.toc_offset + i * sizeof(TocEntry);
    const auto entry = load<TocEntry>(at);
    const auto bytes = checked_mul(entry.record_bytes, entry.record_count);
    if (bytes && range_within(entry.offset, *bytes, file.size())) visit(at, entry);
  }
  return true;
}

}  // namespace

void reseal(std::span<std::byte> file) {
  auto header = load<FileHeader>(file.data());  // loaded first, because an entry that is stored may overlap it
  const bool has_toc = for_each_table(file, [&](std::byte* at, TocEntry entry) {
    entry.checksum = checksum(file.subspan(entry.offset, entry.record_bytes * entry.record_count));
    store(at, entry);
  });
  if (has_toc) header.toc_checksum = checksum(file.subspan(header.toc_offset, header.toc_count * sizeof(TocEntry)));
  store(file.data(), header);
  header.checksum = checksum(file.first(offsetof(FileHeader, checksum)));
  store(file.data(), header);
}

void reseal_pages(std::span<std::byte> file) {
  for_each_table(file, [&](std::byte*, const TocEntry& entry) {
    if (entry.kind != TableKind::kPages || entry.record_bytes < sizeof(PageRecord)) return;
    for (uint64_t i = 0; i < entry.record_count; ++i) {
      std::byte* const at = file.data() + entry.offset + i * entry.record_bytes;
      auto page = load<PageRecord>(at);
      if (!range_within(page.offset, page.stored_bytes, file.size())) continue;
      page.checksum = checksum(file.subspan(page.offset, page.stored_bytes));
      store(at, page);
    }
  });
}

}  // namespace scree::tests
