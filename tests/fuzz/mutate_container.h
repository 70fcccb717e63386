// Mutations of .scree files that pass the checksums.
#pragma once

#include <cstddef>
#include <cstdint>

namespace scree::fuzz {

/// libFuzzer's own mutation: changes `size` bytes into at most `max_size` and returns the new size.
using Mutate = size_t(uint8_t* data, size_t size, size_t max_size);

/// Changes one field, table, page or the whole file, and in most cases updates the checksums. Arguments and result as
/// for LLVMFuzzerCustomMutator.
size_t mutate_container(uint8_t* data, size_t size, size_t max_size, unsigned seed, Mutate* mutate);

}  // namespace scree::fuzz
