// Messages to pages: JSON texts, and picture messages with their heads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/view/adaptation.h"
#include "tools/view/message.h"
#include "tools/view/session.h"

namespace scree::tools::view {

std::string error_text(std::string_view message);
/// Sent until the scene is open.
std::string loading_text(std::string_view file);
/// The scene, its cameras, and the first view of a page.
std::string scene_text(const ViewSession& session, const SessionOptions& options);
/// Names, parents and triangles of the first 200,000 nodes.
std::string nodes_text(const runtime::Scene& scene);
std::string viewers_text(uint32_t you, std::span<const uint32_t> viewers);
/// Sent to viewers that follow `viewer`.
std::string camera_text(uint32_t viewer, const Camera& camera);
/// `point`: unset for the background.
std::string point_text(Pixel at, const std::optional<runtime::Vec3>& point);
std::string pick_text(uint64_t id, const std::optional<Picked>& picked);

// Picture messages: u32 little-endian, bytes of the JSON head that follows; then the image file.

/// `drawn` has a JPEG. `wait_ms`: from the request to the start of its drawing.
std::vector<std::byte> moving_picture(uint64_t frame, const PictureRequest& request, const Quality& quality,
                                      const Drawn& drawn, double wait_ms, const std::optional<runtime::Vec3>& point);
std::vector<std::byte> exact_picture(uint64_t frame, const PictureRequest& request, const Drawn& drawn,
                                     double encode_ms, uint64_t device_bytes, const std::optional<runtime::Vec3>& point,
                                     const std::vector<std::byte>& image);
std::vector<std::byte> screenshot_picture(uint64_t id, const Drawn& drawn, double encode_ms,
                                          const std::vector<std::byte>& image);

}  // namespace scree::tools::view
