#include "tools/view/replies.h"

#include <algorithm>

#include "tools/common/output/json_writer.h"
#include "tools/common/process/memory_use.h"

namespace scree::tools::view {
namespace {

void write_camera(JsonWriter& json, const Camera& camera) {
  json.array("eye", camera.eye);
  json.array("target", camera.target);
  json.array("up", camera.up);
  json.member("fov", camera.fov_degrees);
}

/// One message of u32, JSON and image.
std::vector<std::byte> picture_message(const std::string& head, const std::vector<std::byte>& image) {
  std::vector<std::byte> out;
  out.reserve(4 + head.size() + image.size());
  for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<std::byte>(head.size() >> shift));
  const auto* const text = reinterpret_cast<const std::byte*>(head.data());
  out.insert(out.end(), text, text + head.size());
  out.insert(out.end(), image.begin(), image.end());
  return out;
}

/// Writes the picture's number, and the view that it shows.
void write_place(JsonWriter& json, uint64_t frame, const PictureRequest& request) {
  json.member("frame", frame);
  json.member("seq", request.sequence);
  json.member("fullWidth", request.width);
  json.member("fullHeight", request.height);
}

/// Writes the members that are common to the heads of pictures and screenshots.
void write_head(JsonWriter& json, const Drawn& drawn, double encode_ms) {
  json.member("width", drawn.pixels.width);
  json.member("height", drawn.pixels.height);
  json.member("samples", drawn.samples);
  json.member("shadowMs", drawn.shadow_ms);
  json.member("drawMs", drawn.draw_ms);
  json.member("shadeMs", drawn.shade_ms);
  json.member("encodeMs", encode_ms);
  json.member("blendedLayers", drawn.blended.layers);
  json.member("samplesWithMoreLayers", drawn.blended.samples_left_out);
}

/// A message of `type`; body(json) adds its members.
template <class Body>
std::string message_of(std::string_view type, const Body& body) {
  return json_object([&](JsonWriter& json) {
    json.member("type", type);
    body(json);
  });
}

}  // namespace

std::string error_text(std::string_view message) {
  return message_of("error", [&](JsonWriter& json) { json.member("message", message); });
}

std::string loading_text(std::string_view file) {
  return message_of("loading", [&](JsonWriter& json) { json.member("file", file); });
}

std::string viewers_text(uint32_t you, std::span<const uint32_t> viewers) {
  return message_of("viewers", [&](JsonWriter& json) {
    json.member("you", you);
    json.array("viewers", viewers);
  });
}

std::string camera_text(uint32_t viewer, const Camera& camera) {
  return message_of("camera", [&](JsonWriter& json) {
    json.member("viewer", viewer);
    write_camera(json, camera);
  });
}

std::string point_text(Pixel at, const std::optional<runtime::Vec3>& point) {
  return message_of("point", [&](JsonWriter& json) {
    json.member("x", at.x);
    json.member("y", at.y);
    if (point) json.array("point", *point);
  });
}

std::string scene_text(const ViewSession& session, const SessionOptions& options) {
  return message_of("scene", [&](JsonWriter& json) {
    const runtime::Scene& scene = session.scene();
    const format::Container& container = scene.container();
    const std::string_view name = container.string(container.source().name);
    const size_t slash = options.file.find_last_of('/');
    json.member("name", std::string_view(options.file).substr(slash == std::string::npos ? 0 : slash + 1));
    json.member("source", name);
    json.member("file", std::string_view(options.file));
    json.member("scene", std::string_view(options.scene));
    json.member("triangles", scene.view().instance_base[scene.view().instance_count]);
    json.member("instances", scene.view().instance_count);
    json.member("meshes", scene.view().mesh_count);
    json.member("nodes", uint64_t{container.nodes().size()});
    json.member("drawnOn", std::string_view(session.drawn_on()));
    json.member("deviceBytes", session.device_bytes());
    std::string why;
    json.member("canCastShadows", session.can_cast_shadows(&why));
    json.member("whyNoShadows", std::string_view(why));
    json.member("shadows", options.light.shadow_side != 0);
    json.member("shadowSize", options.light.shadow_side);
    json.array("light", options.light.words);
    const runtime::WorldBox box = session.box();
    if (!box.is_empty()) {
      json.array("boxMin", box.min);
      json.array("boxMax", box.max);
    }
    json.object("home", [&] {
      // The home view of a wide picture; pages with a narrower picture move it back.
      if (const Result<Camera> home = session.home(1920, 1080); home) write_camera(json, *home);
    });
    json.objects("cameras", session.cameras(), [&](const NamedCamera& camera) {
      json.member("name", std::string_view(camera.name));
      write_camera(json, camera.camera);
    });
  });
}

std::vector<std::byte> moving_picture(uint64_t frame, const PictureRequest& request, const Quality& quality,
                                      const Drawn& drawn, double wait_ms, const std::optional<runtime::Vec3>& point) {
  const auto head = [&](JsonWriter& json) {
    json.member("kind", "jpeg");
    json.member("exact", false);
    write_place(json, frame, request);
    json.member("quality", static_cast<uint32_t>(quality.jpeg));
    json.member("scale", quality.scale);
    write_head(json, drawn, drawn.encode_ms);
    json.member("waitMs", wait_ms);
    json.member("leftBytes", drawn.left_bytes);
    json.member("triangles", drawn.stats.triangles);
    if (point) json.array("point", *point);
  };
  return picture_message(json_object(head), drawn.jpeg);
}

std::vector<std::byte> exact_picture(uint64_t frame, const PictureRequest& request, const Drawn& drawn,
                                     double encode_ms, uint64_t device_bytes, const std::optional<runtime::Vec3>& point,
                                     const std::vector<std::byte>& image) {
  const auto head = [&](JsonWriter& json) {
    json.member("kind", "png");
    json.member("exact", true);
    json.member("scale", 1.0);
    write_place(json, frame, request);
    write_head(json, drawn, encode_ms);
    json.member("triangles", drawn.stats.triangles);
    json.member("instancesDrawn", drawn.stats.instances_drawn);
    json.member("clustersDrawn", drawn.stats.clusters_drawn);
    json.member("hostBytes", memory_use().anonymous);
    json.member("deviceBytes", device_bytes);
    if (point) json.array("point", *point);
  };
  return picture_message(json_object(head), image);
}

std::vector<std::byte> screenshot_picture(uint64_t id, const Drawn& drawn, double encode_ms,
                                          const std::vector<std::byte>& image) {
  const auto head = [&](JsonWriter& json) {
    json.member("kind", "screenshot");
    json.member("id", id);
    write_head(json, drawn, encode_ms);
  };
  return picture_message(json_object(head), image);
}

std::string pick_text(uint64_t id, const std::optional<Picked>& picked) {
  return message_of("pick", [&](JsonWriter& json) {
    json.member("id", id);
    json.member("hit", picked.has_value());
    if (picked) {
      json.member("node", picked->node);
      json.member("nodeName", std::string_view(picked->node_name));
      json.member("nodeInstance", picked->node_instance);
      json.member("instance", picked->instance);
      json.member("mesh", picked->mesh);
      json.member("meshName", std::string_view(picked->mesh_name));
      json.member("triangle", picked->triangle);
      if (picked->material != format::kNone) json.member("material", picked->material);
      json.member("materialName", std::string_view(picked->material_name));
      json.member("depth", picked->depth);
      json.array("point", picked->point);
      json.array("box", picked->box, [&](const runtime::Vec3& corner) { json.array(corner); });
    }
  });
}

std::string nodes_text(const runtime::Scene& scene) {
  // 200,000 nodes are some MB. More would make the page slow; it shows a line that nodes are missing.
  constexpr uint64_t kMostNodes = 200000;
  const format::Container& container = scene.container();
  const auto nodes = container.nodes();
  constexpr uint64_t kMostNameBytes = uint64_t{8} << 20;  // limits the text if many nodes share one long name
  uint64_t count = std::min<uint64_t>(nodes.size(), kMostNodes);
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "nodes");
  json.member("total", uint64_t{nodes.size()});
  json.key("names");
  json.begin_array();
  for (uint64_t n = 0; n < count; ++n) {
    std::string_view name = container.string(nodes[n].name);
    if (name.empty() && nodes[n].group != format::kNone)
      name = container.string(container.groups()[nodes[n].group].name);
    if (text.size() + name.size() > kMostNameBytes) {
      count = n;
      break;
    }
    json.value(name);
  }
  json.end_array();
  std::vector<uint64_t> parents, triangles(count, 0);
  for (uint64_t n = 0; n < count; ++n)  // number of the parent + 1; 0: none
    parents.push_back(nodes[n].parent == format::kNone ? 0 : uint64_t{nodes[n].parent} + 1);
  json.array("parents", parents);
  const kernels::SceneView& view = scene.view();
  for (uint64_t i = 0; i < view.instance_count; ++i)
    if (view.instances[i].node < count)
      triangles[view.instances[i].node] += view.meshes[view.instances[i].mesh].triangle_count;
  json.array("triangles", triangles);
  json.end_object();
  return text;
}

}  // namespace scree::tools::view
