#include "tools/gltf/cameras.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "format/fail.h"

namespace scree::convert {

Result<void> make_cameras(const GltfDocument& document, SourceScene& scene) {
  for (size_t i = 0; i < document.cameras.size(); ++i) {
    const DocCamera& from = document.cameras[i];
    NamedCamera camera;
    camera.name = from.name;
    camera.record.kind = from.orthographic ? format::CameraKind::kOrthographic : format::CameraKind::kPerspective;
    camera.record.y = from.orthographic ? std::abs(from.y) : from.y;
    camera.record.x = from.orthographic ? std::abs(from.x) : from.x;
    camera.record.z_near = from.z_near;
    camera.record.z_far = from.z_far;
    const bool perspective = !from.orthographic;
    const char* wrong = nullptr;
    if (!(camera.record.y > 0) || (perspective && camera.record.y >= std::numbers::pi))
      wrong = perspective ? "yfov is not between 0 and pi" : "ymag is 0";
    else if (perspective ? camera.record.x < 0 : camera.record.x == 0)
      wrong = perspective ? "aspectRatio is negative" : "xmag is 0";
    else if (perspective ? !(from.z_near > 0) : !(from.z_near >= 0))
      wrong = "znear is not positive";
    else if ((from.z_far != 0 || from.orthographic) && from.z_far <= from.z_near)
      wrong = "zfar is not past znear";
    if (wrong != nullptr) return fail(ErrorCode::kRange, "camera ", i, ": ", wrong);
    scene.cameras.push_back(std::move(camera));
  }
  return {};
}

Result<void> make_lights(const GltfDocument& document, const NodePlan& plan, SourceScene& scene) {
  for (uint32_t place = 0; place < plan.order.size(); ++place) {
    const int32_t number = document.nodes[plan.order[place]].light;
    if (number == kAbsent) continue;
    const DocLight& from = document.lights[static_cast<size_t>(number)];
    const auto fail = [&](const std::string& what) {
      return scree::fail(ErrorCode::kRange, "light ", number, ": ", what);
    };
    NamedLight light{.name = from.name};
    format::LightRecord& to = light.record;
    to.node = place;
    to.kind = from.type == "directional" ? format::LightKind::kDirectional
              : from.type == "point"     ? format::LightKind::kPoint
                                         : format::LightKind::kSpot;
    if (to.kind == format::LightKind::kSpot && from.type != "spot")
      return fail("type is \"" + from.type + "\", expected directional, point or spot");
    for (size_t c = 0; c < 3; ++c) to.color[c] = static_cast<float>(from.color[c]);
    to.intensity = static_cast<float>(from.intensity);
    if (to.kind != format::LightKind::kDirectional) to.range = static_cast<float>(from.range);
    for (const float value : {to.color[0], to.color[1], to.color[2], to.intensity, to.range})
      if (!(value >= 0) || !std::isfinite(value)) return fail("a colour, intensity or range that is not 0 or more");
    if (to.kind == format::LightKind::kSpot) {
      // Some writers round pi / 2 up, and some write cones without a rim.
      to.outer_cone = std::min(static_cast<float>(from.outer_cone), static_cast<float>(std::numbers::pi / 2));
      to.inner_cone = static_cast<float>(from.inner_cone);
      if (to.inner_cone >= to.outer_cone) to.inner_cone = std::nextafter(to.outer_cone, 0.0f);
      if (!(to.inner_cone >= 0) || !(to.outer_cone > to.inner_cone))
        return fail("innerConeAngle is not between 0 and outerConeAngle");
    }
    scene.lights.push_back(std::move(light));
  }
  return {};
}

}  // namespace scree::convert
