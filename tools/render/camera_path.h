// A moving camera: the key frames of a path, as saved by `scree view` or written by hand (docs/scale.md).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"
#include "runtime/scene/camera.h"

namespace scree::tools {

inline constexpr uint64_t kMaxPathBytes = uint64_t{16} << 20;  // about 100,000 keys
inline constexpr uint64_t kMaxPathFrames = 10000000;           // four days at 30 frames per second
inline constexpr double kDefaultFramesPerSecond = 30;

/// The camera at one time.
struct PathKey {
  double t = 0;  // seconds
  runtime::Vec3 eye{};
  runtime::Vec3 target{};
  runtime::Vec3 up{0, 1, 0};
  double fov_degrees = runtime::kDefaultFovDegrees;  // vertical, at least 1e-9 and below 180
};

class CameraPath {
 public:
  /// A JSON text: {"format": "scree camera path", "version": 1, "fps": 30, "keys": [...]}, where "fps" is optional. A
  /// key has "eye" and "target" and optionally "up", or instead "matrix": 16 numbers, column by column, from camera to
  /// world, like the matrix of a glTF node. "fov" is optional. Either all keys have a rising "t", or none has one and
  /// key i is frame i. Every number of a path is finite. Safe on any bytes. Errors: kFormat (malformed, with the line;
  /// a member that is missing, unknown or of the wrong type), kRange (a number outside its limits, more than
  /// kMaxPathFrames frames), kVersion. They number keys from 0. `frames_per_second`: above 0; replaces the value in the
  /// file.
  static Result<CameraPath> parse(std::string_view text, std::optional<double> frames_per_second = {});

  /// parse() for a file of at most kMaxPathBytes. Errors name the file; also kFile.
  static Result<CameraPath> read(const std::string& path, std::optional<double> frames_per_second = {});

  double frames_per_second() const { return frames_per_second_; }

  /// The number of frames from time 0 to the last key, both included; at least 1.
  uint64_t frame_count() const;

  /// The camera at frame / frames_per_second() seconds: eyes, targets, up vectors and fields of view are interpolated
  /// by Catmull-Rom curves between two keys, with slopes from the keys around them (the first and the last key are
  /// their own neighbours). Before the first key and after the last one the camera stands still. The field of view
  /// stays within the range of all keys. The result is the same on every machine, bit for bit. `frame`: below
  /// frame_count().
  PathKey at(uint64_t frame) const;

 private:
  std::vector<PathKey> keys_;  // by rising t
  double frames_per_second_ = kDefaultFramesPerSecond;
  double narrowest_ = 0;  // the smallest field of view
  double widest_ = 0;
};

}  // namespace scree::tools
