// A camera that moves: the key frames of a path, as `scree view` saves them and people write them (docs/scale.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"
#include "runtime/scene/camera.h"

namespace scree::tools {

inline constexpr uint64_t kMaxPathBytes = uint64_t{16} << 20;  // about 100,000 keys
inline constexpr uint64_t kMaxPathFrames = 10000000;           // four days at 30 a second
inline constexpr double kDefaultFramesPerSecond = 30;

/// Where the camera is at one time.
struct PathKey {
  double t = 0;  // seconds
  runtime::Vec3 eye{};
  runtime::Vec3 target{};
  runtime::Vec3 up{0, 1, 0};
  double fov_degrees = runtime::kDefaultFovDegrees;  // vertical, above 0 and below 180
};

class CameraPath {
 public:
  /// A JSON text: {"format": "scree camera path", "version": 1, "fps": 30, "keys": [...]}, where "fps" may be left out.
  /// A key has "eye", "target" and where wanted "up" and "fov", or "matrix": 16 numbers, column by column, from camera
  /// to world, as a glTF node's. All keys have "t", which rises, or none has: key i is then frame i. Every number of a
  /// path is finite. Safe on any bytes. Errors kFormat (malformed: with its line; a member that is missing, unknown or
  /// of another kind), kRange (a number outside its limits, more than kMaxPathFrames), kVersion; keys count from 0.
  /// `frames_per_second`: above 0, instead of the file's.
  static Result<CameraPath> parse(std::string_view text, std::optional<double> frames_per_second = {});

  /// parse() of a file of at most kMaxPathBytes; its errors name the file, kFile too.
  static Result<CameraPath> read(const std::string& path, std::optional<double> frames_per_second = {});

  double frames_per_second() const { return frames_per_second_; }

  /// From time 0 to the last key, both included: at least 1.
  uint64_t frame_count() const;

  /// The camera at frame / frames_per_second() seconds: eyes, targets, ups and fields of view are joined by Catmull-Rom
  /// curves, each through its two keys with the slopes of the keys around them (the first and the last key are their
  /// own neighbours); before the first key and after the last the camera stands still. A field of view keeps within
  /// those of all keys. The bits are the same on every machine. `frame`: below frame_count().
  PathKey at(uint64_t frame) const;

 private:
  std::vector<PathKey> keys_;  // by rising t
  double frames_per_second_ = kDefaultFramesPerSecond;
  double narrowest_ = 0;  // of the fields of view
  double widest_ = 0;
};

}  // namespace scree::tools
