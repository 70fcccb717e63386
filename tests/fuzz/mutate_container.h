// Mutations of .scree files that get past their checksums.
#pragma once

#include <cstddef>
#include <cstdint>

namespace scree::fuzz {

/// libFuzzer's own mutation: changes `size` bytes into at most `max_size` and returns how many.
using Mutate = size_t(uint8_t* data, size_t size, size_t max_size);

/// Changes one field, table, page or the whole file, and mostly makes the checksums fit again. Arguments and result as
/// LLVMFuzzerCustomMutator has them.
size_t mutate_container(uint8_t* data, size_t size, size_t max_size, unsigned seed, Mutate* mutate);

}  // namespace scree::fuzz
