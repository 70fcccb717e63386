#include "tools/render/camera_path.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>

#include <nlohmann/json.hpp>

#include "tools/common/output/text_table.h"

namespace scree::tools {
namespace {

using Json = nlohmann::json;

constexpr double kMaxCoordinate = 1e15;
constexpr const char* kFormatName = "scree camera path";

std::string in_quotes(std::string_view name) {
  return "\"" + inspect::printable(name, 40) + "\"";
}

/// Reads `count` numbers within +-kMaxCoordinate into `out`.
Result<void> read_numbers(const Json& value, const char* name, size_t count, double* out) {
  const std::string expected = std::to_string(count) + " numbers of at most 1e15";
  const Error wrong{ErrorCode::kFormat, in_quotes(name) + " is not " + expected};
  if (!value.is_array() || value.size() != count) return wrong;
  for (size_t i = 0; i < count; ++i) {
    if (!value[i].is_number()) return wrong;
    out[i] = value[i].get<double>();
    if (!(std::abs(out[i]) <= kMaxCoordinate)) return wrong;
  }
  return {};
}

Result<double> read_number(const Json& value, const char* name, double low, double high, const char* expected) {
  if (!value.is_number()) return Error{ErrorCode::kFormat, in_quotes(name) + " is not " + expected};
  const double number = value.get<double>();
  if (!(number >= low && number < high)) return Error{ErrorCode::kRange, in_quotes(name) + " is not " + expected};
  return number;
}

/// Reads a rotation and a translation from camera to world, column by column. The camera looks along -z with y up.
Result<void> read_matrix(const Json& value, PathKey& key) {
  std::array<double, 16> m{};
  SCREE_TRY(read_numbers(value, "matrix", m.size(), m.data()));
  if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
    return Error{ErrorCode::kRange,
                 "\"matrix\": the last row is not 0 0 0 1 (the order of its numbers is column by column)"};
  const double reach = std::hypot(m[8], m[9], m[10]);
  if (!(reach > 0)) return Error{ErrorCode::kRange, "\"matrix\" has no direction: its third column is 0"};
  for (size_t i = 0; i < 3; ++i) {
    key.eye[i] = m[12 + i];
    key.target[i] = m[12 + i] - m[8 + i] / reach;
    key.up[i] = m[4 + i];
  }
  return {};
}

/// `has_t`: set to true if the key has a "t".
Result<PathKey> read_key(const Json& object, bool& has_t) {
  if (!object.is_object()) return Error{ErrorCode::kFormat, "is not an object"};
  PathKey key;
  const bool has_eye = object.contains("eye"), has_target = object.contains("target"), has_up = object.contains("up");
  const bool has_matrix = object.contains("matrix");
  for (const auto& [name, value] : object.items()) {
    if (name == "t") {
      has_t = true;
      key.t = SCREE_TRY(read_number(value, "t", 0, 1e9, "a time in seconds, 0 or more and below 1e9"));
    } else if (name == "fov") {
      key.fov_degrees = SCREE_TRY(read_number(value, "fov", runtime::kSmallestFovDegrees, 180,
                                              "an angle of at least 1e-9 and below 180 degrees"));
    } else if (name == "eye") {
      SCREE_TRY(read_numbers(value, "eye", 3, key.eye.data()));
    } else if (name == "target") {
      SCREE_TRY(read_numbers(value, "target", 3, key.target.data()));
    } else if (name == "up") {
      SCREE_TRY(read_numbers(value, "up", 3, key.up.data()));
    } else if (name == "matrix") {
      SCREE_TRY(read_matrix(value, key));
    } else if (name != "name") {
      return Error{ErrorCode::kFormat,
                   "has an unknown member " + in_quotes(name) + "; a key has t, eye, target, up, fov, matrix, name"};
    }
  }
  if (has_matrix && (has_eye || has_target || has_up))
    return Error{ErrorCode::kFormat, "has \"matrix\" together with \"eye\", \"target\" or \"up\", which it replaces"};
  if (!has_matrix && !(has_eye && has_target))
    return Error{ErrorCode::kFormat, "has no " + in_quotes(has_eye ? "target" : "eye")};
  return key;
}

/// An error of the parser as one line that names line and byte.
Error syntax_error(std::string_view text, const Json::parse_error& error) {
  const size_t byte = std::min<size_t>(error.byte, text.size());
  const auto line = 1 + std::count(text.begin(), text.begin() + static_cast<ptrdiff_t>(byte), '\n');
  return {ErrorCode::kFormat, "line " + std::to_string(line) + ": is not JSON (byte " + std::to_string(byte) + ")"};
}

}  // namespace

Result<CameraPath> CameraPath::parse(std::string_view text, std::optional<double> frames_per_second) {
  Json json;
  try {
    json = Json::parse(text.begin(), text.end());
  } catch (const Json::parse_error& error) {
    return syntax_error(text, error);
  } catch (const Json::exception&) {  // a number outside the range of doubles
    return Error{ErrorCode::kRange, "has a number that is too large"};
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left to read it"};
  }
  if (!json.is_object() || !json.contains("format") || json["format"] != kFormatName)
    return Error{ErrorCode::kFormat, "is no camera path: its \"format\" is not " + in_quotes(kFormatName)};
  if (!json.contains("version") || json["version"] != 1)
    return Error{ErrorCode::kVersion, "\"version\" is not 1, the one that this program reads"};
  CameraPath path;
  for (const auto& [name, value] : json.items()) {
    if (name == "fps") {
      path.frames_per_second_ =
          SCREE_TRY(read_number(value, "fps", 1e-9, 1e6, "frames per second, above 0 and below 1e6"));
    } else if (name != "format" && name != "version" && name != "keys" && name != "name") {
      return Error{ErrorCode::kFormat,
                   "has an unknown member " + in_quotes(name) + "; a path has format, version, fps, keys, name"};
    }
  }
  if (frames_per_second) path.frames_per_second_ = *frames_per_second;
  if (!json.contains("keys") || !json["keys"].is_array() || json["keys"].empty())
    return Error{ErrorCode::kFormat, "\"keys\" is not a list of at least one key"};
  const Json& keys = json["keys"];
  bool have_t = false;
  for (size_t i = 0; i < keys.size(); ++i) {
    const auto at_key = [&](const Error& error) {
      return Error{error.code, "key " + std::to_string(i) + ": " + error.message};
    };
    bool has_t = false;
    Result<PathKey> key = read_key(keys[i], has_t);
    if (!key) return at_key(key.error());
    if (i == 0) have_t = has_t;
    if (has_t != have_t)
      return at_key(
          {ErrorCode::kFormat, has_t ? "has a \"t\", but key 0 has none" : "has no \"t\", but key 0 has one"});
    if (!has_t) key->t = static_cast<double>(i) / path.frames_per_second_;
    if (i > 0 && !(key->t > path.keys_.back().t))
      return at_key({ErrorCode::kRange, "its \"t\" is not later than that of the key before"});
    path.keys_.push_back(*key);
  }
  const auto [narrowest, widest] =
      std::minmax_element(path.keys_.begin(), path.keys_.end(),
                          [](const PathKey& a, const PathKey& b) { return a.fov_degrees < b.fov_degrees; });
  path.narrowest_ = narrowest->fov_degrees;
  path.widest_ = widest->fov_degrees;
  if (!(path.keys_.back().t * path.frames_per_second_ < static_cast<double>(kMaxPathFrames)))
    return Error{ErrorCode::kRange, "has more than " + std::to_string(kMaxPathFrames) + " frames"};
  return path;
}

Result<CameraPath> CameraPath::read(const std::string& path, std::optional<double> frames_per_second) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return Error{ErrorCode::kFile, path + ": cannot be opened: " + std::strerror(errno)};
  std::string text;
  try {
    text.resize(kMaxPathBytes + 1);
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    if (file.bad()) return Error{ErrorCode::kFile, path + ": cannot be read"};
    text.resize(static_cast<size_t>(file.gcount()));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to read it"};
  }
  if (text.size() > kMaxPathBytes)
    return Error{ErrorCode::kRange, path + ": has more than " + std::to_string(kMaxPathBytes >> 20) + " MiB"};
  CameraPath parsed = SCREE_TRY_AT(path, parse(text, frames_per_second));
  return parsed;
}

uint64_t CameraPath::frame_count() const {
  // A last key at 2.1 s and 30 frames per second is frame 63, although the product may be 62.999999999999993.
  return static_cast<uint64_t>(keys_.back().t * frames_per_second_ * (1 + 1e-12)) + 1;
}

PathKey CameraPath::at(uint64_t frame) const {
  const double time = static_cast<double>(frame) / frames_per_second_;
  const auto after = std::upper_bound(keys_.begin(), keys_.end(), time,
                                      [](double moment, const PathKey& key) { return moment < key.t; });
  PathKey out;
  if (after == keys_.begin() || after == keys_.end()) {
    out = after == keys_.begin() ? keys_.front() : keys_.back();
  } else {
    const auto index = static_cast<size_t>(after - keys_.begin()) - 1;
    const PathKey& b = keys_[index];
    const PathKey& c = keys_[index + 1];
    const PathKey& a = keys_[index > 0 ? index - 1 : 0];
    const PathKey& d = keys_[std::min(index + 2, keys_.size() - 1)];
    const double t = (time - b.t) / (c.t - b.t);
    const auto curve = [&](double p, double q, double r, double s) {
      return 0.5 * (2 * q + (r - p) * t + (2 * p - 5 * q + 4 * r - s) * t * t + (3 * q - p - 3 * r + s) * t * t * t);
    };
    for (size_t i = 0; i < 3; ++i) {
      out.eye[i] = curve(a.eye[i], b.eye[i], c.eye[i], d.eye[i]);
      out.target[i] = curve(a.target[i], b.target[i], c.target[i], d.target[i]);
      out.up[i] = curve(a.up[i], b.up[i], c.up[i], d.up[i]);
    }
    out.fov_degrees =
        std::clamp(curve(a.fov_degrees, b.fov_degrees, c.fov_degrees, d.fov_degrees), narrowest_, widest_);
  }
  out.t = time;
  return out;
}

}  // namespace scree::tools
