// Frames for tests, drawn and shaded by the engine's parts. For programs runtime::ViewRenderer combines these parts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/device_view.h"
#include "runtime/draw/pick.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/scene/scene.h"
#include "tests/results.h"

namespace scree::tests {

/// A view of `scene`, which must outlive it, drawn by the CPU or by `device`. A GPU keeps the frame until it draws
/// again.
class Frame {
 public:
  /// `view`: its sides in pixels. `shade`: the options of the later shade(), which a GPU that streams needs.
  static Result<Frame> draw(const runtime::Scene& scene, const kernels::View& view, uint32_t samples_per_side,
                            uint32_t threads, runtime::DeviceView* device = nullptr,
                            const kernels::ShadeOptions* shade = nullptr) {
    const Result<kernels::View> in_samples = runtime::view_of_samples(view, samples_per_side);
    if (!in_samples) return in_samples.error();
    Frame frame(scene, device, *in_samples, samples_per_side);
    if (device == nullptr) frame.samples_.resize(uint64_t{frame.view_.width} * frame.view_.height);
    const Result<kernels::FrameStats> stats =
        device != nullptr ? device->draw(frame.view_, nullptr, shade)
                          : kernels::draw_cpu(scene.view(), frame.view_, frame.samples_, threads);
    if (!stats) return stats.error();
    frame.stats_ = *stats;
    return frame;
  }

  /// RGBA8, rows from the top.
  Result<std::vector<uint8_t>> shade(const kernels::ShadeOptions& options, uint32_t threads) const {
    std::vector<uint8_t> rgba(uint64_t{4} * width() * height());
    const Result<void> done =
        device_ != nullptr
            ? device_->resolve(view_, side_, options, {reinterpret_cast<uint32_t*>(rgba.data()), rgba.size() / 4})
            : kernels::resolve_cpu(scene_->view(), view_, side_, samples_, options, 4, rgba, threads);
    if (!done) return done.error();
    return rgba;
  }

  template <class T>
  Result<std::vector<T>> layer(runtime::Layer layer, uint32_t threads) const {
    std::vector<T> values(uint64_t{width()} * height() * runtime::bytes_of(layer) / sizeof(T));
    const std::span<std::byte> out = std::as_writable_bytes(std::span(values));
    const Result<void> done = device_ != nullptr ? device_->read_layer(view_, side_, layer, out)
                                                 : kernels::layers_cpu(scene_->view(), view_, side_, samples_,
                                                                       runtime::target_of(layer, out.data()), threads);
    if (!done) return done.error();
    return values;
  }

  /// Copies the samples from a GPU, for samples() and pick().
  Result<void> read_samples() {
    if (device_ == nullptr) return {};
    samples_.resize(uint64_t{view_.width} * view_.height);
    return device_->read_samples(samples_);
  }

  Result<std::optional<runtime::Pick>> pick(uint32_t x, uint32_t y) const {
    return runtime::pick_sample(*scene_, view_, samples_[runtime::sample_index(view_, side_, x, y)]);
  }

  std::span<const uint64_t> samples() const { return samples_; }
  const kernels::View& view() const { return view_; }  // in samples
  uint32_t width() const { return view_.width / side_; }
  uint32_t height() const { return view_.height / side_; }
  const kernels::FrameStats& stats() const { return stats_; }

 private:
  Frame(const runtime::Scene& scene, runtime::DeviceView* device, const kernels::View& view, uint32_t side)
      : scene_(&scene), device_(device), view_(view), side_(side) {}

  const runtime::Scene* scene_;
  runtime::DeviceView* device_;
  kernels::View view_;
  uint32_t side_;
  std::vector<uint64_t> samples_;
  kernels::FrameStats stats_{};
};

inline Frame must_draw(const runtime::Scene& scene, const kernels::View& view, uint32_t samples_per_side = 1,
                       runtime::DeviceView* device = nullptr, const kernels::ShadeOptions* shade = nullptr) {
  return must(Frame::draw(scene, view, samples_per_side, 2, device, shade));
}

/// The shaded frame.
inline std::vector<uint8_t> must_picture(const runtime::Scene& scene, const kernels::View& view,
                                         uint32_t samples_per_side = 1, runtime::DeviceView* device = nullptr,
                                         const kernels::ShadeOptions& shade = {}) {
  return must(must_draw(scene, view, samples_per_side, device, &shade).shade(shade, 2));
}

/// Number of values that differ by more than one level.
inline size_t differing(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
  REQUIRE(a.size() == b.size());
  size_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += std::abs(a[i] - b[i]) > 1 ? 1 : 0;
  return count;
}

}  // namespace scree::tests
