// Updates the checksums of a changed .scree file.
#pragma once

#include <cstddef>
#include <span>

namespace scree::tests {

/// Updates the checksums of tables, table of contents and header, in that order. `file` must have at least a header.
/// Changes nothing that is out of bounds.
void reseal(std::span<std::byte> file);

/// Updates the checksums of pages, in the page table. Must be called before reseal().
void reseal_pages(std::span<std::byte> file);

}  // namespace scree::tests
