#include "format/geometry/split_streams.h"

#include <algorithm>
#include <string>

#include "format/bytes.h"
#include "format/geometry/cluster_layout.h"

namespace scree::format::split_streams {
namespace {

using enum ErrorCode;

/// The numbers of vertices with a residual and with an entry in kFar.
struct PlaceCounts {
  uint64_t residuals = 0;
  uint64_t far = 0;
};

PlaceCounts count_places(std::span<const std::byte> places) {
  PlaceCounts counts;
  while (!places.empty()) {
    const std::span<const std::byte> some = places.first(std::min<size_t>(places.size(), 255));
    uint8_t residuals = 0;  // a byte each, so that the compiler counts many places at a time
    uint8_t far = 0;
    for (const std::byte place : some) {
      residuals = static_cast<uint8_t>(residuals + (place == std::byte{0}));
      far = static_cast<uint8_t>(far + (place == std::byte{kFarPlace}));
    }
    counts.residuals += residuals;
    counts.far += far;
    places = places.subspan(some.size());
  }
  return counts;
}

/// Takes parts off the front of the streams.
class PartLocator {
 public:
  PartLocator(std::span<const std::byte> split, const SplitStreams& streams) : split_(split), streams_(streams) {}

  /// Returns whether there was a whole part.
  bool take(SplitPart& part) {
    for (uint32_t i = 0; i < kStreams; ++i)
      part.first[i] = static_cast<uint32_t>(streams_.bytes[i].data() - split_.data() + taken_[i]);
    part.first[kResiduals] = static_cast<uint32_t>(taken_[kResiduals]);
    if (!has(kParts, 8)) return false;
    const std::byte* const counts = at(kParts);
    part.cluster_count = load<uint32_t>(counts);
    part.plain_bytes = load<uint32_t>(counts + 4);
    part.triangle_count = 0;
    part.vertex_count = 0;
    taken_[kParts] += 8;
    if (part.cluster_count != 0 && !take_clusters(part)) return false;
    return take(kPlain, part.plain_bytes);
  }

  bool is_done() const {
    for (uint32_t i = 0; i < kStreams; ++i)
      if (taken_[i] != (i == kResiduals ? streams_.residual_count() : streams_.bytes[i].size())) return false;
    return true;
  }
  bool has_part() const { return taken_[kParts] != streams_.bytes[kParts].size(); }

 private:
  bool has(Stream stream, uint64_t bytes) const { return bytes <= streams_.bytes[stream].size() - taken_[stream]; }
  const std::byte* at(Stream stream) const { return streams_.bytes[stream].data() + taken_[stream]; }
  bool take(Stream stream, uint64_t bytes) {
    if (!has(stream, bytes)) return false;
    taken_[stream] += bytes;
    return true;
  }

  bool take_clusters(SplitPart& part) {
    const uint32_t count = part.cluster_count;
    if (!has(kTriangles, count) || !has(kVertices, count) || !has(kForms, count)) return false;
    const std::byte* const triangles = at(kTriangles);
    const std::byte* const vertices = at(kVertices);
    const std::byte* const forms = at(kForms);
    uint64_t all_triangles = 0, all_vertices = 0, slopes = 0, steps = 0, distances = 0;
    uint32_t bad = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const auto triangle = std::to_integer<uint32_t>(triangles[i]);
      const auto vertex = std::to_integer<uint32_t>(vertices[i]);
      const auto form = std::to_integer<uint32_t>(forms[i]);
      bad |= ((triangle | vertex) & 0x80) | (form & 0xc0);
      all_triangles += triangle + 1;
      all_vertices += vertex + 1;
      slopes += (form >> 4 & 3) != kNotPredicted ? 4u : 0u;
      steps += (triangle / 8 + 1) << (form >> 3 & 1);
      distances += (triangle + 1) << ((form & 7) > kShortDistance ? 1 : 0);
    }
    if (bad != 0 || !has(kPlaces, all_vertices)) return false;
    const PlaceCounts places = count_places({at(kPlaces), all_vertices});
    if (places.residuals > streams_.residual_count() - taken_[kResiduals]) return false;
    taken_[kResiduals] += places.residuals;
    part.triangle_count = all_triangles;
    part.vertex_count = all_vertices;
    return take(kTriangles, count) && take(kVertices, count) && take(kForms, count) && take(kSlopes, slopes) &&
           take(kSteps, steps) && take(kDistances, distances) && take(kPlaces, all_vertices) &&
           take(kFar, 2 * places.far);
  }

  std::span<const std::byte> split_;
  const SplitStreams& streams_;
  uint64_t taken_[kStreams] = {};  // bytes; residuals
};

}  // namespace

Result<SplitStreams> open_streams(std::span<const std::byte> split) {
  SplitStreams streams;
  if (split.size() < kHeaderBytes) return Error{kTruncated, "no header"};
  streams.planes = load<uint32_t>(split.data());
  if (streams.planes < 1 || streams.planes > kMaxPlanes)
    return Error{kRange, "residuals of " + std::to_string(streams.planes) + " bytes, expected 1 to 3"};
  uint64_t at = kHeaderBytes;
  for (uint32_t i = 0; i < kStreams; ++i) {
    const uint64_t bytes = load<uint32_t>(split.data() + 4 * (1 + uint64_t{i}));
    if (bytes > split.size() - at) return ends(i);
    if (i == kResiduals && bytes % (3 * streams.planes) != 0) return Error{kTrailing, "part of a residual"};
    streams.bytes[i] = split.subspan(at, bytes);
    at += bytes;
  }
  if (at != split.size()) return Error{kTrailing, "bytes after the last stream"};
  return streams;
}

Error ends(uint32_t stream) {
  return Error{kTruncated, std::string("its ") + kNames[stream] + " end early"};
}

std::optional<SplitParts> locate_parts(std::span<const std::byte> split) {
  if (split.size() > UINT32_MAX) return std::nullopt;
  const Result<SplitStreams> streams = open_streams(split);
  if (!streams) return std::nullopt;
  SplitParts out;
  out.planes = streams->planes;
  out.residual_count = static_cast<uint32_t>(streams->residual_count());
  out.residuals = static_cast<uint32_t>(streams->bytes[kResiduals].data() - split.data());
  PartLocator locator(split, *streams);
  while (locator.has_part())
    if (!locator.take(out.parts.emplace_back())) return std::nullopt;
  if (!locator.is_done()) return std::nullopt;
  return out;
}

}  // namespace scree::format::split_streams
