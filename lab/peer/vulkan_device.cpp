#include "lab/peer/vulkan_device.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "runtime/draw/device_list.h"

namespace scree::lab {
namespace {

std::string result_name(VkResult result) {
  constexpr std::pair<VkResult, const char*> kNames[] = {
      {VK_ERROR_OUT_OF_HOST_MEMORY, "out of host memory"},
      {VK_ERROR_OUT_OF_DEVICE_MEMORY, "out of device memory"},
      {VK_ERROR_INITIALIZATION_FAILED, "initialization failed"},
      {VK_ERROR_DEVICE_LOST, "the device was lost"},
      {VK_ERROR_INCOMPATIBLE_DRIVER, "no driver (VK_DRIVER_FILES can name one)"},
      {VK_ERROR_FEATURE_NOT_PRESENT, "a feature is missing"},
      {VK_ERROR_EXTENSION_NOT_PRESENT, "an extension is missing"},
      {VK_ERROR_LAYER_NOT_PRESENT, "a layer is missing"}};
  for (const auto& [known, name] : kNames)
    if (result == known) return name;
  return "VkResult " + std::to_string(result);
}

Error device_error(std::string message) {
  return {ErrorCode::kDevice, "Vulkan: " + std::move(message)};
}

/// The features that the peers use.
struct Features {
  VkPhysicalDeviceFeatures2 first{};
  VkPhysicalDeviceVulkan12Features second{};
  VkPhysicalDeviceVulkan13Features third{};

  Features() {
    first.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    second.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
    third.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
    first.pNext = &second;
    second.pNext = &third;
  }
  Features(const Features&) = delete;

  /// Calls visit(name, flag) for each feature.
  template <class Visit>
  void each(const Visit& visit) {
    visit("fullDrawIndexUint32", first.features.fullDrawIndexUint32);
    visit("geometryShader", first.features.geometryShader);  // gl_PrimitiveID in a fragment shader
    visit("bufferDeviceAddress", second.bufferDeviceAddress);
    visit("dynamicRendering", third.dynamicRendering);
    visit("synchronization2", third.synchronization2);
  }
};

}  // namespace

Result<void> vulkan_check(VkResult result, const char* what) {
  if (result == VK_SUCCESS) return {};
  const bool memory = result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY;
  return Error{memory ? ErrorCode::kMemory : ErrorCode::kDevice,
               std::string("Vulkan: ") + what + ": " + result_name(result)};
}

Result<std::unique_ptr<VulkanDevice>> VulkanDevice::open(std::string_view uuid) {
  std::unique_ptr<VulkanDevice> device(new VulkanDevice);
  SCREE_TRY(device->load_library());
  SCREE_TRY(device->choose_gpu(uuid));
  SCREE_TRY(device->make_device());
  return device;
}

VulkanDevice::~VulkanDevice() {
  if (device_ != VK_NULL_HANDLE) {
    (void)api_.vkDeviceWaitIdle(device_);
    api_.vkDestroyFence(device_, fence_, nullptr);
    api_.vkDestroyCommandPool(device_, pool_, nullptr);
    api_.vkDestroyDevice(device_, nullptr);
  }
  if (instance_ != VK_NULL_HANDLE) api_.vkDestroyInstance(instance_, nullptr);
  if (library_ != nullptr) ::dlclose(library_);
}

Result<void> VulkanDevice::load_library() {
  library_ = ::dlopen("libvulkan.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library_ == nullptr) {
    const char* const why = ::dlerror();
    return device_error(why == nullptr ? "libvulkan.so.1 cannot be opened" : why);
  }
  instance_function_ = reinterpret_cast<PFN_vkGetInstanceProcAddr>(::dlsym(library_, "vkGetInstanceProcAddr"));
  if (instance_function_ == nullptr) return device_error("libvulkan.so.1 has no vkGetInstanceProcAddr");
  const char* missing = nullptr;
#define SCREE_VULKAN_FIND(name)                                                   \
  api_.name = reinterpret_cast<PFN_##name>(instance_function_(instance_, #name)); \
  if (api_.name == nullptr) missing = #name;
  SCREE_VULKAN_GLOBAL(SCREE_VULKAN_FIND)
  if (missing != nullptr) return device_error(std::string("the library has no ") + missing);
  uint32_t version = 0;
  SCREE_TRY(vulkan_check(api_.vkEnumerateInstanceVersion(&version), "reading the version"));
  if (version < VK_API_VERSION_1_3) return device_error("libvulkan.so.1 is older than Vulkan 1.3");
  const VkApplicationInfo program{
      .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .pApplicationName = "scree-lab", .apiVersion = VK_API_VERSION_1_3};
  const VkInstanceCreateInfo info{.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &program};
  if (auto done = vulkan_made(api_.vkCreateInstance(&info, nullptr, &instance_), instance_, "making an instance");
      !done)
    return Error{ErrorCode::kDevice, done.error().message};
  SCREE_VULKAN_INSTANCE(SCREE_VULKAN_FIND)
#undef SCREE_VULKAN_FIND
  if (missing == nullptr) return {};
  if (api_.vkDestroyInstance == nullptr) instance_ = VK_NULL_HANDLE;
  return device_error(std::string("the instance has no ") + missing);
}

Result<void> VulkanDevice::choose_gpu(std::string_view uuid) {
  std::vector<VkPhysicalDevice> gpus(64);
  auto count = static_cast<uint32_t>(gpus.size());
  const VkResult listed = api_.vkEnumeratePhysicalDevices(instance_, &count, gpus.data());
  if (listed != VK_INCOMPLETE)
    if (auto done = vulkan_check(listed, "listing the GPUs"); !done)
      return Error{ErrorCode::kDevice, done.error().message};
  std::string found;  // the GPUs that are not taken, each with the reason
  for (uint32_t i = 0; i < count; ++i) {
    VkPhysicalDeviceIDProperties id{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES};
    VkPhysicalDeviceProperties2 properties{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &id};
    api_.vkGetPhysicalDeviceProperties2(gpus[i], &properties);
    const std::string its_uuid = runtime::uuid_name(std::as_bytes(std::span(id.deviceUUID)));
    std::string lacks;
    if (uuid.empty() || its_uuid == uuid) {
      lacks = examine(gpus[i]);
      if (lacks.empty()) return {};
    }
    found += (found.empty() ? "" : ", ") + std::string(properties.properties.deviceName) + " " + its_uuid +
             (lacks.empty() ? "" : " (" + lacks + ")");
  }
  if (found.empty()) return device_error("it lists no GPU (VK_DRIVER_FILES can name a driver)");
  return device_error((uuid.empty() ? "none" : std::string(uuid) + " is not one") +
                      " of the GPUs that can be used: " + found);
}

std::string VulkanDevice::examine(VkPhysicalDevice gpu) {
  VkPhysicalDeviceProperties2 basic{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
  api_.vkGetPhysicalDeviceProperties2(gpu, &basic);
  if (basic.properties.apiVersion < VK_API_VERSION_1_3) return "its driver is older than Vulkan 1.3";
  VkPhysicalDeviceVulkan13Properties third{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_PROPERTIES};
  VkPhysicalDeviceVulkan12Properties second{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES,
                                            .pNext = &third};
  VkPhysicalDeviceVulkan11Properties first{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES,
                                           .pNext = &second};
  basic.pNext = &first;
  api_.vkGetPhysicalDeviceProperties2(gpu, &basic);
  Features features;
  api_.vkGetPhysicalDeviceFeatures2(gpu, &features.first);
  std::string missing;
  features.each([&](const char* name, VkBool32 is_there) {
    if (is_there == VK_FALSE && missing.empty()) missing = std::string("no ") + name;
  });
  if (!missing.empty()) return missing;
  for (const auto& [format, needed] :
       {std::pair{kIds, VkFormatFeatureFlags{VK_FORMAT_FEATURE_COLOR_ATTACHMENT_BIT}},
        std::pair{kDepth, VkFormatFeatureFlags{VK_FORMAT_FEATURE_DEPTH_STENCIL_ATTACHMENT_BIT}}}) {
    VkFormatProperties can{};
    api_.vkGetPhysicalDeviceFormatProperties(gpu, format, &can);
    if ((can.optimalTilingFeatures & needed) != needed) return "no pictures of ids and 32-bit depth";
  }
  std::vector<VkQueueFamilyProperties> queues(64);
  auto count = static_cast<uint32_t>(queues.size());
  api_.vkGetPhysicalDeviceQueueFamilyProperties(gpu, &count, queues.data());
  queues.resize(count);
  const auto queue = std::find_if(queues.begin(), queues.end(), [](const VkQueueFamilyProperties& one) {
    return (one.queueFlags & VK_QUEUE_GRAPHICS_BIT) != 0 && one.timestampValidBits != 0;
  });
  if (queue == queues.end()) return "no graphics queue with timestamps";
  const VkPhysicalDeviceLimits& limits = basic.properties.limits;
  queue_family_ = static_cast<uint32_t>(queue - queues.begin());
  timestamp_ns_ = static_cast<double>(limits.timestampPeriod);
  timestamp_mask_ = ~uint64_t{0} >> (64 - queue->timestampValidBits);
  largest_image_side_ = std::min({limits.maxImageDimension2D, limits.maxFramebufferWidth, limits.maxFramebufferHeight,
                                  limits.maxViewportDimensions[0], limits.maxViewportDimensions[1]});
  largest_buffer_ = std::min(first.maxMemoryAllocationSize, third.maxBufferSize);
  const char* const driver = second.driverName;
  name_ = std::string(basic.properties.deviceName) + ", " + driver + " " + second.driverInfo;

  VkPhysicalDeviceMemoryProperties2 memory{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2};
  api_.vkGetPhysicalDeviceMemoryProperties2(gpu, &memory);
  memory_ = memory.memoryProperties;
  total_bytes_ = 0;
  for (uint32_t heap = 0; heap < memory_.memoryHeapCount; ++heap) {
    if ((memory_.memoryHeaps[heap].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) == 0) continue;
    if (memory_.memoryHeaps[heap].size <= total_bytes_) continue;
    total_bytes_ = memory_.memoryHeaps[heap].size;
    device_heap_ = heap;
  }
  if (total_bytes_ == 0) return "no memory of its own";
  gpu_ = gpu;
  return {};
}

Result<void> VulkanDevice::make_device() {
  uint32_t count = 0;
  VkResult listed = api_.vkEnumerateDeviceExtensionProperties(gpu_, nullptr, &count, nullptr);
  std::vector<VkExtensionProperties> extensions(count);
  if (listed == VK_SUCCESS)
    listed = api_.vkEnumerateDeviceExtensionProperties(gpu_, nullptr, &count, extensions.data());
  SCREE_TRY(vulkan_check(listed, "listing extensions"));
  const char* const budget = VK_EXT_MEMORY_BUDGET_EXTENSION_NAME;
  has_budget_ = std::any_of(extensions.begin(), extensions.end(), [&](const VkExtensionProperties& extension) {
    return std::strcmp(extension.extensionName, budget) == 0;
  });
  Features features;
  features.each([](const char*, VkBool32& wanted) { wanted = VK_TRUE; });
  const float priority = 1;
  const VkDeviceQueueCreateInfo queue{.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                      .queueFamilyIndex = queue_family_,
                                      .queueCount = 1,
                                      .pQueuePriorities = &priority};
  const VkDeviceCreateInfo info{.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                .pNext = &features.first,
                                .queueCreateInfoCount = 1,
                                .pQueueCreateInfos = &queue,
                                .enabledExtensionCount = has_budget_ ? 1u : 0u,
                                .ppEnabledExtensionNames = &budget};
  SCREE_TRY(vulkan_made(api_.vkCreateDevice(gpu_, &info, nullptr, &device_), device_, "opening the GPU"));
  const char* missing = nullptr;
#define SCREE_VULKAN_FIND(name)                                                       \
  api_.name = reinterpret_cast<PFN_##name>(api_.vkGetDeviceProcAddr(device_, #name)); \
  if (api_.name == nullptr) missing = #name;
  SCREE_VULKAN_DEVICE(SCREE_VULKAN_FIND)
#undef SCREE_VULKAN_FIND
  if (missing != nullptr) {
    device_ = VK_NULL_HANDLE;  // it cannot be closed safely
    return device_error(std::string("the driver has no ") + missing);
  }
  api_.vkGetDeviceQueue(device_, queue_family_, 0, &queue_);
  const VkCommandPoolCreateInfo pool{.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                     .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                     .queueFamilyIndex = queue_family_};
  const VkFenceCreateInfo fence{.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
  SCREE_TRY(vulkan_made(api_.vkCreateCommandPool(device_, &pool, nullptr, &pool_), pool_, "making a command pool"));
  return vulkan_made(api_.vkCreateFence(device_, &fence, nullptr, &fence_), fence_, "making a fence");
}

uint64_t VulkanDevice::free_bytes() const {
  if (!has_budget_) return total_bytes_;
  VkPhysicalDeviceMemoryBudgetPropertiesEXT budget{.sType =
                                                       VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT};
  VkPhysicalDeviceMemoryProperties2 memory{.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2,
                                           .pNext = &budget};
  api_.vkGetPhysicalDeviceMemoryProperties2(gpu_, &memory);
  const uint64_t used = budget.heapUsage[device_heap_];
  return budget.heapBudget[device_heap_] > used ? budget.heapBudget[device_heap_] - used : 0;
}

Result<void> VulkanDevice::allocate(const VkMemoryRequirements& needs, VulkanMemory memory, bool has_address,
                                    VkDeviceMemory& allocated) const {
  constexpr VkMemoryPropertyFlags kDevice = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
  constexpr VkMemoryPropertyFlags kHost = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  const VkMemoryPropertyFlags needed = memory == VulkanMemory::kDevice ? kDevice : kHost;
  // A processor reads uncached memory very slowly.
  constexpr VkMemoryPropertyFlags kCached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
  const VkMemoryPropertyFlags wishes[2] = {memory == VulkanMemory::kHostReads ? needed | kCached : needed, needed};
  for (const VkMemoryPropertyFlags wish : wishes) {
    for (uint32_t type = 0; type < memory_.memoryTypeCount; ++type) {
      const VkMemoryType& candidate = memory_.memoryTypes[type];
      if ((needs.memoryTypeBits >> type & 1) == 0 || (candidate.propertyFlags & wish) != wish) continue;
      if (memory == VulkanMemory::kDevice && candidate.heapIndex != device_heap_) continue;
      const VkMemoryAllocateFlagsInfo flags{.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                            .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
      const VkMemoryAllocateInfo info{.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                      .pNext = has_address ? &flags : nullptr,
                                      .allocationSize = needs.size,
                                      .memoryTypeIndex = type};
      return vulkan_made(api_.vkAllocateMemory(device_, &info, nullptr, &allocated), allocated, "allocating memory");
    }
  }
  return device_error("no kind of memory fits");
}

Result<VulkanBuffer> VulkanDevice::make_buffer(uint64_t bytes, VkBufferUsageFlags usage, VulkanMemory memory) const {
  VulkanBuffer buffer{.bytes = bytes};
  const bool has_address = (usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT) != 0;
  const VkBufferCreateInfo info{.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                .size = bytes,
                                .usage = usage,
                                .sharingMode = VK_SHARING_MODE_EXCLUSIVE};
  SCREE_TRY(
      vulkan_made(api_.vkCreateBuffer(device_, &info, nullptr, &buffer.handle), buffer.handle, "making a buffer"));
  VkMemoryRequirements needs{};
  api_.vkGetBufferMemoryRequirements(device_, buffer.handle, &needs);
  Result<void> done = allocate(needs, memory, has_address, buffer.memory);
  if (done) done = vulkan_check(api_.vkBindBufferMemory(device_, buffer.handle, buffer.memory, 0), "binding a buffer");
  if (done && memory != VulkanMemory::kDevice) {
    void* mapped = nullptr;
    done = vulkan_check(api_.vkMapMemory(device_, buffer.memory, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping a buffer");
    buffer.mapped = static_cast<std::byte*>(mapped);
  }
  if (!done) {
    destroy(buffer);
    return done.error();
  }
  if (has_address) {
    const VkBufferDeviceAddressInfo of{.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO, .buffer = buffer.handle};
    buffer.address = api_.vkGetBufferDeviceAddress(device_, &of);
  }
  return buffer;
}

Result<VulkanImage> VulkanDevice::make_image(uint32_t width, uint32_t height, VkFormat format, VkImageUsageFlags usage,
                                             VkImageAspectFlags aspect) const {
  VulkanImage image;
  const VkImageCreateInfo info{.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                               .imageType = VK_IMAGE_TYPE_2D,
                               .format = format,
                               .extent = {width, height, 1},
                               .mipLevels = 1,
                               .arrayLayers = 1,
                               .samples = VK_SAMPLE_COUNT_1_BIT,
                               .tiling = VK_IMAGE_TILING_OPTIMAL,
                               .usage = usage,
                               .sharingMode = VK_SHARING_MODE_EXCLUSIVE,
                               .initialLayout = VK_IMAGE_LAYOUT_UNDEFINED};
  SCREE_TRY(vulkan_made(api_.vkCreateImage(device_, &info, nullptr, &image.handle), image.handle, "making a picture"));
  VkMemoryRequirements needs{};
  api_.vkGetImageMemoryRequirements(device_, image.handle, &needs);
  image.bytes = needs.size;
  Result<void> done = allocate(needs, VulkanMemory::kDevice, false, image.memory);
  if (done) done = vulkan_check(api_.vkBindImageMemory(device_, image.handle, image.memory, 0), "binding a picture");
  const VkImageViewCreateInfo view{.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                   .image = image.handle,
                                   .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                   .format = format,
                                   .subresourceRange = {aspect, 0, 1, 0, 1}};
  if (done)
    done = vulkan_made(api_.vkCreateImageView(device_, &view, nullptr, &image.view), image.view,
                       "making a picture's view");
  if (!done) {
    destroy(image);
    return done.error();
  }
  return image;
}

void VulkanDevice::destroy(VulkanBuffer& buffer) const {
  api_.vkDestroyBuffer(device_, buffer.handle, nullptr);
  api_.vkFreeMemory(device_, buffer.memory, nullptr);
  buffer = {};
}

void VulkanDevice::destroy(VulkanImage& image) const {
  api_.vkDestroyImageView(device_, image.view, nullptr);
  api_.vkDestroyImage(device_, image.handle, nullptr);
  api_.vkFreeMemory(device_, image.memory, nullptr);
  image = {};
}

Result<VkCommandBuffer> VulkanDevice::make_commands() const {
  VkCommandBuffer commands = VK_NULL_HANDLE;
  const VkCommandBufferAllocateInfo info{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                         .commandPool = pool_,
                                         .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                         .commandBufferCount = 1};
  SCREE_TRY(vulkan_check(api_.vkAllocateCommandBuffers(device_, &info, &commands), "making a command buffer"));
  return commands;
}

Result<void> VulkanDevice::run(VkCommandBuffer commands) const {
  const VkCommandBufferSubmitInfo buffer{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO,
                                         .commandBuffer = commands};
  const VkSubmitInfo2 submit{
      .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2, .commandBufferInfoCount = 1, .pCommandBufferInfos = &buffer};
  SCREE_TRY(vulkan_check(api_.vkResetFences(device_, 1, &fence_), "resetting a fence"));
  SCREE_TRY(vulkan_check(api_.vkQueueSubmit2(queue_, 1, &submit, fence_), "submitting commands"));
  return vulkan_check(api_.vkWaitForFences(device_, 1, &fence_, VK_TRUE, UINT64_MAX), "waiting for the GPU");
}

}  // namespace scree::lab
