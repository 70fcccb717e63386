// The messages of a page to the server: one JSON object per WebSocket message. They are not trusted until they are
// parsed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/camera.h"

namespace scree::tools::view {

inline constexpr size_t kMaxMessageBytes = 16 << 10;
inline constexpr uint32_t kMaxPictureSide = 8192;                 // pixels
inline constexpr uint64_t kMaxPicturePixels = uint64_t{1} << 25;  // 8192 x 4096
inline constexpr uint32_t kMaxListedNodes = 1024;                 // per kHide message
inline constexpr double kMaxCoordinate = 1e15;                    // in scene units; a camera farther away is an error

/// A point in a picture, in pixels from the top left.
struct Pixel {
  uint32_t x = 0;
  uint32_t y = 0;
  bool operator==(const Pixel&) const = default;
};

struct Camera {
  runtime::Vec3 eye{};
  runtime::Vec3 target{};
  runtime::Vec3 up{0, 1, 0};
  double fov_degrees = runtime::kDefaultFovDegrees;  // vertical
  bool operator==(const Camera&) const = default;
};

/// "hello": the first message of a page. Any other first message ends the connection.
struct Hello {
  std::string token;
};

/// "view": everything that determines a picture, so the newest request replaces all older ones.
struct PictureRequest {
  uint64_t sequence = 0;  // the page's number of the request, returned with the picture
  Camera camera;
  uint32_t width = 0;  // pixels, at rest
  uint32_t height = 0;
  kernels::ShadeOptions shade;  // with an opaque background
  bool shadows = false;         // of the sun, if ViewSession::can_cast_shadows()
  std::optional<runtime::WorldBox> clip_box;
  uint32_t most_samples = 1;     // per side of a pixel, at rest: 1, 2 or 4
  bool is_moving = false;        // the next request will follow immediately
  bool is_full_quality = false;  // full size and the best JPEG quality even while moving, even if that is slow
  std::optional<Pixel> cursor;   // within the picture
};

/// "ack": reports that a picture is on the screen.
struct Ack {
  uint64_t frame = 0;
};

/// "probe": requests the point under this pixel of the newest picture at rest.
struct Probe {
  Pixel at;
};

/// "pick": requests the properties of the surface under this pixel.
struct PickRequest {
  uint64_t id = 0;  // the page's number of the request, returned with the answer
  Pixel at;
};

/// "screenshot": requests the newest view, lossless, in any size.
struct Screenshot {
  uint64_t id = 0;
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t samples = 1;
};

/// "nodes": requests the tree of the scene's nodes.
struct NodesRequest {};

/// "hide": sets the nodes that are drawn. A node stands for itself and all its descendants.
struct Visibility {
  std::vector<uint32_t> hidden;
  std::vector<uint32_t> only;  // empty: all
  bool is_all() const { return hidden.empty() && only.empty(); }
  bool operator==(const Visibility&) const = default;
};

/// "follow": sets the viewer whose camera this page copies; 0: none.
struct Follow {
  uint32_t viewer = 0;
};

using Message =
    std::variant<Hello, PictureRequest, Ack, Probe, PickRequest, Screenshot, NodesRequest, Visibility, Follow>;

/// Errors kFormat (not a JSON object of at most kMaxMessageBytes, an unknown type, a missing member), kRange (a number
/// outside its limits), each with the member's name. Every number of a Message is finite and within the limits above;
/// a PictureRequest's cursor lies within its picture. Node numbers are not checked against a scene. Safe on any bytes.
Result<Message> parse_message(std::string_view text);

}  // namespace scree::tools::view
