#include "tools/view/message.h"

#include <algorithm>

#include <nlohmann/json.hpp>

#include "tools/render/render_options.h"

namespace scree::tools::view {
namespace {

using Json = nlohmann::json;

/// Reads members of one object. Keeps the first error; afterwards every read returns a default.
class Members {
 public:
  explicit Members(const Json& object) : object_(object) {}

  const std::optional<Error>& error() const { return error_; }

  double number(const char* name, double low, double high) { return as_number(name, find(name), low, high); }

  uint64_t whole(const char* name, uint64_t low, uint64_t high) { return as_whole(name, find(name), low, high); }

  bool flag(const char* name) {
    const Json* const value = find(name);
    if (value == nullptr) return false;
    if (!value->is_boolean()) return fail(ErrorCode::kFormat, name, "is not true or false"), false;
    return value->get<bool>();
  }

  std::string text(const char* name, size_t most) {
    const Json* const value = find(name);
    if (value == nullptr) return {};
    const auto* const found = value->get_ptr<const std::string*>();
    if (found == nullptr) return fail(ErrorCode::kFormat, name, "is not a text"), std::string();
    if (found->size() > most) return fail(ErrorCode::kRange, name, "is too long"), std::string();
    return *found;
  }

  runtime::Vec3 vector(const char* name) {
    runtime::Vec3 out{};
    const Json* const value = find(name);
    if (value == nullptr) return out;
    if (!value->is_array() || value->size() != 3) return fail(ErrorCode::kFormat, name, "is not three numbers"), out;
    for (size_t i = 0; i < 3; ++i) out[i] = as_number(name, &(*value)[i], -kMaxCoordinate, kMaxCoordinate);
    return out;
  }

  /// Six numbers; nullopt if the member is absent.
  std::optional<runtime::WorldBox> box(const char* name) {
    const Json* const value = optional(name);
    if (value == nullptr) return std::nullopt;
    runtime::WorldBox out;
    if (!value->is_array() || value->size() != 6) return fail(ErrorCode::kFormat, name, "is not six numbers"), out;
    for (size_t i = 0; i < 6; ++i)
      (i < 3 ? out.min[i] : out.max[i - 3]) = as_number(name, &(*value)[i], -kMaxCoordinate, kMaxCoordinate);
    for (size_t i = 0; i < 3; ++i)
      if (out.min[i] > out.max[i]) fail(ErrorCode::kRange, name, "has its corners in the wrong order");
    return out;
  }

  std::vector<uint32_t> nodes(const char* name) {
    std::vector<uint32_t> out;
    const Json* const value = find(name);
    if (value == nullptr) return out;
    if (!value->is_array() || value->size() > kMaxListedNodes)
      return fail(ErrorCode::kFormat, name, "is not a list of at most " + std::to_string(kMaxListedNodes) + " nodes"),
             out;
    for (const Json& node : *value) out.push_back(static_cast<uint32_t>(as_whole(name, &node, 0, format::kNone - 1)));
    return out;
  }

  /// Null if the member is absent, which is not an error.
  const Json* optional(const char* name) const {
    const auto found = object_.find(name);
    return found == object_.end() ? nullptr : &*found;
  }

  void fail(ErrorCode code, const char* name, const std::string& what) {
    if (!error_) error_ = Error{code, std::string("message: ") + name + " " + what};
  }

 private:
  const Json* find(const char* name) {
    const Json* const found = optional(name);
    if (found == nullptr) fail(ErrorCode::kFormat, name, "is missing");
    return found;
  }

  double as_number(const char* name, const Json* value, double low, double high) {
    if (value == nullptr) return low;
    if (!value->is_number()) return fail(ErrorCode::kFormat, name, "is not a number"), low;
    const double number = value->get<double>();
    if (!(number >= low && number <= high))
      return fail(ErrorCode::kRange, name, "is not within " + std::to_string(low) + " and " + std::to_string(high)),
             low;
    return number;
  }

  uint64_t as_whole(const char* name, const Json* value, uint64_t low, uint64_t high) {
    if (value == nullptr) return low;
    if (!value->is_number_unsigned()) return fail(ErrorCode::kFormat, name, "is not a whole number"), low;
    const uint64_t number = value->get<uint64_t>();
    if (number < low || number > high)
      return fail(ErrorCode::kRange, name, "is not within " + std::to_string(low) + " and " + std::to_string(high)),
             low;
    return number;
  }

  const Json& object_;
  std::optional<Error> error_;
};

constexpr uint64_t kMaxNumber = uint64_t{1} << 53;  // JavaScript's integers are exact up to here

Pixel read_pixel(Members& in) {
  return {static_cast<uint32_t>(in.whole("x", 0, kMaxPictureSide - 1)),
          static_cast<uint32_t>(in.whole("y", 0, kMaxPictureSide - 1))};
}

void read_size(Members& in, uint32_t& width, uint32_t& height) {
  width = static_cast<uint32_t>(in.whole("width", 1, kMaxPictureSide));
  height = static_cast<uint32_t>(in.whole("height", 1, kMaxPictureSide));
  if (uint64_t{width} * height > kMaxPicturePixels)
    in.fail(ErrorCode::kRange, "width", "times height is above " + std::to_string(kMaxPicturePixels));
}

uint32_t read_samples(Members& in) {
  const uint64_t samples = in.whole("samples", 1, 4);
  if (samples == 3) in.fail(ErrorCode::kRange, "samples", "is not 1, 2 or 4");
  return static_cast<uint32_t>(samples);
}

kernels::ShadeOptions read_shade(Members& in) {
  kernels::ShadeOptions shade;
  const Result<kernels::Show> show = parse_show(in.text("show", 16));
  if (show) {
    shade.show = *show;
  } else {
    in.fail(ErrorCode::kFormat, "show", "is no shading mode");
  }
  shade.light = in.flag("light");
  shade.ssao = in.flag("ssao");
  shade.edl = in.flag("edl");
  shade.edl_strength = static_cast<float>(in.number("edlStrength", 0, 100));
  shade.edl_radius = static_cast<uint32_t>(in.whole("edlRadius", 1, 64));
  const Result<std::array<float, 4>> background = parse_color(in.text("background", 16));
  if (background) {
    std::copy(background->begin(), background->end(), shade.background);
  } else {
    in.fail(ErrorCode::kFormat, "background", "is no colour");
  }
  shade.background[3] = 1;
  return shade;
}

PictureRequest read_picture(Members& in) {
  PictureRequest out{.sequence = in.whole("seq", 0, kMaxNumber),
                     .camera = {.eye = in.vector("eye"),
                                .target = in.vector("target"),
                                .up = in.vector("up"),
                                .fov_degrees = in.number("fov", 0.001, 179.9)}};
  read_size(in, out.width, out.height);
  out.shade = read_shade(in);
  out.shadows = in.flag("shadows");
  out.clip_box = in.box("clip");
  out.most_samples = read_samples(in);
  out.is_moving = in.flag("moving");
  out.is_full_quality = in.flag("full");
  if (in.optional("x") != nullptr) {
    const Pixel cursor = read_pixel(in);
    if (cursor.x < out.width && cursor.y < out.height) out.cursor = cursor;
  }
  return out;
}

Message read(std::string_view type, Members& in) {
  if (type == "hello") return Hello{in.text("token", 64)};
  if (type == "view") return read_picture(in);
  if (type == "ack") return Ack{in.whole("frame", 0, kMaxNumber)};
  if (type == "probe") return Probe{read_pixel(in)};
  if (type == "pick") return PickRequest{in.whole("id", 0, kMaxNumber), read_pixel(in)};
  if (type == "screenshot") {
    Screenshot out{.id = in.whole("id", 0, kMaxNumber)};
    read_size(in, out.width, out.height);
    out.samples = read_samples(in);
    return out;
  }
  if (type == "nodes") return NodesRequest{};
  if (type == "hide") return Visibility{in.nodes("hidden"), in.nodes("only")};
  if (type == "follow") return Follow{static_cast<uint32_t>(in.whole("viewer", 0, ~uint32_t{0}))};
  in.fail(ErrorCode::kFormat, "type", "is unknown");
  return NodesRequest{};
}

}  // namespace

Result<Message> parse_message(std::string_view text) {
  if (text.size() > kMaxMessageBytes)
    return Error{ErrorCode::kFormat,
                 "message: " + std::to_string(text.size()) + " bytes, at most " + std::to_string(kMaxMessageBytes)};
  const Json object = Json::parse(text.begin(), text.end(), nullptr, false);
  if (!object.is_object()) return Error{ErrorCode::kFormat, "message: not a JSON object"};
  Members in(object);
  const std::string type = in.text("type", 16);
  Message message = read(type, in);
  if (in.error()) return *in.error();
  return message;
}

}  // namespace scree::tools::view
