// A scene that is drawn for viewers: from a camera to pixels, depths and picks. Independent of HTTP and of the page.
// The rest of tools/view/ accesses scenes only through it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/streamer.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/draw_options.h"
#include "tools/view/encode.h"
#include "tools/view/message.h"

namespace scree::tools::view {

struct SessionOptions : DeviceOptions {
  std::string file;
  std::string scene;  // by name or number; empty: the file's default
  TextureOptions textures;
  LightOptions light;
  bool quiet = false;  // no warnings
};

/// A camera of the document, in the form that a page uses.
struct NamedCamera {
  std::string name;
  Camera camera;
};

/// Parameters of encode_jpeg().
struct JpegKind {
  int quality;
  bool is_sharp;
};

/// How long drawing waits for data that are being loaded, as runtime::IsOver. By default until all are loaded.
struct Patience {
  runtime::IsOver chunks;    // for chunks of a GPU; afterwards missing chunks leave holes in the picture
  runtime::IsOver textures;  // for pages of textures; afterwards textures are coarser
  runtime::IsOver shadows;   // for chunks of the shadow map, which is drawn before the picture
};

/// A picture with its size and times.
struct Drawn {
  PixelView pixels;             // valid until the next draw(); a GPU that made the JPEG keeps their bytes
  std::vector<std::byte> jpeg;  // empty if none was requested
  uint32_t samples = 1;
  kernels::FrameStats stats{};
  kernels::BlendCounts blended;
  uint64_t left_bytes = 0;  // of chunks and pages that are still missing; 0: the picture is complete
  double draw_ms = 0;       // 0 if the previous picture had the same visibility buffer,
  double buffer_ms = 0;     // which took this long when it was drawn
  double shadow_ms = 0;     // of the shadow map; 0 if there is none, or an earlier one was kept
  double shade_ms = 0;      // includes copying the pixels to the host
  double encode_ms = 0;     // of the JPEG
};

/// A copy of the depths of one picture, so that the point under a viewer's cursor can be found while other pictures are
/// drawn.
class DepthMap {
 public:
  /// The point in world space under a pixel; nullopt on the background. `at` must lie within the picture.
  std::optional<runtime::Vec3> point(Pixel at) const;
  /// Distance along the view direction, in scene units.
  std::optional<double> depth(Pixel at) const;
  uint64_t bytes() const { return codes_.size() * sizeof(uint32_t); }

 private:
  friend class ViewSession;
  kernels::View view_{};  // in samples
  uint32_t samples_ = 1;
  uint32_t step_ = 1;  // pixels between two kept depths
  uint32_t across_ = 0;
  std::vector<uint32_t> codes_;
};

/// The surface under a pixel.
struct Picked {
  uint32_t node = 0;
  uint32_t node_instance = 0;
  uint64_t instance = 0;  // in the scene
  uint32_t mesh = 0;
  uint64_t triangle = 0;  // in the mesh as stored
  uint32_t material = format::kNone;
  std::string node_name;
  std::string mesh_name;
  std::string material_name;
  runtime::Vec3 point{};               // world
  double depth = 0;                    // along the view direction
  std::array<runtime::Vec3, 8> box{};  // the instance's box: corner k has its maximum along axis a if bit a is set
};

/// Used only by the thread that opened it.
class ViewSession {
 public:
  /// Opens and loads the scene, to a GPU if the options allow it. Chunks are uploaded to the GPU with the pictures that
  /// show them, and by load_rest(). With BackendChoice::kAuto the CPU draws if the GPU fails, now or later. Errors as
  /// SceneFile::open, Scene::load and DeviceScene::upload.
  static Result<ViewSession> open(const SessionOptions& options);
  ViewSession(ViewSession&&) noexcept;
  ViewSession& operator=(ViewSession&&) noexcept;
  ~ViewSession();

  /// Draws and shades a picture of `width` x `height` pixels. `viewer`: the caller's number of the viewer. On a GPU
  /// each viewer has its own visibility hints of clusters, until forget(); 0: none. `visibility`: may name nodes that
  /// do not exist. `jpeg`: parameters of encoding, or null. A GPU encodes the JPEG itself, so that only the file is
  /// copied to the host instead of all pixels. Its shadows may be those of runtime::ShadowFit::kMoving. Otherwise, if
  /// Drawn::left_bytes is 0, the pixels equal those of `scree render` with
  /// the same camera, size, samples and shading, bit for bit. Errors kUsage (a camera without a direction), kRange
  /// (more than kernels::kMaxImageSide samples per side), kMemory, kDevice.
  Result<Drawn> draw(uint32_t viewer, const PictureRequest& request, uint32_t width, uint32_t height, uint32_t samples,
                     const Visibility& visibility, const JpegKind* jpeg = nullptr, const Patience& patience = {});

  /// Frees memory that only a very large picture needs. Call it after a screenshot, whose pixels are gone then.
  void shrink();

  /// Frees the memory of a viewer that has left.
  void forget(uint32_t viewer);

  /// Uploads chunks that no picture has needed yet, until `is_over`. Returns the bytes that are left: 0 in the end,
  /// unless the scene exceeds the GPU's memory. The last picture must be drawn again before it is read. Errors as
  /// draw(), and those of damaged pages.
  Result<uint64_t> load_rest(const runtime::IsOver& is_over);

  /// Whether pictures can have shadows: the light is the file's, and it has a sun. Else `why` is one line.
  bool can_cast_shadows(std::string* why = nullptr) const;

  /// The depths of draw()'s last picture. Errors kMemory, kDevice.
  Result<DepthMap> depths();
  Result<std::optional<Picked>> pick(Pixel at);
  /// The point in world space under a pixel of draw()'s last picture; nullopt on the background, or if the samples are
  /// not on the host.
  std::optional<runtime::Vec3> point(Pixel at) const;

  /// A view of the whole scene for a picture of this size. Errors as runtime::make_view.
  Result<Camera> home(uint32_t width, uint32_t height) const;
  std::vector<NamedCamera> cameras() const;
  runtime::WorldBox box() const;

  const runtime::Scene& scene() const;
  const std::string& drawn_on() const;  // "cuda:0 (NVIDIA H200)", "the CPU, 16 threads"
  uint64_t device_bytes() const;        // on the GPU; 0 on the CPU
  runtime::Workers& workers();

 private:
  struct Impl;
  explicit ViewSession(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::tools::view
