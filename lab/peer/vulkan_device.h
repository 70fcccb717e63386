// The part of Vulkan 1.3 that the peers need: a GPU, its memory and one queue. libvulkan.so.1 is opened at run time.
#pragma once

#define VK_NO_PROTOTYPES
#include <vulkan/vulkan_core.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "format/result.h"

namespace scree::lab {

// Functions of the library, of an instance, and of a device.
// clang-format off
#define SCREE_VULKAN_GLOBAL(X) X(vkEnumerateInstanceVersion) X(vkCreateInstance)
#define SCREE_VULKAN_INSTANCE(X)                                                                              \
  X(vkDestroyInstance) X(vkEnumeratePhysicalDevices) X(vkGetPhysicalDeviceProperties2)                        \
  X(vkGetPhysicalDeviceFeatures2) X(vkGetPhysicalDeviceFormatProperties)                                      \
  X(vkGetPhysicalDeviceMemoryProperties2) X(vkGetPhysicalDeviceQueueFamilyProperties)                         \
  X(vkEnumerateDeviceExtensionProperties) X(vkCreateDevice) X(vkGetDeviceProcAddr)
#define SCREE_VULKAN_DEVICE(X)                                                                                \
  X(vkDestroyDevice) X(vkGetDeviceQueue) X(vkDeviceWaitIdle) X(vkQueueSubmit2)                                \
  X(vkCreateFence) X(vkDestroyFence) X(vkResetFences) X(vkWaitForFences)                                      \
  X(vkAllocateMemory) X(vkFreeMemory) X(vkMapMemory)                                                          \
  X(vkCreateBuffer) X(vkDestroyBuffer) X(vkGetBufferMemoryRequirements) X(vkBindBufferMemory)                 \
  X(vkGetBufferDeviceAddress)                                                                                 \
  X(vkCreateImage) X(vkDestroyImage) X(vkGetImageMemoryRequirements) X(vkBindImageMemory)                     \
  X(vkCreateImageView) X(vkDestroyImageView)                                                                  \
  X(vkCreateShaderModule) X(vkDestroyShaderModule) X(vkCreatePipelineLayout) X(vkDestroyPipelineLayout)       \
  X(vkCreateGraphicsPipelines) X(vkDestroyPipeline)                                                           \
  X(vkCreateQueryPool) X(vkDestroyQueryPool) X(vkGetQueryPoolResults)                                         \
  X(vkCreateCommandPool) X(vkDestroyCommandPool) X(vkAllocateCommandBuffers)                                  \
  X(vkBeginCommandBuffer) X(vkEndCommandBuffer)                                                               \
  X(vkCmdResetQueryPool) X(vkCmdWriteTimestamp2) X(vkCmdPipelineBarrier2)                                     \
  X(vkCmdBeginRendering) X(vkCmdEndRendering) X(vkCmdBindPipeline) X(vkCmdPushConstants)                      \
  X(vkCmdSetViewport) X(vkCmdSetScissor) X(vkCmdSetFrontFace)                                                 \
  X(vkCmdBindVertexBuffers) X(vkCmdBindIndexBuffer) X(vkCmdDraw) X(vkCmdDrawIndexed)                          \
  X(vkCmdCopyBuffer) X(vkCmdCopyImageToBuffer)
// clang-format on

struct VulkanApi {
#define SCREE_VULKAN_MEMBER(name) PFN_##name name = nullptr;
  SCREE_VULKAN_GLOBAL(SCREE_VULKAN_MEMBER)
  SCREE_VULKAN_INSTANCE(SCREE_VULKAN_MEMBER)
  SCREE_VULKAN_DEVICE(SCREE_VULKAN_MEMBER)
#undef SCREE_VULKAN_MEMBER
};

/// `what`: the call's purpose. Errors kMemory (out of memory of the host or the device), kDevice.
Result<void> vulkan_check(VkResult result, const char* what);
/// As above, for the creation of `handle`, which is null after a failure.
template <class Handle>
Result<void> vulkan_made(VkResult result, Handle& handle, const char* what) {
  if (result != VK_SUCCESS) handle = VK_NULL_HANDLE;
  return vulkan_check(result, what);
}

struct VulkanBuffer {
  VkBuffer handle = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  uint64_t bytes = 0;
  VkDeviceAddress address = 0;  // of buffers that shaders read
  std::byte* mapped = nullptr;  // of buffers that the host reads or writes
};

struct VulkanImage {
  VkImage handle = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  VkImageView view = VK_NULL_HANDLE;
  uint64_t bytes = 0;
};

/// The memory of a buffer, and how the host uses it.
enum class VulkanMemory { kDevice, kHostWrites, kHostReads };

class VulkanDevice {
 public:
  static constexpr VkFormat kIds = VK_FORMAT_R32G32_UINT;
  static constexpr VkFormat kDepth = VK_FORMAT_D32_SFLOAT;

  /// Errors as open_vulkan_peer().
  static Result<std::unique_ptr<VulkanDevice>> open(std::string_view uuid);
  VulkanDevice(const VulkanDevice&) = delete;
  VulkanDevice& operator=(const VulkanDevice&) = delete;
  ~VulkanDevice();

  const VulkanApi& api() const { return api_; }
  VkDevice handle() const { return device_; }
  uint32_t queue_family() const { return queue_family_; }
  const std::string& name() const { return name_; }
  uint32_t largest_image_side() const { return largest_image_side_; }
  double timestamp_ns() const { return timestamp_ns_; }
  /// The mask of a GPU timestamp's valid bits.
  uint64_t timestamp_mask() const { return timestamp_mask_; }
  /// The most bytes of one buffer.
  uint64_t largest_buffer() const { return largest_buffer_; }
  /// Bytes of device memory: those that this process may still take, and all.
  uint64_t free_bytes() const;
  uint64_t total_bytes() const { return total_bytes_; }

  /// The caller destroys buffers and images, including empty ones. Errors kMemory, kDevice.
  Result<VulkanBuffer> make_buffer(uint64_t bytes, VkBufferUsageFlags usage, VulkanMemory memory) const;
  Result<VulkanImage> make_image(uint32_t width, uint32_t height, VkFormat format, VkImageUsageFlags usage,
                                 VkImageAspectFlags aspect) const;
  void destroy(VulkanBuffer& buffer) const;
  void destroy(VulkanImage& image) const;

  Result<VkCommandBuffer> make_commands() const;
  /// Submits the commands and waits for them. Errors kDevice.
  Result<void> run(VkCommandBuffer commands) const;

 private:
  VulkanDevice() = default;
  Result<void> load_library();
  Result<void> choose_gpu(std::string_view uuid);
  /// Empty if this GPU is suitable, else the first missing feature. Sets the members of the GPU.
  std::string examine(VkPhysicalDevice gpu);
  Result<void> make_device();
  Result<void> allocate(const VkMemoryRequirements& needs, VulkanMemory memory, bool has_address,
                        VkDeviceMemory& allocated) const;

  VulkanApi api_;
  void* library_ = nullptr;
  PFN_vkGetInstanceProcAddr instance_function_ = nullptr;
  VkInstance instance_ = VK_NULL_HANDLE;
  VkPhysicalDevice gpu_ = VK_NULL_HANDLE;
  VkDevice device_ = VK_NULL_HANDLE;
  VkQueue queue_ = VK_NULL_HANDLE;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  VkPhysicalDeviceMemoryProperties memory_{};
  std::string name_;
  uint32_t queue_family_ = 0;
  uint32_t device_heap_ = 0;
  uint32_t largest_image_side_ = 0;
  uint64_t largest_buffer_ = 0;
  uint64_t total_bytes_ = 0;
  double timestamp_ns_ = 0;
  uint64_t timestamp_mask_ = 0;
  bool has_budget_ = false;
};

}  // namespace scree::lab
