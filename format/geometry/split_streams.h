// The streams of a split page, and its parts, which can be joined side by side. Source: spec/codecs.md, split pages.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/hd.h"
#include "format/result.h"

namespace scree::format::split_streams {

enum Stream : uint32_t {
  kParts,       // number of clusters, number of plain bytes, and so on alternating, u32 each
  kTriangles,   // a byte per cluster: triangles less one
  kVertices,    // a byte per cluster: vertices less one
  kForms,       // a byte per cluster: distance bits 0 to 2, wide steps 3, predicted axis 4 and 5
  kSlopes,      // of clusters with a prediction: i16 each
  kGates,       // a byte per triangle (split_triangles.h)
  kDistances,   // of triangles with an explicit gate: a byte each
  kFresh,       // a bit per vertex of a cluster, whole bytes: it has a residual
  kReferences,  // of the other vertices, a byte each: the step to an equal earlier vertex, or kFarReference
  kFar,         // how many vertices back the equal vertex is: low bytes, then high bytes
  kLow,         // low bytes of the residuals: of x, of y, of z
  kHigh,        // a byte per residual: two bits per axis, the rest of its code if below kTallCode; empty if all are 0
  kTall,        // the rest of each code that is not: low bytes, then high bytes
  kPlain,       // bytes outside clusters
  kStreams,
};
inline constexpr const char* kNames[kStreams] = {"parts",     "triangles", "vertices",   "forms",      "slopes",
                                                 "gates",     "distances", "fresh bits", "references", "far",
                                                 "low bytes", "high bits", "tall bytes", "plain"};

// A split page begins with the number of bytes per tall code and the sizes of the streams.
inline constexpr uint64_t kHeaderBytes = 4 * (1 + uint64_t{kStreams});
inline constexpr uint32_t kMostTallBytes = 2;  // residuals are modulo 2^24
inline constexpr uint32_t kTallCode = 3;
inline constexpr uint32_t kExplicitGate = 128;  // plus the step
inline constexpr uint32_t kFarReference = 255;
inline constexpr uint32_t kMostBack = 65535;  // vertices

/// Bytes of a bit each.
SCREE_HD constexpr uint32_t bytes_of_bits(uint32_t bits) {
  return (bits + 7) / 8;
}

/// The bytes of each stream.
struct SplitStreams {
  uint32_t tall_bytes = 1;  // per tall code
  std::span<const std::byte> bytes[kStreams];

  uint64_t residual_count() const { return bytes[kLow].size() / 3; }
  uint64_t tall_count() const { return bytes[kTall].size() / tall_bytes; }
  uint64_t far_count() const { return bytes[kFar].size() / 2; }
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
  // Offset of its first value in the split page; of kLow and kHigh: number of its first residual; of kTall and kFar:
  // number of its first value.
  uint32_t first[kStreams];
};

/// Where the streams of a split page lie whose values are apart, byte by byte. Offsets in the page.
struct StreamPlanes {
  uint32_t residual_count = 0;
  uint32_t low = 0;
  uint32_t high = 0;  // 0: there are no high bits
  uint32_t tall = 0;
  uint32_t tall_count = 0;
  uint32_t tall_bytes = 1;
  uint32_t far = 0;
  uint32_t far_count = 0;
};

/// All parts of a split page.
struct SplitParts {
  StreamPlanes planes;
  std::vector<SplitPart> parts;
};

/// The largest of the bytes; 0 if there are none.
inline uint8_t largest_of(std::span<const std::byte> bytes) {
  uint8_t largest = 0;
  for (const std::byte byte : bytes) largest = std::max(largest, std::to_integer<uint8_t>(byte));
  return largest;
}

/// Finds the parts, by counting what their clusters take of each stream. nullopt: join_page() would refuse the page's
/// streams or set bits that are reserved, or the page has 4 GiB or more. If it returns parts, the values of every
/// cluster are there. Throws std::bad_alloc.
std::optional<SplitParts> locate_parts(std::span<const std::byte> split);

}  // namespace scree::format::split_streams
