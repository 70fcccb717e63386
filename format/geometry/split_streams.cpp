#include "format/geometry/split_streams.h"

#include <algorithm>
#include <string>

#include "format/bytes.h"
#include "format/geometry/cluster_layout.h"

namespace scree::format::split_streams {
namespace {

using enum ErrorCode;

/// The sum of `count` over all bytes; it returns at most kMost.
template <uint32_t kMost = 1, class Count>
uint64_t sum_over(std::span<const std::byte> bytes, const Count& count) {
  uint64_t sum = 0;
  while (!bytes.empty()) {
    const std::span<const std::byte> some = bytes.first(std::min<size_t>(bytes.size(), 255 / kMost));
    uint8_t part = 0;  // a byte, so that the compiler counts many at a time
    for (const std::byte byte : some) part = static_cast<uint8_t>(part + count(std::to_integer<uint8_t>(byte)));
    sum += part;
    bytes = bytes.subspan(some.size());
  }
  return sum;
}

/// The ones of a byte, by shifts that the compiler can vectorise.
constexpr uint8_t ones_of(uint8_t byte) {
  const auto pairs = static_cast<uint8_t>(byte - (byte >> 1 & 0x55));
  const auto fours = static_cast<uint8_t>((pairs & 0x33) + (pairs >> 2 & 0x33));
  return static_cast<uint8_t>((fours + (fours >> 4)) & 15);
}

/// Takes parts off the front of the streams.
class PartLocator {
 public:
  PartLocator(std::span<const std::byte> split, const SplitStreams& streams) : split_(split), streams_(streams) {}

  /// Returns whether there was a whole part.
  bool take(SplitPart& part) {
    for (uint32_t i = 0; i < kStreams; ++i)
      part.first[i] = static_cast<uint32_t>(streams_.bytes[i].data() - split_.data() + taken_[i]);
    for (const Stream stream : {kLow, kHigh, kTall, kFar}) part.first[stream] = static_cast<uint32_t>(taken_[stream]);
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
    const bool has_high = !streams_.bytes[kHigh].empty();
    for (uint32_t i = 0; i < kStreams; ++i) {
      const uint64_t there = i == kLow    ? streams_.residual_count()
                             : i == kTall ? streams_.tall_count()
                             : i == kFar  ? streams_.far_count()
                                          : streams_.bytes[i].size();
      if (taken_[i] != there && (i != kHigh || has_high)) return false;
    }
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
    uint64_t all_triangles = 0, all_vertices = 0, slopes = 0, fresh_bytes = 0;
    uint32_t bad = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const auto triangle = std::to_integer<uint32_t>(triangles[i]);
      const auto vertex = std::to_integer<uint32_t>(vertices[i]);
      const auto form = std::to_integer<uint32_t>(forms[i]);
      bad |= ((triangle | vertex) & 0x80) | (form & 0xc0);
      all_triangles += triangle + 1;
      all_vertices += vertex + 1;
      slopes += (form >> 4 & 3) != kNotPredicted ? 4u : 0u;
      fresh_bytes += bytes_of_bits(vertex + 1);
    }
    if (bad != 0 || !has(kGates, all_triangles) || !has(kFresh, fresh_bytes)) return false;
    const std::span<const std::byte> gates(at(kGates), all_triangles);
    if (largest_of(gates) >= kExplicitGate + 4) return false;
    const uint64_t explicit_count = sum_over(gates, [](uint8_t gate) { return gate / kExplicitGate; });
    const std::byte* const fresh = at(kFresh);
    uint64_t end = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const auto last = std::to_integer<uint32_t>(vertices[i]);
      end += bytes_of_bits(last + 1);
      bad |= std::to_integer<uint32_t>(fresh[end - 1]) >> (last % 8 + 1);
    }
    const uint64_t residuals = sum_over<8>({fresh, fresh_bytes}, ones_of);
    if (bad != 0 || residuals > streams_.residual_count() - taken_[kLow]) return false;
    const uint64_t references = all_vertices - residuals;
    if (!has(kReferences, references)) return false;
    const uint64_t far =
        sum_over({at(kReferences), references}, [](uint8_t reference) { return reference == kFarReference; });
    if (far > streams_.far_count() - taken_[kFar] || !take_high(residuals)) return false;
    taken_[kFar] += far;
    taken_[kLow] += residuals;
    part.triangle_count = all_triangles;
    part.vertex_count = all_vertices;
    return take(kTriangles, count) && take(kVertices, count) && take(kForms, count) && take(kSlopes, slopes) &&
           take(kGates, all_triangles) && take(kDistances, 2 * explicit_count) && take(kFresh, fresh_bytes) &&
           take(kReferences, references);
  }

  /// Takes the high bits of residuals, and their tall codes. Returns whether they are all there.
  bool take_high(uint64_t residuals) {
    const std::span<const std::byte> all = streams_.bytes[kHigh];
    const std::span<const std::byte> high = all.empty() ? all : all.subspan(taken_[kHigh], residuals);
    if (largest_of(high) >> 6 != 0) return false;
    static_assert(kTallCode == 3);
    const uint64_t tall = sum_over<3>(high, [](uint8_t bits) {
      const uint32_t axes = bits & bits >> 1 & 0x15u;  // a bit per axis
      return (axes & 1) + (axes >> 2 & 1) + (axes >> 4);
    });
    if (tall > streams_.tall_count() - taken_[kTall]) return false;
    taken_[kHigh] += residuals;
    taken_[kTall] += tall;
    return true;
  }

  std::span<const std::byte> split_;
  const SplitStreams& streams_;
  uint64_t taken_[kStreams] = {};  // bytes; of kLow and kHigh residuals, of kTall and kFar values
};

}  // namespace

Result<SplitStreams> open_streams(std::span<const std::byte> split) {
  SplitStreams streams;
  if (split.size() < kHeaderBytes) return Error{kTruncated, "no header"};
  streams.tall_bytes = load<uint32_t>(split.data());
  if (streams.tall_bytes < 1 || streams.tall_bytes > kMostTallBytes)
    return Error{kRange, "tall codes of " + std::to_string(streams.tall_bytes) + " bytes, expected 1 or 2"};
  uint64_t at = kHeaderBytes;
  for (uint32_t i = 0; i < kStreams; ++i) {
    const uint64_t bytes = load<uint32_t>(split.data() + 4 * (1 + uint64_t{i}));
    if (bytes > split.size() - at) return ends(i);
    if (i == kLow && bytes % 3 != 0) return Error{kTrailing, "part of a residual"};
    if (i == kHigh && bytes != 0 && bytes != streams.residual_count())
      return Error{kRange, "high bits of " + std::to_string(bytes) + " residuals, expected " +
                               std::to_string(streams.residual_count())};
    if (i == kTall && bytes % streams.tall_bytes != 0) return Error{kTrailing, "part of a tall code"};
    if (i == kFar && bytes % 2 != 0) return Error{kTrailing, "part of a far distance"};
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
  const auto offset_of = [&](Stream stream) {
    return static_cast<uint32_t>(streams->bytes[stream].data() - split.data());
  };
  StreamPlanes& planes = out.planes;
  planes.residual_count = static_cast<uint32_t>(streams->residual_count());
  planes.low = offset_of(kLow);
  planes.high = streams->bytes[kHigh].empty() ? 0 : offset_of(kHigh);
  planes.tall = offset_of(kTall);
  planes.tall_count = static_cast<uint32_t>(streams->tall_count());
  planes.tall_bytes = streams->tall_bytes;
  planes.far = offset_of(kFar);
  planes.far_count = static_cast<uint32_t>(streams->far_count());
  PartLocator locator(split, *streams);
  while (locator.has_part())
    if (!locator.take(out.parts.emplace_back())) return std::nullopt;
  if (!locator.is_done()) return std::nullopt;
  return out;
}

}  // namespace scree::format::split_streams
