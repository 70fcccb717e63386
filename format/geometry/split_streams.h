// The streams of a split page, and its parts, which can be joined side by side. Source: spec/codecs.md, split pages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::format::split_streams {

enum Stream : uint32_t {
  kParts,      // number of clusters, number of plain bytes, and so on alternating, u32 each
  kTriangles,  // a byte per cluster: triangles less one
  kVertices,   // a byte per cluster: vertices less one
  kForms,      // a byte per cluster: distance bits 0 to 2, wide steps 3, predicted axis 4 and 5
  kSlopes,     // of clusters with a prediction: i16 each
  kSteps,      // low bits of a cluster's steps, then high bits if wide: whole bytes
  kDistances,  // both distances of each triangle: one byte, the first in its low half; a byte each if over 4 bits
  kPlaces,     // per vertex: 0 it has a residual, 1 to 254 the step to an equal earlier vertex, 255 it is in kFar
  kFar,        // u16: how many vertices back the equal vertex is
  kResiduals,  // of vertices with place 0: low bytes of x, of y, of z, then the next byte of each, and so on
  kPlain,      // bytes outside clusters
  kStreams,
};
inline constexpr const char* kNames[kStreams] = {"parts",     "triangles", "vertices", "forms",     "slopes", "steps",
                                                 "distances", "places",    "far",      "residuals", "plain"};

// A split page begins with the number of bytes per residual and the sizes of the streams.
inline constexpr uint64_t kHeaderBytes = 4 * (1 + uint64_t{kStreams});
inline constexpr uint32_t kMaxPlanes = 3;      // residuals are modulo 2^24
inline constexpr uint32_t kShortDistance = 4;  // distances of at most this many bits take half a byte
inline constexpr uint32_t kFarPlace = 255;
inline constexpr uint32_t kMostBack = 65535;  // vertices

/// The bytes of each stream.
struct SplitStreams {
  uint32_t planes = 0;  // bytes per residual
  std::span<const std::byte> bytes[kStreams];

  uint64_t residual_count() const { return bytes[kResiduals].size() / (3 * planes); }
};

/// Finds the streams. Errors kTruncated, kTrailing, kRange.
Result<SplitStreams> open_streams(std::span<const std::byte> split);

/// The error of a stream that ends early.
Error ends(uint32_t stream);

/// Clusters of a chunk and the plain bytes after them. No part needs values of another one.
struct SplitPart {
  uint32_t cluster_count;  // 0: plain bytes only
  uint32_t plain_bytes;
  uint64_t triangle_count;
  uint64_t vertex_count;
  uint32_t first[kStreams];  // offset of its first value in the split page; of residuals: the number of the first
};

/// All parts of a split page.
struct SplitParts {
  uint32_t planes = 0;
  uint32_t residual_count = 0;
  uint32_t residuals = 0;  // offset of the stream in the split page
  std::vector<SplitPart> parts;
};

/// Finds the parts, by counting what their clusters take of each stream. nullopt: join_page() would refuse the page's
/// streams or forms, or the page has 4 GiB or more. If it returns parts, the values of every cluster are there. Throws
/// std::bad_alloc.
std::optional<SplitParts> locate_parts(std::span<const std::byte> split);

}  // namespace scree::format::split_streams
