// The graphics pipelines of the peer: depth test, back faces culled, ids as colours.
#pragma once

#include <cstdint>
#include <span>

#include "lab/peer/vulkan_device.h"

namespace scree::lab {

/// Makes the pipeline of a vertex shader. `fetches`: positions come from a vertex buffer. Otherwise the shader reads
/// them.
Result<void> make_peer_pipeline(const VulkanDevice& gpu, VkPipelineLayout layout, std::span<const uint32_t> vertex_code,
                                bool fetches, VkPipeline& pipeline);

}  // namespace scree::lab
