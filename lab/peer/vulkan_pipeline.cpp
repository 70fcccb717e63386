#include "lab/peer/vulkan_pipeline.h"

#include <array>

#include "fragment_shader.h"

namespace scree::lab {

Result<void> make_peer_pipeline(const VulkanDevice& gpu, VkPipelineLayout layout, std::span<const uint32_t> vertex_code,
                                bool fetches, VkPipeline& pipeline) {
  const VulkanApi& vk = gpu.api();
  std::array<VkShaderModule, 2> shaders{};
  const std::span<const uint32_t> codes[2] = {vertex_code, fragment_shader};
  Result<void> done;
  for (size_t i = 0; i < 2 && done; ++i) {
    const VkShaderModuleCreateInfo info{.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                        .codeSize = codes[i].size_bytes(),
                                        .pCode = codes[i].data()};
    done =
        vulkan_made(vk.vkCreateShaderModule(gpu.handle(), &info, nullptr, &shaders[i]), shaders[i], "making a shader");
  }
  const VkPipelineShaderStageCreateInfo stages[2] = {{.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                      .stage = VK_SHADER_STAGE_VERTEX_BIT,
                                                      .module = shaders[0],
                                                      .pName = "main"},
                                                     {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                      .stage = VK_SHADER_STAGE_FRAGMENT_BIT,
                                                      .module = shaders[1],
                                                      .pName = "main"}};
  const VkVertexInputBindingDescription binding{0, 3 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX};
  const VkVertexInputAttributeDescription attribute{0, 0, VK_FORMAT_R32G32B32_SFLOAT, 0};
  VkPipelineVertexInputStateCreateInfo fetch{.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO};
  if (fetches) {
    fetch.vertexBindingDescriptionCount = fetch.vertexAttributeDescriptionCount = 1;
    fetch.pVertexBindingDescriptions = &binding;
    fetch.pVertexAttributeDescriptions = &attribute;
  }
  const VkPipelineInputAssemblyStateCreateInfo assembly{
      .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
      .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
  const VkPipelineViewportStateCreateInfo viewport{
      .sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO, .viewportCount = 1, .scissorCount = 1};
  const VkPipelineRasterizationStateCreateInfo raster{
      .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
      .polygonMode = VK_POLYGON_MODE_FILL,
      .cullMode = VK_CULL_MODE_BACK_BIT,
      .lineWidth = 1};
  const VkPipelineMultisampleStateCreateInfo samples{.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
                                                     .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
  const VkPipelineDepthStencilStateCreateInfo depth{.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO,
                                                    .depthTestEnable = VK_TRUE,
                                                    .depthWriteEnable = VK_TRUE,
                                                    .depthCompareOp = VK_COMPARE_OP_GREATER};
  const VkPipelineColorBlendAttachmentState written{.colorWriteMask =
                                                        VK_COLOR_COMPONENT_R_BIT | VK_COLOR_COMPONENT_G_BIT};
  const VkPipelineColorBlendStateCreateInfo blend{.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
                                                  .attachmentCount = 1,
                                                  .pAttachments = &written};
  const VkDynamicState states[3] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR, VK_DYNAMIC_STATE_FRONT_FACE};
  const VkPipelineDynamicStateCreateInfo dynamic{
      .sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO, .dynamicStateCount = 3, .pDynamicStates = states};
  const VkFormat ids = VulkanDevice::kIds;
  const VkPipelineRenderingCreateInfo pictures{.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO,
                                               .colorAttachmentCount = 1,
                                               .pColorAttachmentFormats = &ids,
                                               .depthAttachmentFormat = VulkanDevice::kDepth};
  const VkGraphicsPipelineCreateInfo info{.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                          .pNext = &pictures,
                                          .stageCount = 2,
                                          .pStages = stages,
                                          .pVertexInputState = &fetch,
                                          .pInputAssemblyState = &assembly,
                                          .pViewportState = &viewport,
                                          .pRasterizationState = &raster,
                                          .pMultisampleState = &samples,
                                          .pDepthStencilState = &depth,
                                          .pColorBlendState = &blend,
                                          .pDynamicState = &dynamic,
                                          .layout = layout};
  if (done)
    done = vulkan_made(vk.vkCreateGraphicsPipelines(gpu.handle(), VK_NULL_HANDLE, 1, &info, nullptr, &pipeline),
                       pipeline, "making a pipeline");
  for (VkShaderModule shader : shaders) vk.vkDestroyShaderModule(gpu.handle(), shader, nullptr);
  return done;
}

}  // namespace scree::lab
