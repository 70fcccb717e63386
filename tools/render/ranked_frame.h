// Frames that all ranks draw together, each with a part of the scene's pages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/blend.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/scene.h"
#include "tools/common/process/ranks.h"
#include "tools/render/gpu_links.h"
#include "tools/render/layers.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Each rank reads its own pages and draws them, on its GPU or its CPU. The samples become the minimum of all ranks'
/// samples. Each rank shades the samples of its own pages, and one rank, the root, gets the colours. All results equal
/// those of one process, because a sample is the minimum over fragments, whichever rank draws them.
///
/// A GPU draws the next frame while the ranks exchange, shade and gather this one. A CPU does not: its exchanges and
/// shading would take the cores that it draws with.
///
/// All ranks call open(), draw(), shade() and layers() in the same order. Errors as for one process, at the rank that
/// failed. It must end all ranks, because the others wait for it.
class RankedFrame {
 public:
  RankedFrame(const RenderOptions& options, Ranks& ranks) : options_(options), ranks_(ranks) {}

  /// Loads the scene's tables and this rank's pages; meanwhile the GPUs connect. `frames`: the number to draw.
  Result<void> open(uint64_t frames);

  /// Draws a frame, with the samples of all ranks. `view`: its sides in pixels. `root`: the rank that gets the results.
  /// `next`: the view of the next draw(), which a GPU begins; nullopt if there is none.
  Result<void> draw(const kernels::View& view, uint32_t root, const std::optional<kernels::View>& next);

  /// Shades the frame that draw() made last. Does nothing if no output is made from colours of surfaces.
  Result<void> shade();

  /// The layers that `options` request; complete at the root.
  Result<FrameLayers> layers();

  // At the root:
  /// The picture, after shade(): RGBA8, row by row from the top. Complete after end_reads(), as by
  /// ViewRenderer::read_later().
  Result<void> read_picture(std::span<uint32_t> rgba);
  /// The distances of the frame that draw() made last. Likewise.
  Result<void> read_depth(std::span<std::byte> out);
  Result<void> end_reads();
  /// Its samples, if `options` request an output that is made from them.
  std::span<const uint64_t> samples() const { return samples_; }

  const runtime::Scene& scene() const { return *scene_; }
  const kernels::View& view() const { return view_; }  // of the last frame, in samples
  const kernels::BlendCounts& blended() const { return blended_; }
  bool has_gpu() const { return device_.has_value(); }
  /// How the last frame was exchanged.
  const char* way() const { return is_by_nccl_ ? "nccl" : "mpi"; }
  double page_bytes() const { return own_bytes_; }  // of this rank

  /// "the GPUs", if each of `ranks` has drawn on one; else "2 GPUs and the CPUs".
  static std::string processors(uint32_t gpus, uint32_t ranks) {
    if (gpus == 0) return "the CPUs";
    return gpus == ranks ? "the GPUs" : std::to_string(gpus) + " GPUs and the CPUs";
  }

  /// Milliseconds of this rank, of loading and of the last frame. Where a GPU has begun the next frame, `draw` and
  /// `exchange` are the times that were left to wait.
  struct Times {
    double load = 0, connect = 0, draw = 0, shade = 0, exchange = 0;
  };
  const Times& times() const { return times_; }

 private:
  bool is_root() const { return ranks_.rank() == root_; }
  uint32_t width() const { return options_.camera.width; }
  uint32_t height() const { return options_.camera.height; }
  Result<void> choose_gpu();
  Result<void> load_tables();
  Result<void> load_pages();
  Result<void> upload();
  Result<void> falls_back(const Error& error);
  template <class OnGpu, class OnCpu>
  Result<void> on_gpu_or_cpu(const OnGpu& on_gpu, const OnCpu& on_cpu);
  Result<void> load_own_pages();
  void place_sun();
  bool takes_nccl() const;
  Result<void> draw_part();
  Result<void> draw_on_cpu();
  Result<void> draw_on_gpu();
  Result<void> start_next(bool by_nccl);
  kernels::View in_samples(kernels::View view) const;
  Result<void> read_samples();
  Result<void> join();
  Result<void> join_by_nccl(bool is_whole);
  void read_shadows_on_host();
  Result<void> shade_on_cpu();
  Result<void> shade_on_gpu();
  Result<float*> make_colors_on_gpu();
  Result<void> shade_by_nccl();
  Result<void> draw_layers();
  Result<void> read(runtime::Layer layer, std::span<std::byte> out);
  bool has_page_of(uint64_t triangle) const;
  Result<void> read_linear(std::span<float> out);

  const RenderOptions& options_;
  Ranks& ranks_;
  GpuLinks links_;
  std::optional<runtime::Gpu> gpu_;
  std::optional<runtime::Scene> scene_;
  std::vector<uint32_t> owners_;                // of the drawn pages
  std::optional<runtime::DeviceScene> device_;  // with this rank's pages; none if the CPU draws
  std::optional<runtime::DeviceView> on_gpu_;   // its view of the picture
  std::optional<runtime::DeviceView> sun_on_gpu_;
  std::vector<std::vector<std::byte>> unpacked_;  // of this rank's compressed pages
  std::vector<const std::byte*> pages_;           // by page number; null: another rank's, or only on the GPU
  kernels::SceneView scene_view_{};               // with this rank's pages only
  kernels::View view_{};                          // width and height in samples
  std::optional<kernels::View> next_;             // likewise, of the next draw()
  bool starts_next_ = false;                      // there is more than one frame
  uint32_t root_ = 0;
  bool is_by_nccl_ = false;
  uint32_t joins_ = 0;                // calls of LowerSamples in the frame that was started last
  bool is_whole_ = false;             // the GPU's samples are those of all ranks already
  const uint32_t* pixels_ = nullptr;  // the picture in the GPU's memory, of a frame by NCCL
  std::vector<uint64_t> samples_;
  kernels::ShadeOptions shade_;  // of options_, with the sun if the frame has its shadows
  kernels::SunShadow sun_{};
  std::vector<uint64_t> shadows_[kernels::kMostSunMaps];  // its samples on the host
  uint64_t* shadows_on_gpu_[kernels::kMostSunMaps] = {};  // and in sun_on_gpu_
  std::vector<float> colors_;
  std::vector<float> over_;  // colours of blended surfaces; empty if there are none
  kernels::BlendCounts blended_;
  double own_bytes_ = 0;
  Times times_;
};

}  // namespace scree::tools
