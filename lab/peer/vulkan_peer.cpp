#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstring>
#include <iterator>
#include <mutex>
#include <numeric>
#include <utility>

#include "indexed_vertex_shader.h"
#include "kernels/cull/cull.h"
#include "lab/peer/peer.h"
#include "lab/peer/vulkan_device.h"
#include "lab/peer/vulkan_pipeline.h"
#include "lab/scenes/visible_cost.h"
#include "pulled_vertex_shader.h"
#include "runtime/threads/stopwatch.h"
#include "runtime/threads/workers.h"
#include "tools/common/options/options.h"

namespace scree::lab {
namespace {

constexpr uint64_t kBlockBytes = uint64_t{1} << 30;  // meshes share buffers of up to this size
constexpr uint64_t kStagingBytes = uint64_t{64} << 20;
constexpr uint64_t kSliceItems = 4096;  // made by one thread at a time
constexpr uint32_t kNoRow = ~uint32_t{0};

/// As in peer.vert.
struct InstanceRow {
  float x[4], y[4], w[4], center[4];
};

/// As in peer.vert: addresses.
struct DrawConstants {
  VkDeviceAddress instances;
  VkDeviceAddress positions;
  VkDeviceAddress indices;
};

/// Where a mesh lies: offsets in one of the blocks.
struct MeshPlace {
  uint32_t block = 0;
  uint64_t positions = 0;
  uint64_t indices = 0;
  ChunkBox box{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
};

/// Instances of one mesh that one call draws: consecutive rows of the table of instances.
struct Run {
  uint32_t mesh;
  uint32_t first_row;
  uint32_t row_count;
  bool mirrored;
};

InstanceRow make_row(const kernels::Transform& transform, const kernels::FrameView& frame) {
  InstanceRow row{};
  for (int i = 0; i < 4; ++i) {
    row.x[i] = static_cast<float>(transform.exact_x[i] / static_cast<double>(frame.half_width));
    row.y[i] = static_cast<float>(transform.exact_y[i] / static_cast<double>(frame.half_height));
    row.w[i] = transform.w[i];
  }
  std::copy(std::begin(transform.center), std::end(transform.center), row.center);
  return row;
}

/// Whether the instance's matrix, a rotation and a scaling, mirrors.
bool mirrors(const synth::SceneInstance& instance) {
  return instance.scale[0] * instance.scale[1] * instance.scale[2] < 0;
}

class VulkanPeer final : public Peer {
 public:
  explicit VulkanPeer(std::unique_ptr<VulkanDevice> gpu) : gpu_(std::move(gpu)), vk_(gpu_->api()) {}
  ~VulkanPeer() override {
    VulkanPeer::unload();
    gpu_->destroy(staging_);
    for (VkPipeline pipeline : pipelines_) vk_.vkDestroyPipeline(gpu_->handle(), pipeline, nullptr);
    vk_.vkDestroyPipelineLayout(gpu_->handle(), layout_, nullptr);
    vk_.vkDestroyQueryPool(gpu_->handle(), queries_, nullptr);
  }

  /// Makes everything that does not depend on the scene.
  Result<void> prepare();

  std::string device() const override { return gpu_->name(); }
  Result<void> load(const synth::Scene& scene, uint32_t threads) override;
  void unload() override;
  uint64_t geometry_bytes() const override { return geometry_bytes_; }
  uint64_t device_bytes() const override;
  Result<kernels::FrameStats> look(const kernels::View& view) override;
  Result<Ms> draw(PeerDrawing drawing) override;
  Result<std::vector<uint64_t>> ids() override;

 private:
  Result<void> make_pictures(uint32_t width, uint32_t height);
  void drop_pictures();
  /// Chooses the places of meshes. Returns the size of each block.
  std::vector<uint64_t> plan(const synth::Scene& scene);
  Result<void> fill_mesh(const synth::MeshRecipe& mesh, MeshPlace& place, runtime::Workers& workers);
  /// Fills `count` items of `item_bytes` in a buffer: make(first, count, to) makes some of them, on several threads.
  template <class Make>
  Result<void> upload(const VulkanBuffer& buffer, uint64_t offset, uint64_t count, uint64_t item_bytes,
                      runtime::Workers& workers, const Make& make);
  std::vector<InstanceRow> cull(const kernels::View& view, kernels::FrameStats& stats);
  Result<void> record(PeerDrawing drawing, VkCommandBuffer commands);
  void record_draws(PeerDrawing drawing, VkCommandBuffer commands);
  Result<void> record_reading();

  std::unique_ptr<VulkanDevice> gpu_;
  const VulkanApi& vk_;
  VkQueryPool queries_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  std::array<VkPipeline, 2> pipelines_{};      // by PeerDrawing
  std::array<VkCommandBuffer, 2> drawings_{};  // likewise, recorded by look()
  VkCommandBuffer copying_ = VK_NULL_HANDLE;   // of staged bytes
  VkCommandBuffer reading_ = VK_NULL_HANDLE;   // of the picture, recorded by look()
  VulkanBuffer staging_;

  const synth::Scene* scene_ = nullptr;
  std::vector<MeshPlace> places_;
  std::vector<VulkanBuffer> blocks_;
  VulkanBuffer instances_;               // InstanceRow
  std::vector<uint32_t> order_;          // instances by mesh, then unmirrored before mirrored
  std::vector<uint64_t> instance_base_;  // the id of each instance's first triangle
  uint64_t geometry_bytes_ = 0;

  VulkanImage ids_;
  VulkanImage depth_;
  VulkanBuffer read_;  // the ids on the host
  uint32_t width_ = 0;
  uint32_t height_ = 0;
  std::vector<Run> runs_;
  std::vector<uint32_t> row_instances_;  // the scene's instance of each row
};

Result<void> VulkanPeer::prepare() {
  const VkQueryPoolCreateInfo queries{
      .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = 2};
  Result<void> done =
      vulkan_made(vk_.vkCreateQueryPool(gpu_->handle(), &queries, nullptr, &queries_), queries_, "making timestamps");
  const VkPushConstantRange constants{VK_SHADER_STAGE_VERTEX_BIT, 0, sizeof(DrawConstants)};
  const VkPipelineLayoutCreateInfo layout{.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                          .pushConstantRangeCount = 1,
                                          .pPushConstantRanges = &constants};
  if (done)
    done = vulkan_made(vk_.vkCreatePipelineLayout(gpu_->handle(), &layout, nullptr, &layout_), layout_,
                       "making a pipeline layout");
  if (done) done = make_peer_pipeline(*gpu_, layout_, indexed_vertex_shader, true, pipelines_[0]);
  if (done) done = make_peer_pipeline(*gpu_, layout_, pulled_vertex_shader, false, pipelines_[1]);
  for (VkCommandBuffer* commands : {&drawings_[0], &drawings_[1], &copying_, &reading_}) {
    if (!done) return done;
    *commands = SCREE_TRY(gpu_->make_commands());
  }
  staging_ = SCREE_TRY(gpu_->make_buffer(kStagingBytes, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, VulkanMemory::kHostWrites));
  return {};
}

uint64_t VulkanPeer::device_bytes() const {
  uint64_t bytes = instances_.bytes + ids_.bytes + depth_.bytes;
  for (const VulkanBuffer& block : blocks_) bytes += block.bytes;
  return bytes;
}

void VulkanPeer::unload() {
  drop_pictures();
  for (VulkanBuffer& block : blocks_) gpu_->destroy(block);
  blocks_.clear();
  gpu_->destroy(instances_);
  geometry_bytes_ = 0;
}

void VulkanPeer::drop_pictures() {
  gpu_->destroy(ids_);
  gpu_->destroy(depth_);
  gpu_->destroy(read_);
  width_ = height_ = 0;
}

std::vector<uint64_t> VulkanPeer::plan(const synth::Scene& scene) {
  places_.assign(scene.meshes.size(), {});
  std::vector<uint64_t> blocks;
  for (size_t m = 0; m < places_.size(); ++m) {
    const uint64_t positions = synth::vertex_count(scene.meshes[m]) * 3 * sizeof(float);
    const uint64_t bytes = positions + synth::triangle_count(scene.meshes[m]) * 3 * sizeof(uint32_t);
    if (blocks.empty() || blocks.back() + bytes > kBlockBytes) blocks.push_back(0);
    places_[m].block = static_cast<uint32_t>(blocks.size() - 1);
    places_[m].positions = blocks.back();
    places_[m].indices = blocks.back() + positions;
    blocks.back() += bytes;
    geometry_bytes_ += bytes;
  }
  return blocks;
}

Result<void> VulkanPeer::load(const synth::Scene& scene, uint32_t threads) {
  unload();
  scene_ = &scene;
  instance_base_.assign(1, 0);
  for (const synth::SceneInstance& instance : scene.instances)
    instance_base_.push_back(instance_base_.back() + synth::triangle_count(scene.meshes[instance.mesh]));
  order_.resize(scene.instances.size());
  std::iota(order_.begin(), order_.end(), 0u);
  std::stable_sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) {
    const synth::SceneInstance& one = scene.instances[a];
    const synth::SceneInstance& other = scene.instances[b];
    return one.mesh != other.mesh ? one.mesh < other.mesh : mirrors(one) < mirrors(other);
  });

  const std::vector<uint64_t> sizes = plan(scene);
  const uint64_t instance_bytes = std::max<uint64_t>(order_.size(), 1) * sizeof(InstanceRow);
  const uint64_t needed = geometry_bytes_ + instance_bytes;
  const std::string takes = "the scene takes " + tools::format_bytes(needed) + " of device memory with 32-bit indices";
  const uint64_t free = gpu_->free_bytes();
  if (needed > free)
    return Error{ErrorCode::kMemory, takes + ", but " + tools::format_bytes(free) + " of " +
                                         tools::format_bytes(gpu_->total_bytes()) + " are free"};
  if (const uint64_t largest = *std::max_element(sizes.begin(), sizes.end()); largest > gpu_->largest_buffer())
    return Error{ErrorCode::kMemory, takes + ", " + tools::format_bytes(largest) +
                                         " of it for one mesh, but a buffer holds " +
                                         tools::format_bytes(gpu_->largest_buffer())};
  constexpr VkBufferUsageFlags kRead = VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
  const auto make = [&](uint64_t bytes, VkBufferUsageFlags usage, VulkanBuffer& to) -> Result<void> {
    const Result<VulkanBuffer> made = gpu_->make_buffer(bytes, usage | kRead, VulkanMemory::kDevice);
    if (!made) return Error{made.error().code, takes + ": " + made.error().message};
    to = *made;
    return {};
  };
  Result<void> done = make(instance_bytes, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, instances_);
  blocks_.resize(sizes.size());
  for (size_t i = 0; i < sizes.size() && done; ++i)
    done =
        make(sizes[i],
             VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
             blocks_[i]);
  runtime::Workers workers(threads);
  for (size_t m = 0; m < places_.size() && done; ++m) done = fill_mesh(scene.meshes[m], places_[m], workers);
  if (!done) unload();
  return done;
}

template <class Make>
Result<void> VulkanPeer::upload(const VulkanBuffer& buffer, uint64_t offset, uint64_t count, uint64_t item_bytes,
                                runtime::Workers& workers, const Make& make) {
  const uint64_t most = kStagingBytes / item_bytes;
  for (uint64_t first = 0; first < count; first += most) {
    const uint64_t items = std::min(most, count - first);
    workers.for_each((items + kSliceItems - 1) / kSliceItems, [&](uint64_t slice) {
      const uint64_t begin = slice * kSliceItems;
      make(first + begin, std::min(kSliceItems, items - begin), staging_.mapped + begin * item_bytes);
    });
    const VkCommandBufferBeginInfo once{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                        .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    SCREE_TRY(vulkan_check(vk_.vkBeginCommandBuffer(copying_, &once), "recording a copy"));
    const VkBufferCopy copy{0, offset + first * item_bytes, items * item_bytes};
    vk_.vkCmdCopyBuffer(copying_, staging_.handle, buffer.handle, 1, &copy);
    SCREE_TRY(vulkan_check(vk_.vkEndCommandBuffer(copying_), "recording a copy"));
    SCREE_TRY(gpu_->run(copying_));
  }
  return {};
}

Result<void> VulkanPeer::fill_mesh(const synth::MeshRecipe& mesh, MeshPlace& place, runtime::Workers& workers) {
  std::mutex mutex;
  const auto positions = [&](uint64_t first, uint64_t count, std::byte* to) {
    ChunkBox box = MeshPlace{}.box;
    for (uint64_t i = 0; i < count; ++i) {
      const synth::Float3 p = synth::vertex_position(mesh, static_cast<uint32_t>(first + i));
      const float parts[3] = {p.x, p.y, p.z};
      std::memcpy(to + i * sizeof parts, parts, sizeof parts);
      for (int axis = 0; axis < 3; ++axis) {
        box.lo[axis] = std::min(box.lo[axis], parts[axis]);
        box.hi[axis] = std::max(box.hi[axis], parts[axis]);
      }
    }
    const std::lock_guard<std::mutex> lock(mutex);
    for (int axis = 0; axis < 3; ++axis) {
      place.box.lo[axis] = std::min(place.box.lo[axis], box.lo[axis]);
      place.box.hi[axis] = std::max(place.box.hi[axis], box.hi[axis]);
    }
  };
  const auto quads = [&](uint64_t first, uint64_t count, std::byte* to) {
    for (uint64_t i = 0; i < count; ++i) {
      uint32_t indices[6];
      synth::quad_indices(mesh, static_cast<uint32_t>(first + i), indices);
      std::memcpy(to + i * sizeof indices, indices, sizeof indices);
    }
  };
  const VulkanBuffer& block = blocks_[place.block];
  SCREE_TRY(upload(block, place.positions, synth::vertex_count(mesh), 3 * sizeof(float), workers, positions));
  return upload(block, place.indices, synth::triangle_count(mesh) / 2, 6 * sizeof(uint32_t), workers, quads);
}

Result<void> VulkanPeer::make_pictures(uint32_t width, uint32_t height) {
  if (width == width_ && height == height_) return {};
  drop_pictures();
  if (std::max(width, height) > gpu_->largest_image_side())
    return Error{ErrorCode::kRange, "Vulkan: a picture of this GPU has at most " +
                                        std::to_string(gpu_->largest_image_side()) + " samples per side"};
  ids_ = SCREE_TRY(gpu_->make_image(width, height, VulkanDevice::kIds,
                                    VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT,
                                    VK_IMAGE_ASPECT_COLOR_BIT));
  depth_ = SCREE_TRY(gpu_->make_image(width, height, VulkanDevice::kDepth, VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
                                      VK_IMAGE_ASPECT_DEPTH_BIT));
  read_ = SCREE_TRY(gpu_->make_buffer(uint64_t{width} * height * 2 * sizeof(uint32_t), VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                      VulkanMemory::kHostReads));
  width_ = width;
  height_ = height;
  return {};
}

std::vector<InstanceRow> VulkanPeer::cull(const kernels::View& view, kernels::FrameStats& stats) {
  const kernels::FrameView frame = kernels::make_frame_view(view);
  std::vector<InstanceRow> rows;
  runs_.clear();
  row_instances_.clear();
  for (const uint32_t number : order_) {
    const uint32_t mesh = scene_->instances[number].mesh;
    const kernels::Transform transform =
        kernels::make_transform(frame, matrix_record(scene_->instances[number]), 0, true);
    if (!kernels::may_be_seen(transform, frame, float_box(places_[mesh].box, transform))) continue;
    if (runs_.empty() || runs_.back().mesh != mesh || runs_.back().mirrored != transform.mirrored)
      runs_.push_back({mesh, static_cast<uint32_t>(rows.size()), 0, transform.mirrored});
    ++runs_.back().row_count;
    rows.push_back(make_row(transform, frame));
    row_instances_.push_back(number);
    stats.triangles += synth::triangle_count(scene_->meshes[mesh]);
  }
  stats.instances_drawn = rows.size();
  stats.draws = runs_.size();
  return rows;
}

Result<kernels::FrameStats> VulkanPeer::look(const kernels::View& view) {
  assert(scene_ != nullptr && !view.orthographic && !view.clips);
  if (Result<void> done = make_pictures(view.width, view.height); !done) {
    drop_pictures();
    return done.error();
  }
  kernels::FrameStats stats{};
  const std::vector<InstanceRow> rows = cull(view, stats);
  runtime::Workers one(1);
  SCREE_TRY(
      upload(instances_, 0, rows.size(), sizeof(InstanceRow), one, [&](uint64_t first, uint64_t count, std::byte* to) {
        std::memcpy(to, rows.data() + first, count * sizeof(InstanceRow));
      }));
  for (const PeerDrawing drawing : {PeerDrawing::kIndexed, PeerDrawing::kPulled})
    SCREE_TRY(record(drawing, drawings_[static_cast<size_t>(drawing)]));
  SCREE_TRY(record_reading());
  return stats;
}

Result<void> VulkanPeer::record(PeerDrawing drawing, VkCommandBuffer commands) {
  const VkCommandBufferBeginInfo begin{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  SCREE_TRY(vulkan_check(vk_.vkBeginCommandBuffer(commands, &begin), "recording a frame"));
  vk_.vkCmdResetQueryPool(commands, queries_, 0, 2);
  vk_.vkCmdWriteTimestamp2(commands, VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, queries_, 0);
  constexpr VkPipelineStageFlags2 kDepthStages =
      VK_PIPELINE_STAGE_2_EARLY_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_2_LATE_FRAGMENT_TESTS_BIT;
  const VkMemoryBarrier2 copied{.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,  // the scene, and the previous picture
                                .srcStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
                                .srcAccessMask = VK_ACCESS_2_MEMORY_WRITE_BIT,
                                .dstStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
                                .dstAccessMask = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT};
  const VkImageMemoryBarrier2 discard[2] = {
      {.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2,
       .srcStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
       .dstStageMask = VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT,
       .dstAccessMask = VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT,
       .newLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
       .image = ids_.handle,
       .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}},
      {.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2,
       .srcStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
       .dstStageMask = kDepthStages,
       .dstAccessMask = VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_READ_BIT | VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
       .newLayout = VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL,
       .image = depth_.handle,
       .subresourceRange = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, 1}}};
  const VkDependencyInfo before{.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO,
                                .memoryBarrierCount = 1,
                                .pMemoryBarriers = &copied,
                                .imageMemoryBarrierCount = 2,
                                .pImageMemoryBarriers = discard};
  vk_.vkCmdPipelineBarrier2(commands, &before);
  VkClearValue no_triangle{};
  no_triangle.color.uint32[0] = no_triangle.color.uint32[1] = kNoRow;
  const VkRenderingAttachmentInfo ids{.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                      .imageView = ids_.view,
                                      .imageLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                                      .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                      .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                      .clearValue = no_triangle};
  const VkRenderingAttachmentInfo depth{.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                        .imageView = depth_.view,
                                        .imageLayout = VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL,
                                        .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                        .storeOp = VK_ATTACHMENT_STORE_OP_STORE};  // clears to 0, infinitely far
  const VkRect2D whole{{0, 0}, {width_, height_}};
  const VkRenderingInfo rendering{.sType = VK_STRUCTURE_TYPE_RENDERING_INFO,
                                  .renderArea = whole,
                                  .layerCount = 1,
                                  .colorAttachmentCount = 1,
                                  .pColorAttachments = &ids,
                                  .pDepthAttachment = &depth};
  vk_.vkCmdBeginRendering(commands, &rendering);
  vk_.vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipelines_[static_cast<size_t>(drawing)]);
  const VkViewport viewport{0, 0, static_cast<float>(width_), static_cast<float>(height_), 0, 1};
  vk_.vkCmdSetViewport(commands, 0, 1, &viewport);
  vk_.vkCmdSetScissor(commands, 0, 1, &whole);
  record_draws(drawing, commands);
  vk_.vkCmdEndRendering(commands);
  vk_.vkCmdWriteTimestamp2(commands, VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, queries_, 1);
  return vulkan_check(vk_.vkEndCommandBuffer(commands), "recording a frame");
}

void VulkanPeer::record_draws(PeerDrawing drawing, VkCommandBuffer commands) {
  for (const Run& run : runs_) {
    const MeshPlace& place = places_[run.mesh];
    const VulkanBuffer& block = blocks_[place.block];
    const auto corners = static_cast<uint32_t>(3 * synth::triangle_count(scene_->meshes[run.mesh]));
    const DrawConstants constants{instances_.address, block.address + place.positions, block.address + place.indices};
    vk_.vkCmdSetFrontFace(commands, run.mirrored ? VK_FRONT_FACE_CLOCKWISE : VK_FRONT_FACE_COUNTER_CLOCKWISE);
    vk_.vkCmdPushConstants(commands, layout_, VK_SHADER_STAGE_VERTEX_BIT, 0, sizeof constants, &constants);
    if (drawing == PeerDrawing::kPulled) {
      vk_.vkCmdDraw(commands, corners, run.row_count, 0, run.first_row);
      continue;
    }
    vk_.vkCmdBindVertexBuffers(commands, 0, 1, &block.handle, &place.positions);
    vk_.vkCmdBindIndexBuffer(commands, block.handle, place.indices, VK_INDEX_TYPE_UINT32);
    vk_.vkCmdDrawIndexed(commands, corners, run.row_count, 0, 0, run.first_row);
  }
}

Result<void> VulkanPeer::record_reading() {
  const VkCommandBufferBeginInfo begin{.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  SCREE_TRY(vulkan_check(vk_.vkBeginCommandBuffer(reading_, &begin), "recording a copy"));
  // A frame may be read twice, so the picture returns to the layout that it had after drawing.
  const auto turn = [&](VkImageLayout from, VkImageLayout to) {
    const VkImageMemoryBarrier2 barrier{.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2,
                                        .srcStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
                                        .srcAccessMask = VK_ACCESS_2_MEMORY_WRITE_BIT,
                                        .dstStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
                                        .dstAccessMask = VK_ACCESS_2_MEMORY_READ_BIT,
                                        .oldLayout = from,
                                        .newLayout = to,
                                        .image = ids_.handle,
                                        .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
    const VkDependencyInfo info{
        .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .imageMemoryBarrierCount = 1, .pImageMemoryBarriers = &barrier};
    vk_.vkCmdPipelineBarrier2(reading_, &info);
  };
  turn(VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL);
  const VkBufferImageCopy copy{.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1},
                               .imageExtent = {width_, height_, 1}};
  vk_.vkCmdCopyImageToBuffer(reading_, ids_.handle, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, read_.handle, 1, &copy);
  turn(VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL);
  const VkMemoryBarrier2 to_host{.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER_2,
                                 .srcStageMask = VK_PIPELINE_STAGE_2_COPY_BIT,
                                 .srcAccessMask = VK_ACCESS_2_TRANSFER_WRITE_BIT,
                                 .dstStageMask = VK_PIPELINE_STAGE_2_HOST_BIT,
                                 .dstAccessMask = VK_ACCESS_2_HOST_READ_BIT};
  const VkDependencyInfo after{
      .sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO, .memoryBarrierCount = 1, .pMemoryBarriers = &to_host};
  vk_.vkCmdPipelineBarrier2(reading_, &after);
  return vulkan_check(vk_.vkEndCommandBuffer(reading_), "recording a copy");
}

Result<Peer::Ms> VulkanPeer::draw(PeerDrawing drawing) {
  const runtime::Stopwatch watch;
  SCREE_TRY(gpu_->run(drawings_[static_cast<size_t>(drawing)]));
  Ms ms{.wall = static_cast<float>(watch.elapsed().wall_ms)};
  uint64_t stamps[2] = {};
  SCREE_TRY(vulkan_check(vk_.vkGetQueryPoolResults(gpu_->handle(), queries_, 0, 2, sizeof stamps, stamps,
                                                   sizeof stamps[0], VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT),
                         "reading timestamps"));
  ms.gpu = static_cast<float>(static_cast<double>((stamps[1] - stamps[0]) & gpu_->timestamp_mask()) *
                              gpu_->timestamp_ns() * 1e-6);
  return ms;
}

Result<std::vector<uint64_t>> VulkanPeer::ids() {
  SCREE_TRY(gpu_->run(reading_));
  std::vector<uint64_t> ids(uint64_t{width_} * height_);
  for (size_t i = 0; i < ids.size(); ++i) {
    uint32_t words[2];
    std::memcpy(words, read_.mapped + i * sizeof words, sizeof words);
    if (words[0] == kNoRow) {
      ids[i] = kernels::kIdMask;
    } else if (words[0] >= row_instances_.size()) {
      return Error{ErrorCode::kDevice, "Vulkan: the picture has an instance that was not drawn"};
    } else {
      ids[i] = instance_base_[row_instances_[words[0]]] + words[1];
    }
  }
  return ids;
}

}  // namespace

Result<std::unique_ptr<Peer>> open_vulkan_peer(const std::string& uuid) {
  std::unique_ptr<VulkanDevice> gpu = SCREE_TRY(VulkanDevice::open(uuid));
  auto peer = std::make_unique<VulkanPeer>(std::move(gpu));
  SCREE_TRY(peer->prepare());
  return std::unique_ptr<Peer>(std::move(peer));
}

}  // namespace scree::lab
