#include "format/geometry/cluster_page.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstring>
#include <memory>
#include <new>
#include <string>

#include "format/bitpack.h"
#include "format/bytes.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_read.h"
#include "format/geometry/vertex_predictor.h"
#include "format/geometry/word_writer.h"

namespace scree::format {
namespace {

using enum ErrorCode;

enum Stream : uint32_t {
  kParts,      // numbers of clusters and of plain bytes, alternating, u32 each
  kTriangles,  // a byte per cluster: triangles less one
  kVertices,   // a byte per cluster: vertices less one
  kForms,      // a byte per cluster: distance bits 0 to 2, wide steps 3, predicted axis 4 and 5
  kSlopes,     // of clusters with a prediction: i16 each
  kSteps,      // low bits of a cluster's steps, then high bits if wide: whole bytes
  kDistances,  // per triangle both distances: one byte, the first in its low half, or a byte each if over 4 bits
  kPlaces,     // per vertex: 0 it has a residual, 1 to 254 the step to an equal earlier vertex, 255 it is in kFar
  kFar,        // u16: how many vertices back the equal vertex is
  kResiduals,  // of vertices with place 0: low bytes of x, of y, of z, then the next byte of each, and so on
  kPlain,      // bytes outside clusters
  kStreams,
};
constexpr const char* kNames[kStreams] = {"parts",     "triangles", "vertices", "forms",     "slopes", "steps",
                                          "distances", "places",    "far",      "residuals", "plain"};

// A split page begins with the number of bytes per residual and the sizes of the streams.
constexpr uint64_t kHeaderBytes = 4 * (1 + uint64_t{kStreams});
constexpr uint32_t kMaxPlanes = 3;  // residuals are modulo 2^24
constexpr int32_t kOffsetMask = (1 << 24) - 1;
constexpr Offsets kOrigin = {0, 0, 0, 0};
constexpr Offsets kOffsetMasks = {kOffsetMask, kOffsetMask, kOffsetMask, 0};
constexpr uint32_t kShortDistance = 4;  // distances of at most this many bits take half a byte
constexpr uint32_t kFarPlace = 255;
constexpr uint32_t kMostBack = 65535;  // vertices

uint32_t zigzag(uint32_t value) {
  return value << 1 ^ static_cast<uint32_t>(static_cast<int32_t>(value) >> 31);
}
uint32_t unzigzag(uint32_t code) {
  return code >> 1 ^ (0u - (code & 1));
}

/// The header of a cluster in a split page.
struct Form {
  uint32_t triangle_count;
  uint32_t vertex_count;
  uint32_t distance_bits;
  bool wide_steps;
  uint32_t axis;  // predicted, or kNotPredicted
};

/// The vertices of a part, back to the oldest that can be referred to.
class RecentVertices {
 public:
  void clear() { count_ = 0; }
  uint32_t count() const { return count_; }
  void add(const Offsets& offsets) { ring_[count_++ & kMostBack] = offsets; }
  /// `number`: one of the last kMostBack.
  Offsets at(uint32_t number) const { return ring_[number & kMostBack]; }

 private:
  uint32_t count_ = 0;
  Offsets ring_[kMostBack + 1];
};

Error broken(ErrorCode code, const std::string& what) {
  return Error{code, "split page: " + what};
}

/// Reads values from a stream.
class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> bytes = {}) : at_(bytes.data()), left_(bytes.size()) {}

  /// The next `bytes` bytes, or null if fewer are left.
  const std::byte* take(uint64_t bytes) {
    if (left_ < bytes) return nullptr;
    const std::byte* from = at_;
    at_ += bytes;
    left_ -= bytes;
    return from;
  }
  uint64_t left() const { return left_; }

 private:
  const std::byte* at_;
  uint64_t left_;
};

/// Memory that joining needs beside the page.
struct JoinMemory {
  RecentVertices recent;
  VertexPredictor predictor;
};

class Joiner {
 public:
  Joiner(std::span<std::byte> page, JoinMemory& memory) : page_(page), memory_(memory) {}

  Result<void> run(std::span<const std::byte> split) {
    if (const auto opened = open(split); !opened) return opened;
    while (in_[kParts].left() != 0) {
      const std::byte* part = in_[kParts].take(8);
      if (part == nullptr) return broken(kTruncated, "half a part");
      const auto clusters = load<uint32_t>(part);
      if (clusters != 0)
        if (const auto joined = join_part(clusters); !joined) return joined;
      const uint64_t plain = load<uint32_t>(part + 4);
      const std::byte* from = in_[kPlain].take(plain);
      if (from == nullptr) return ends(kPlain);
      if (const auto room = make_room(plain); !room) return room;
      if (plain != 0) std::memcpy(page_.data() + done_, from, plain);
      done_ += plain;
    }
    if (done_ != page_.size()) {
      return broken(kTruncated,
                    "it makes " + std::to_string(done_) + " bytes, expected " + std::to_string(page_.size()));
    }
    for (uint32_t i = 0; i < kStreams; ++i) {
      const uint64_t left = i == kResiduals ? (residual_count_ - residual_) : in_[i].left();
      if (left != 0) return broken(kTrailing, std::string("bytes of ") + kNames[i] + " are left over");
    }
    return {};
  }

 private:
  Result<void> open(std::span<const std::byte> split) {
    if (split.size() < kHeaderBytes) return broken(kTruncated, "no header");
    planes_ = load<uint32_t>(split.data());
    if (planes_ < 1 || planes_ > kMaxPlanes)
      return broken(kRange, "residuals of " + std::to_string(planes_) + " bytes, expected 1 to 3");
    uint64_t at = kHeaderBytes;
    for (uint32_t i = 0; i < kStreams; ++i) {
      const uint64_t bytes = load<uint32_t>(split.data() + 4 * (1 + uint64_t{i}));
      if (bytes > split.size() - at) return ends(i);
      in_[i] = Cursor(split.subspan(at, bytes));
      if (i == kResiduals) {
        if (bytes % (3 * planes_) != 0) return broken(kTrailing, "part of a residual");
        residual_count_ = bytes / (3 * planes_);
        residuals_ = split.data() + at;
      }
      at += bytes;
    }
    if (at != split.size()) return broken(kTrailing, "bytes after the last stream");
    return {};
  }

  static Error ends(uint32_t stream) { return broken(kTruncated, std::string("its ") + kNames[stream] + " end early"); }

  Result<void> make_room(uint64_t bytes) const {
    if (bytes <= page_.size() - done_) return {};
    return broken(kTrailing, "it makes more than the page's " + std::to_string(page_.size()) + " bytes");
  }

  /// Writes the four streams of a chunk of clusters.
  Result<void> join_part(uint64_t clusters) {
    const uint64_t groups = group_count(clusters);
    const uint64_t head = (groups + clusters) * sizeof(ClusterBounds) + clusters * sizeof(ClusterRecord);
    if (const auto room = make_room(head); !room) return room;
    std::byte* const group_bounds = page_.data() + done_;
    std::byte* const bounds = group_bounds + groups * sizeof(ClusterBounds);
    std::byte* const records = bounds + clusters * sizeof(ClusterBounds);
    done_ += head;
    const uint64_t data = done_;
    memory_.recent.clear();
    named_ = 0;
    first_ = kOrigin;
    ClusterRecord next{};
    OffsetBox group{};
    for (uint64_t i = 0; i < clusters; ++i) {
      ClusterRecord record = next;
      OffsetBox box;
      const Result<uint32_t> words = join_cluster(record, box);
      if (!words) return words.error();
      store(records + i * sizeof record, record);
      const uint32_t origin[3] = {};
      store(bounds + i * sizeof(ClusterBounds), bounds_of(box, origin));
      if (i % kGroupClusters == 0) group = box;
      for (size_t axis = 0; axis < 3; ++axis) {
        group.min[axis] = std::min(group.min[axis], box.min[axis]);
        group.max[axis] = std::max(group.max[axis], box.max[axis]);
      }
      if (i % kGroupClusters == kGroupClusters - 1 || i + 1 == clusters)
        store(group_bounds + i / kGroupClusters * sizeof(ClusterBounds), bounds_of(group, origin));
      next.place += *words;
      if (next.place >= kMaxClusterWords) return broken(kRange, "more than 2^29 words of a chunk");
      next.first_triangle += form_.triangle_count;
      next.first_vertex += form_.vertex_count;
    }
    const uint64_t stream = packed_bytes(next.place, 32);
    done_ = data;
    if (const auto room = make_room(stream); !room) return room;
    std::fill(page_.begin() + static_cast<ptrdiff_t>(data + 4 * uint64_t{next.place}),
              page_.begin() + static_cast<ptrdiff_t>(data + stream), std::byte{0});
    done_ = data + stream;
    return {};
  }

  Result<void> take_form() {
    const std::byte* triangles = in_[kTriangles].take(1);
    const std::byte* vertices = in_[kVertices].take(1);
    const std::byte* form = in_[kForms].take(1);
    if (triangles == nullptr) return ends(kTriangles);
    if (vertices == nullptr) return ends(kVertices);
    if (form == nullptr) return ends(kForms);
    const auto bits = std::to_integer<uint32_t>(*form);
    form_.triangle_count = std::to_integer<uint32_t>(*triangles) + 1;
    form_.vertex_count = std::to_integer<uint32_t>(*vertices) + 1;
    form_.distance_bits = bits & 7;
    form_.wide_steps = (bits >> 3 & 1) != 0;
    form_.axis = bits >> 4 & 3;
    if (bits >> 6 != 0) return broken(kReserved, "a reserved bit of a form is set");
    if (form_.triangle_count > kMaxClusterTriangles || form_.vertex_count > kMaxClusterVertices)
      return broken(kRange, "more than 128 triangles or vertices of a cluster");
    return {};
  }

  /// Writes the cluster's words to the page. Sets all fields of `record` except the sums over earlier clusters. Returns
  /// the number of words.
  Result<uint32_t> join_cluster(ClusterRecord& record, OffsetBox& box) {
    if (const auto taken = take_form(); !taken) return taken.error();
    std::array<uint32_t, kMostClusterWords + 1> words;
    uint32_t* at = words.data();
    if (form_.axis != kNotPredicted) at += 2;  // written at the end
    const Result<uint32_t*> steps_end = join_triangles(at);
    if (!steps_end) return steps_end.error();
    const uint32_t count = form_.vertex_count;
    Offsets smallest = memory_.predictor.at(0);
    Offsets largest = smallest;
    for (uint32_t v = 1; v < count; ++v) {
      const Offsets offsets = memory_.predictor.at(v);
      smallest = offsets < smallest ? offsets : smallest;
      largest = offsets > largest ? offsets : largest;
    }
    for (int axis = 0; axis < 3; ++axis) {
      box.min[axis] = static_cast<uint32_t>(smallest[axis]);
      box.max[axis] = static_cast<uint32_t>(largest[axis]);
    }
    const Result<uint32_t*> end = join_positions(box, words.data(), *steps_end, record);
    if (!end) return end.error();
    record.place |= form_.axis << 29 | (form_.wide_steps ? 1u << 31 : 0);
    record.counts |= (form_.triangle_count - 1) | (count - 1) << 7 | form_.distance_bits << 14;
    const auto written = static_cast<uint32_t>(*end - words.data());
    if (const auto room = make_room(4 * uint64_t{written}); !room) return room.error();
    std::memcpy(page_.data() + done_, words.data(), 4 * uint64_t{written});
    done_ += 4 * uint64_t{written};
    return written;
  }

  /// Writes steps and distances; the predictor places all vertices.
  Result<uint32_t*> join_triangles(uint32_t* words) {
    const uint32_t count = form_.triangle_count;
    const uint32_t bits = form_.distance_bits;
    const uint32_t step_bytes = (count + 7) / 8;
    const uint32_t step_words = (count + 31) / 32;
    uint32_t* const low = words;
    uint32_t* const high = words + step_words;
    uint32_t* const distances = form_.wide_steps ? high + step_words : high;
    std::fill(words, distances, 0u);
    const std::byte* steps = in_[kSteps].take((form_.wide_steps ? 2u : 1u) * step_bytes);
    if (steps == nullptr) return ends(kSteps);
    std::memcpy(low, steps, step_bytes);
    if (form_.wide_steps) std::memcpy(high, steps + step_bytes, step_bytes);
    const bool is_short = bits <= kShortDistance;
    const std::byte* pairs = in_[kDistances].take(is_short ? count : 2 * count);
    if (pairs == nullptr) return ends(kDistances);
    const std::byte* const places = in_[kPlaces].take(form_.vertex_count);
    if (places == nullptr) return ends(kPlaces);

    bool is_good = true;
    const auto place = [&](uint32_t vertex, const Offsets& expected) {
      return place_vertex(std::to_integer<uint32_t>(places[vertex]), expected, is_good);
    };
    VertexPredictor& predictor = memory_.predictor;
    predictor.begin(bits, first_);
    uint32_t largest = 2;
    for (uint32_t i = 0; i < count; ++i) {
      largest += low[i / 32] >> (i % 32) & 1;
      if (form_.wide_steps) largest += 2 * (high[i / 32] >> (i % 32) & 1);
      uint32_t back[2];
      if (is_short) {
        const auto pair = std::to_integer<uint32_t>(pairs[i]);
        back[0] = pair & 15;
        back[1] = pair >> 4;
      } else {
        back[0] = std::to_integer<uint32_t>(pairs[2 * i]);
        back[1] = std::to_integer<uint32_t>(pairs[2 * i + 1]);
      }
      const uint32_t furthest = std::max(back[0], back[1]);
      if (largest >= form_.vertex_count || furthest > largest || furthest >> bits != 0)
        return broken(kRange, "a triangle with vertices that its cluster lacks");
      predictor.triangle(largest, back, place);
    }
    predictor.finish(form_.vertex_count, place);
    if (!is_good) return broken(kRange, "a vertex that is not there, or too few residuals");
    first_ = predictor.at(0);
    return put_distances(pairs, distances);
  }

  uint32_t* put_distances(const std::byte* pairs, uint32_t* words) const {
    const uint32_t bits = form_.distance_bits;
    WordWriter writer(words);
    for (uint32_t i = 0; i < form_.triangle_count; ++i) {
      if (bits <= kShortDistance) {
        const auto pair = std::to_integer<uint32_t>(pairs[i]);
        writer.put((pair & 15) | pair >> 4 << bits, 2 * bits);
      } else {
        writer.put(std::to_integer<uint32_t>(pairs[2 * i]) | std::to_integer<uint32_t>(pairs[2 * i + 1]) << bits,
                   2 * bits);
      }
    }
    return writer.end_section();
  }

  /// The bytes of one plane of the next residual.
  Offsets residual_bytes(uint32_t plane) const {
    const std::byte* x = residuals_ + 3 * plane * residual_count_ + residual_;
    return Offsets{std::to_integer<int32_t>(x[0]), std::to_integer<int32_t>(x[residual_count_]),
                   std::to_integer<int32_t>(x[2 * residual_count_]), 0};
  }

  Offsets place_vertex(uint32_t place, const Offsets& expected, bool& is_good) {
    RecentVertices& recent = memory_.recent;
    Offsets offsets;
    if (place == 0) {
      if (residual_ == residual_count_) {
        is_good = false;
        return kOrigin;
      }
      Offsets codes = residual_bytes(0);
      for (uint32_t plane = 1; plane < planes_; ++plane)
        codes |= residual_bytes(plane) << static_cast<int32_t>(8 * plane);
      ++residual_;
      offsets = (expected + (codes >> 1 ^ -(codes & 1))) & kOffsetMasks;
    } else {
      uint32_t number = named_ + unzigzag(place - 1);
      if (place == kFarPlace) {
        const std::byte* far = in_[kFar].take(2);
        number = recent.count() - (far == nullptr ? 0u : load<uint16_t>(far));
      }
      const uint32_t back = recent.count() - number;
      if (back == 0 || back > std::min(recent.count(), kMostBack)) {
        is_good = false;
        return kOrigin;
      }
      named_ = number;
      offsets = recent.at(number);
    }
    recent.add(offsets);
    return offsets;
  }

  /// Writes the positions from `words` on, and the prediction to `prediction`.
  Result<uint32_t*> join_positions(const OffsetBox& box, uint32_t* prediction, uint32_t* words, ClusterRecord& record) {
    const uint32_t count = form_.vertex_count;
    Offsets codes[kMaxClusterVertices];
    Offsets origin{};
    uint32_t bits[3];
    for (int axis = 0; axis < 3; ++axis) {
      bits[axis] = static_cast<uint32_t>(std::bit_width(box.max[axis] - box.min[axis]));
      origin[axis] = static_cast<int32_t>(box.min[axis]);
    }
    for (uint32_t i = 0; i < count; ++i) codes[i] = memory_.predictor.at(i) - origin;
    if (form_.axis != kNotPredicted) {
      const uint32_t axis = form_.axis;
      const uint32_t u = (axis + 1) % 3;
      const uint32_t v = (axis + 2) % 3;
      const std::byte* slopes = in_[kSlopes].take(4);
      if (slopes == nullptr) return ends(kSlopes);
      if (std::max(bits[u], bits[v]) > kMaxPredictorBits)
        return broken(kRange, "a cluster too large to predict an axis");
      const auto slope_u = load<int16_t>(slopes);
      const auto slope_v = load<int16_t>(slopes + 2);
      int32_t smallest = INT32_MAX;
      int32_t largest = INT32_MIN;
      for (uint32_t i = 0; i < count; ++i) {
        codes[i][axis] -= (slope_u * codes[i][u] + slope_v * codes[i][v]) >> kPredictorShift;
        smallest = std::min(smallest, codes[i][axis]);
        largest = std::max(largest, codes[i][axis]);
      }
      for (uint32_t i = 0; i < count; ++i) codes[i][axis] -= smallest;
      bits[axis] = static_cast<uint32_t>(std::bit_width(static_cast<uint32_t>(largest - smallest)));
      if (bits[axis] > kMaxPositionBits) return broken(kRange, "more than 24 bits of an axis");
      prediction[0] = load<uint32_t>(slopes);
      prediction[1] = static_cast<uint32_t>(smallest);
    }
    record.counts |= bits[0] << 17 | bits[1] << 22 | bits[2] << 27;
    WordWriter writer(words);
    const auto code = [&codes](uint32_t i, int axis) { return static_cast<uint32_t>(codes[i][axis]); };
    if (bits[0] + bits[1] <= 32) {
      for (uint32_t i = 0; i < count; ++i) {
        writer.put(code(i, 0) | code(i, 1) << bits[0], bits[0] + bits[1]);
        writer.put(code(i, 2), bits[2]);
      }
    } else {
      for (uint32_t i = 0; i < count; ++i)
        for (int axis = 0; axis < 3; ++axis) writer.put(code(i, axis), bits[axis]);
    }
    return writer.end_section();
  }

  std::span<std::byte> page_;
  JoinMemory& memory_;
  uint64_t done_ = 0;  // bytes of the page
  std::array<Cursor, kStreams> in_;
  uint32_t planes_ = 0;
  const std::byte* residuals_ = nullptr;
  uint64_t residual_count_ = 0;
  uint64_t residual_ = 0;
  Form form_{};
  uint32_t named_ = 0;  // the vertex referred to last, numbered in the part
  Offsets first_{};     // first vertex of the cluster before
};

/// Splits clusters; the inverse of Joiner.
class Splitter {
 public:
  void part(const std::byte* payload, uint32_t clusters) {
    memory_.recent.clear();
    std::fill(latest_.begin(), latest_.end(), kNone);
    named_ = 0;
    first_ = kOrigin;
    const std::byte* const bounds = payload + group_count(clusters) * sizeof(ClusterBounds);
    const std::byte* const records = bounds + clusters * sizeof(ClusterBounds);
    const std::byte* const data = records + clusters * sizeof(ClusterRecord);
    for (uint64_t i = 0; i < clusters; ++i) {
      cluster(make_cluster_reader(load<ClusterRecord>(records + i * sizeof(ClusterRecord)),
                                  load<ClusterBounds>(bounds + i * sizeof(ClusterBounds)), data));
    }
  }

  void put_part(uint32_t clusters, std::span<const std::byte> plain) {
    put(kParts, clusters);
    put(kParts, static_cast<uint32_t>(plain.size()));
    out_[kPlain].insert(out_[kPlain].end(), plain.begin(), plain.end());
  }

  SplitPage finish() {
    uint32_t all = 0;
    for (const auto& residual : residuals_)
      for (const uint32_t code : residual) all |= code;
    const uint32_t planes = (static_cast<uint32_t>(std::bit_width(all | 1)) + 7) / 8;
    for (uint32_t plane = 0; plane < planes; ++plane)
      for (size_t axis = 0; axis < 3; ++axis)
        for (const auto& residual : residuals_) put(kResiduals, static_cast<uint8_t>(residual[axis] >> 8 * plane));
    SplitPage page;
    uint64_t bytes = kHeaderBytes;
    for (const auto& stream : out_) bytes += stream.size();
    page.bytes.resize(kHeaderBytes);
    page.bytes.reserve(bytes);
    store(page.bytes.data(), planes);
    for (uint32_t i = 0; i < kStreams; ++i) {
      store(page.bytes.data() + 4 * (1 + uint64_t{i}), static_cast<uint32_t>(out_[i].size()));
      const uint64_t ends = i == kResiduals ? 3 * planes : 1;
      for (uint64_t k = 1; k <= ends; ++k) page.stream_ends.push_back(page.bytes.size() + out_[i].size() * k / ends);
      page.bytes.insert(page.bytes.end(), out_[i].begin(), out_[i].end());
    }
    return page;
  }

 private:
  static constexpr uint32_t kSlotBits = 17;

  void put(Stream stream, uint8_t value) { out_[stream].push_back(std::byte{value}); }
  template <class T>
  void put(Stream stream, T value) {
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    out_[stream].insert(out_[stream].end(), bytes, bytes + sizeof value);
  }

  void cluster(const ClusterReader& reader) {
    const ClusterLayout& layout = reader.layout;
    put(kTriangles, static_cast<uint8_t>(layout.triangle_count - 1));
    put(kVertices, static_cast<uint8_t>(layout.vertex_count - 1));
    put(kForms, static_cast<uint8_t>(layout.distance_bits | (layout.wide_steps ? 8 : 0) | layout.predicted_axis << 4));
    if (layout.predicted_axis != kNotPredicted) put(kSlopes, reader.word(layout.prediction));
    const uint32_t step_bytes = (layout.triangle_count + 7) / 8;
    const uint32_t step_words = (layout.triangle_count + 31) / 32;
    for (uint32_t half = 0; half < (layout.wide_steps ? 2u : 1u); ++half) {
      const std::byte* steps = reader.data + 4 * uint64_t{layout.steps + half * step_words};
      out_[kSteps].insert(out_[kSteps].end(), steps, steps + step_bytes);
    }
    const auto place = [&](uint32_t vertex, const Offsets& expected) {
      uint32_t offset[3];
      reader.offset(vertex, offset);
      const Offsets offsets = {static_cast<int32_t>(offset[0]), static_cast<int32_t>(offset[1]),
                               static_cast<int32_t>(offset[2]), 0};
      place_vertex(offsets, expected);
      return offsets;
    };
    VertexPredictor& predictor = memory_.predictor;
    predictor.begin(layout.distance_bits, first_);
    for (uint32_t i = 0; i < layout.triangle_count; ++i) {
      uint32_t back[2];
      reader.distances(i, back);
      if (layout.distance_bits <= kShortDistance) {
        put(kDistances, static_cast<uint8_t>(back[0] | back[1] << 4));
      } else {
        put(kDistances, static_cast<uint8_t>(back[0]));
        put(kDistances, static_cast<uint8_t>(back[1]));
      }
      predictor.triangle(reader.largest(i), back, place);
    }
    predictor.finish(layout.vertex_count, place);
    first_ = predictor.at(0);
  }

  void place_vertex(const Offsets& offsets, const Offsets& expected) {
    RecentVertices& recent = memory_.recent;
    uint32_t& latest = latest_[slot(offsets)];
    const uint32_t number = recent.count();
    if (latest != kNone && number - latest <= kMostBack && is_equal(recent.at(latest), offsets)) {
      const uint32_t place = zigzag(latest - named_) + 1;
      if (place < kFarPlace) {
        put(kPlaces, static_cast<uint8_t>(place));
      } else {
        put(kPlaces, static_cast<uint8_t>(kFarPlace));
        put(kFar, static_cast<uint16_t>(number - latest));
      }
      named_ = latest;
    } else {
      put(kPlaces, uint8_t{0});
      const Offsets left = (offsets - expected) << 8 >> 8;  // modulo 2^24, the representative nearest to 0
      std::array<uint32_t, 3> codes;
      for (int axis = 0; axis < 3; ++axis) codes[static_cast<size_t>(axis)] = zigzag(static_cast<uint32_t>(left[axis]));
      residuals_.push_back(codes);
    }
    latest = number;
    recent.add(offsets);
  }

  static bool is_equal(const Offsets& a, const Offsets& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

  static uint32_t slot(const Offsets& offsets) {
    uint64_t hash = 0;
    for (int axis = 0; axis < 3; ++axis) hash = (hash + static_cast<uint64_t>(offsets[axis])) * 0x9e3779b97f4a7c15u;
    return static_cast<uint32_t>(hash >> (64 - kSlotBits));
  }

  JoinMemory memory_;
  std::array<uint32_t, 1u << kSlotBits> latest_;  // latest vertex of the part with that hash
  uint32_t named_ = 0;
  Offsets first_{};
  std::array<std::vector<std::byte>, kStreams> out_;
  std::vector<std::array<uint32_t, 3>> residuals_;
};

/// Bytes of the streams of a chunk's clusters.
uint64_t cluster_bytes(const std::byte* payload, uint32_t clusters) {
  const uint64_t head = (group_count(clusters) + clusters) * sizeof(ClusterBounds);
  const auto last = load<ClusterRecord>(payload + head + (clusters - uint64_t{1}) * sizeof(ClusterRecord));
  return cluster_stream_bytes(clusters, cluster_layout(last).end);
}

}  // namespace

SplitPage split_page(std::span<const std::byte> page, std::span<const PageClusters> clusters) try {
  if (page.size() > UINT32_MAX / kMaxSplitRatio) return {};
  const auto splitter = std::make_unique<Splitter>();
  uint64_t done = 0;
  uint32_t before = 0;  // the plain bytes behind this many clusters end where the next chunk begins
  for (const PageClusters& part : clusters) {
    assert(part.cluster_count != 0 && part.offset >= done);
    if (part.offset != done || before != 0) splitter->put_part(before, page.subspan(done, part.offset - done));
    splitter->part(page.data() + part.offset, part.cluster_count);
    before = part.cluster_count;
    done = part.offset + cluster_bytes(page.data() + part.offset, part.cluster_count);
  }
  splitter->put_part(before, page.subspan(done));
  SplitPage split = splitter->finish();
  if (split.bytes.size() > kMaxSplitRatio * page.size()) return {};
  std::vector<std::byte> joined(page.size());
  if (!join_page(split.bytes, joined) || std::memcmp(joined.data(), page.data(), page.size()) != 0) return {};
  return split;
} catch (const std::bad_alloc&) {
  return {};
}

Result<void> join_page(std::span<const std::byte> split, std::span<std::byte> page) {
  thread_local std::unique_ptr<JoinMemory> memory;
  if (!memory) memory.reset(new (std::nothrow) JoinMemory);
  if (!memory) return Error{kMemory, "no memory to put clusters together"};
  return Joiner(page, *memory).run(split);
}

}  // namespace scree::format
