// The peers of the CuRast paper (Schütz, Lipp, Kristmann, Wimmer, 2026): a measured scene drawn by the GPU's own
// rasteriser through Vulkan 1.3, without a window. Each draw call takes a mesh with all its instances, float32
// positions and 32-bit indices, and writes triangle ids and depth.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "tools/synth/scenes.h"

namespace scree::lab {

enum class PeerDrawing {
  kIndexed,  // VK-ID: vertex and index buffers, read by the GPU's vertex fetch
  kPulled,   // VK-PIP, programmable index pulling: no vertex buffers, the vertex shader reads indices and positions
};

/// The paper's name of the drawing.
constexpr const char* peer_name(PeerDrawing drawing) {
  return drawing == PeerDrawing::kIndexed ? "VK-ID" : "VK-PIP";
}

/// A scene in the memory of a GPU that draws it by its own rasteriser. Instances outside the view are left out: scree's
/// test of their boxes runs on the host, outside all measured times. Backs of triangles are culled, as scree does where
/// no material is double-sided.
class Peer {
 public:
  virtual ~Peer() = default;

  /// The GPU and its driver: "NVIDIA H100, NVIDIA 580.159.04".
  virtual std::string device() const = 0;

  /// Makes the scene's vertices and indices in device memory, replacing the last scene's. `scene` must outlive the
  /// draws. Errors kMemory: does not fit, with the bytes needed and free; kDevice.
  virtual Result<void> load(const synth::Scene& scene, uint32_t threads) = 0;
  /// Frees the scene's memory and the pictures'.
  virtual void unload() = 0;
  /// Positions and indices; these, the instances, and the pictures of the last look().
  virtual uint64_t geometry_bytes() const = 0;
  virtual uint64_t device_bytes() const = 0;

  /// Culls instances and records the draw calls of a perspective view without a clipping box, for any number of draws.
  /// Returns the counts of the remaining instances, draw calls and triangles. Errors kMemory, kRange (a picture larger
  /// than the GPU draws), kDevice.
  virtual Result<kernels::FrameStats> look(const kernels::View& view) = 0;

  struct Ms {
    float gpu = 0;   // by the GPU's clock, from before the picture is cleared to the end of all draw calls
    float wall = 0;  // by the host's clock, from submitting to the end of the wait
  };
  /// Draws a frame of the last look(). Allocates nothing. Errors kDevice.
  virtual Result<Ms> draw(PeerDrawing drawing) = 0;

  /// The global triangle id of each sample of the last frame, row by row; kernels::kIdMask on the background. Errors
  /// kDevice.
  virtual Result<std::vector<uint64_t>> ids() = 0;
};

/// Opens libvulkan.so.1 and a GPU: the one with `uuid` (runtime::Gpu::uuid), or the first suitable one if `uuid` is
/// empty. Errors kDevice: built without Vulkan, no library, no such GPU, a missing feature of the GPU.
Result<std::unique_ptr<Peer>> open_vulkan_peer(const std::string& uuid);

}  // namespace scree::lab
