// A scene of scene_builder.h in GPU memory, for tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

#include "format/container/mip_levels.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/frame/frame.h"
#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// Bits for View::omitted on the device.
class DeviceBits {
 public:
  explicit DeviceBits(const std::vector<uint32_t>& bits) {
    REQUIRE(buffer_.reserve(bits.size() * sizeof(uint32_t), "allocating bits"));
    REQUIRE(kernels::cuda_check(
        cudaMemcpy(buffer_.data(), bits.data(), bits.size() * sizeof(uint32_t), cudaMemcpyHostToDevice),
        "copying bits"));
  }
  const uint32_t* data() const { return reinterpret_cast<const uint32_t*>(buffer_.data()); }

 private:
  kernels::DeviceBuffer buffer_;
};

class DeviceCopy {
 public:
  /// `host`: a builder's view(), whose pages are `pages`. Both must outlive this.
  DeviceCopy(const kernels::SceneView& host, const std::deque<std::vector<std::byte>>& pages)
      : host_(host), view_(host) {
    copy(view_.meshes, host_.mesh_count);
    copy(view_.chunks, host_.chunk_count);
    copy(view_.instances, host_.instance_count);
    copy(view_.instance_base, host_.instance_count + 1);
    copy(view_.matrices, host_.matrix_count);
    copy(view_.materials, host_.material_count);
    copy(view_.textures, host_.texture_count);
    const auto copy_masks = [&](const kernels::MaskView*& masks) {
      if (masks == nullptr) return;
      std::vector<kernels::MaskView>& copied = masks_.emplace_back(masks, masks + host_.material_count);
      for (kernels::MaskView& mask : copied)
        if (mask.alpha != nullptr) copy(mask.alpha, format::mask_bytes(mask.width, mask.height, mask.level_count));
      masks = copied.data();
      copy(masks, copied.size());
    };
    copy_masks(view_.masks);
    copy_masks(view_.blend_masks);
    std::vector<const std::byte*> table;
    for (const std::vector<std::byte>& page : pages) {
      const std::byte* bytes = page.data();
      copy(bytes, page.size());
      table.push_back(bytes);
    }
    view_.pages = table.data();
    copy(view_.pages, table.size());
    pages_ = std::move(table);
  }

  /// The scene for kernels: all pointers are device pointers.
  const kernels::SceneView& view() const { return view_; }

  /// The GPU's samples of the scene, with queues of the initial sizes `sizes`.
  std::vector<uint64_t> draw(const kernels::View& view, const kernels::CudaQueueSizes& sizes = {},
                             const kernels::DrawOptions& options = {}) const {
    return draw_in_turn({view}, sizes, options).front();
  }

  /// As above, for consecutive frames, each of which may use hints of the previous one.
  std::vector<std::vector<uint64_t>> draw_in_turn(const std::vector<kernels::View>& views,
                                                  const kernels::CudaQueueSizes& sizes = {},
                                                  const kernels::DrawOptions& options = {}) const {
    kernels::CudaFrames frames = make_frames(sizes);
    std::vector<std::vector<uint64_t>> pictures;
    for (const kernels::View& view : views)
      pictures.push_back(picture(view, [&](uint64_t* samples) { REQUIRE(frames.draw(view, samples, options)); }));
    return pictures;
  }

  /// Statistics of the first frame.
  kernels::FrameStats stats(const kernels::View& view, const kernels::CudaQueueSizes& sizes,
                            const kernels::DrawOptions& options) const {
    kernels::CudaFrames frames = make_frames(sizes);
    kernels::FrameStats stats{};
    picture(view, [&](uint64_t* samples) { stats = must(frames.draw(view, samples, options)); });
    return stats;
  }

  /// A part of a frame: the pages for which `has_page` returns true.
  struct Part {
    kernels::FramePart part;
    std::function<bool(size_t page)> has_page;
  };

  /// As draw_in_turn(), with each frame drawn in `parts`.
  std::vector<std::vector<uint64_t>> draw_in_parts(const std::vector<kernels::View>& views,
                                                   const std::vector<Part>& parts,
                                                   const kernels::CudaQueueSizes& sizes) const {
    kernels::CudaFrames frames = make_frames(sizes);
    std::vector<std::vector<uint64_t>> pictures;
    for (const kernels::View& view : views) {
      pictures.push_back(picture(view, [&](uint64_t* samples) {
        for (const Part& part : parts) {
          show_pages(part.has_page);
          REQUIRE(frames.draw(view, samples, {.part = part.part}));
        }
      }));
    }
    show_pages([](size_t) { return true; });
    return pictures;
  }

  /// The samples that `draw` writes on the device. Their bytes are `begin` before it; 0xff is the background.
  template <class Draw>
  std::vector<uint64_t> picture(const kernels::View& view, const Draw& draw, int begin = 0xff) const {
    std::vector<uint64_t> samples(size_t{view.width} * view.height);
    kernels::DeviceBuffer buffer =
        must(kernels::DeviceBuffer::allocate(samples.size() * sizeof(uint64_t), "allocating the picture"));
    REQUIRE(kernels::cuda_check(cudaMemset(buffer.data(), begin, buffer.bytes()), "clearing the picture"));
    draw(reinterpret_cast<uint64_t*>(buffer.data()));
    REQUIRE(kernels::cuda_check(cudaMemcpy(samples.data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost),
                                "reading the picture"));
    return samples;
  }

 private:
  kernels::CudaFrames make_frames(const kernels::CudaQueueSizes& sizes) const {
    return must(kernels::CudaFrames::create(host_, view_, sizes));
  }

  void show_pages(const std::function<bool(size_t page)>& has_page) const {
    std::vector<const std::byte*> table = pages_;
    for (size_t i = 0; i < table.size(); ++i)
      if (!has_page(i)) table[i] = nullptr;
    REQUIRE(kernels::cuda_check(cudaMemcpy(const_cast<const std::byte**>(view_.pages), table.data(),
                                           table.size() * sizeof(table[0]), cudaMemcpyHostToDevice),
                                "writing the page table"));
  }

  /// Replaces a pointer to host memory by one to a device copy.
  template <class T>
  void copy(const T*& pointer, uint64_t count) {
    if (count == 0) return;
    kernels::DeviceBuffer buffer = must(kernels::DeviceBuffer::allocate(count * sizeof(T), "allocating the scene"));
    REQUIRE(kernels::cuda_check(cudaMemcpy(buffer.data(), pointer, count * sizeof(T), cudaMemcpyHostToDevice),
                                "copying the scene"));
    pointer = reinterpret_cast<const T*>(buffer.data());
    buffers_.push_back(std::move(buffer));
  }

  kernels::SceneView host_, view_;
  std::vector<const std::byte*> pages_;  // on the device
  std::deque<std::vector<kernels::MaskView>> masks_;
  std::vector<kernels::DeviceBuffer> buffers_;
};

/// Two passes even for a small scene, the second pass in rounds.
inline kernels::CudaQueueSizes in_two_passes() {
  return {.two_pass_groups = 1, .round_groups = 1};
}

/// One pass, with one warp per cluster as in larger scenes.
inline kernels::CudaQueueSizes by_warps() {
  return {.few_groups = 0};
}

/// Queues that have to grow.
inline constexpr kernels::CudaQueueSizes kNoRoom{1, 1, 1, 1, 1, 1, 1, 1};

/// Checks that consecutive frames of `views` equal `expected`, for all queues and options that change no picture.
inline void check_drawn_alike(const DeviceCopy& device, const std::vector<kernels::View>& views,
                              const std::vector<std::vector<uint64_t>>& expected) {
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), by_warps(), in_two_passes(), kNoRoom})
    CHECK((device.draw_in_turn(views, sizes) == expected));
  CHECK((device.draw_in_turn(views, {}, {.sampleless_test = false, .stage_times = true}) == expected));
}

}  // namespace scree::tests
