// The order in which the chunks of a view are drawn.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::runtime {

/// No depth code.
inline constexpr uint32_t kNotInView = UINT32_MAX;

/// The chunks that have a depth code, sorted by it; of equal codes the smaller chunk number comes first.
/// `nearest_codes`: by chunk, the nearest code that it may have, or kNotInView. Throws std::bad_alloc.
std::vector<uint32_t> order_by_depth(std::span<const uint32_t> nearest_codes);

}  // namespace scree::runtime
