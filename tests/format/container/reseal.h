// Makes the checksums of a changed .scree file fit its bytes.
#pragma once

#include <cstddef>
#include <span>

namespace scree::tests {

/// Those of tables, table of contents and header, in that order; `file` has at least a header. Touches nothing that
/// lies out of bounds.
void reseal(std::span<std::byte> file);

/// Those of pages, in the page table: before reseal().
void reseal_pages(std::span<std::byte> file);

}  // namespace scree::tests
