// Joins split pages. Each step handles a whole cluster, mostly without branches: the streams' values are hard to
// predict, and without branches the processor works on many triangles at once.
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <memory>
#include <new>
#include <string>

#include "format/bitpack.h"
#include "format/bytes.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_page.h"
#include "format/geometry/offset_box.h"
#include "format/geometry/recent_vertices.h"
#include "format/geometry/split_streams.h"
#include "format/geometry/split_triangles.h"
#include "format/geometry/word_writer.h"

namespace scree::format {
namespace {

using namespace split_streams;
using enum ErrorCode;

using Floats = float __attribute__((vector_size(16)));

/// a + b modulo 2^24, with 0 as the fourth number.
Offsets modulo_sum(const Offsets& a, const Offsets& b) {
  using Unsigned = uint32_t __attribute__((vector_size(16)));
  constexpr uint32_t kMask = (1 << 24) - 1;
  const Unsigned sum = __builtin_convertvector(a, Unsigned) + __builtin_convertvector(b, Unsigned);
  return __builtin_convertvector(sum & Unsigned{kMask, kMask, kMask, 0}, Offsets);
}

uint32_t unzigzag(uint32_t code) {
  return code >> 1 ^ (0u - (code & 1));
}

/// A cluster from a split page, before its vertices are placed.
struct ReadCluster {
  uint32_t triangle_count;
  uint32_t vertex_count;
  uint32_t distance_bits;
  bool wide_steps;
  uint32_t axis;  // predicted, or kNotPredicted
  ClusterTriangles triangles;
  std::array<std::byte, kMaxClusterVertices / 8> fresh;  // a bit per vertex: it has a residual
  uint32_t fresh_count;
  const std::byte* references;  // of the other vertices
};

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

/// Reads values that are apart, byte by byte: the low bytes of all, then the high bytes if values have two.
class PlaneCursor {
 public:
  PlaneCursor() = default;
  PlaneCursor(std::span<const std::byte> bytes, uint32_t bytes_each)
      : bytes_(bytes.data()), count_(bytes.size() / bytes_each), has_high_(bytes_each > 1) {}

  uint64_t left() const { return count_ - next_; }
  /// The next value; one must be left.
  uint32_t take() {
    const std::byte* const at = bytes_ + next_++;
    const auto low = std::to_integer<uint32_t>(at[0]);
    return has_high_ ? low | std::to_integer<uint32_t>(at[count_]) << 8 : low;
  }

 private:
  const std::byte* bytes_ = nullptr;
  uint64_t count_ = 0;
  uint64_t next_ = 0;
  bool has_high_ = false;
};

class Joiner {
 public:
  Joiner(std::span<std::byte> page, SplitMemory& memory) : page_(page), memory_(memory) {}

  Result<void> run(std::span<const std::byte> split) {
    SCREE_TRY(open(split));
    while (in_[kParts].left() != 0) {
      const std::byte* part = in_[kParts].take(8);
      if (part == nullptr) return Error{kTruncated, "half a part"};
      const auto clusters = load<uint32_t>(part);
      if (clusters != 0) SCREE_TRY(join_part(clusters));
      const uint64_t plain = load<uint32_t>(part + 4);
      const std::byte* from = in_[kPlain].take(plain);
      if (from == nullptr) return ends(kPlain);
      SCREE_TRY(make_room(plain));
      if (plain != 0) std::memcpy(page_.data() + done_, from, plain);
      done_ += plain;
    }
    if (done_ != page_.size()) {
      return Error{kTruncated,
                   "it makes " + std::to_string(done_) + " bytes, expected " + std::to_string(page_.size())};
    }
    for (uint32_t i = 0; i < kStreams; ++i) {
      const uint64_t left = i == kLow    ? residual_count_ - residual_
                            : i == kTall ? tall_.left()
                            : i == kFar  ? far_.left()
                                         : in_[i].left();
      if (left != 0) return Error{kTrailing, std::string("bytes of ") + kNames[i] + " are left over"};
    }
    return {};
  }

 private:
  Result<void> open(std::span<const std::byte> split) {
    const SplitStreams streams = SCREE_TRY(open_streams(split));
    for (uint32_t i = 0; i < kStreams; ++i) in_[i] = Cursor(streams.bytes[i]);
    residual_count_ = streams.residual_count();
    low_ = streams.bytes[kLow].data();
    has_high_ = !streams.bytes[kHigh].empty();
    tall_ = PlaneCursor(streams.bytes[kTall], streams.tall_bytes);
    far_ = PlaneCursor(streams.bytes[kFar], 2);
    return {};
  }

  Result<void> make_room(uint64_t bytes) const {
    if (bytes <= page_.size() - done_) return {};
    return Error{kTrailing, "it makes more than the page's " + std::to_string(page_.size()) + " bytes"};
  }

  /// Writes the four streams of a chunk of clusters.
  Result<void> join_part(uint64_t clusters) {
    const uint64_t groups = group_count(clusters);
    const uint64_t head = (groups + clusters) * sizeof(ClusterBounds) + clusters * sizeof(ClusterRecord);
    SCREE_TRY(make_room(head));
    std::byte* const group_bounds = page_.data() + done_;
    std::byte* const bounds = group_bounds + groups * sizeof(ClusterBounds);
    std::byte* const records = bounds + clusters * sizeof(ClusterBounds);
    done_ += head;
    const uint64_t data = done_;
    memory_.recent.clear();
    named_ = 0;
    first_ = Offsets{};
    ClusterRecord next{};
    OffsetBox group{};
    for (uint64_t i = 0; i < clusters; ++i) {
      ClusterRecord record = next;
      OffsetBox box{};
      const uint32_t words = SCREE_TRY(join_cluster(record, box));
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
      next.place += words;
      if (next.place >= kMaxClusterWords) return Error{kRange, "more than 2^29 words of a chunk"};
      next.first_triangle += cluster_.triangle_count;
      next.first_vertex += cluster_.vertex_count;
    }
    const uint64_t stream = packed_bytes(next.place, 32);
    done_ = data;
    SCREE_TRY(make_room(stream));
    std::fill(page_.begin() + static_cast<ptrdiff_t>(data + 4 * uint64_t{next.place}),
              page_.begin() + static_cast<ptrdiff_t>(data + stream), std::byte{0});
    done_ = data + stream;
    return {};
  }

  /// Takes what describes the cluster's form and its triangles.
  Result<void> take_triangles() {
    const std::byte* const triangles = in_[kTriangles].take(1);
    const std::byte* const vertices = in_[kVertices].take(1);
    const std::byte* const form = in_[kForms].take(1);
    if (triangles == nullptr) return ends(kTriangles);
    if (vertices == nullptr) return ends(kVertices);
    if (form == nullptr) return ends(kForms);
    const auto bits = std::to_integer<uint32_t>(*form);
    cluster_.triangle_count = std::to_integer<uint32_t>(*triangles) + 1;
    cluster_.vertex_count = std::to_integer<uint32_t>(*vertices) + 1;
    cluster_.distance_bits = bits & 7;
    cluster_.wide_steps = (bits >> 3 & 1) != 0;
    cluster_.axis = bits >> 4 & 3;
    if (bits >> 6 != 0) return Error{kReserved, "a reserved bit of a form is set"};
    if (cluster_.triangle_count > kMaxClusterTriangles || cluster_.vertex_count > kMaxClusterVertices)
      return Error{kRange, "more than 128 triangles or vertices of a cluster"};
    const uint32_t count = cluster_.triangle_count;
    const std::byte* const gates = in_[kGates].take(count);
    if (gates == nullptr) return ends(kGates);
    if (largest_of({gates, count}) >= kExplicitGate + 4) return Error{kReserved, "a reserved bit of a gate is set"};
    const std::byte* const distances = in_[kDistances].take(distances_of({gates, count}));
    if (distances == nullptr) return ends(kDistances);
    if (!read_triangles({{gates, count}, distances, cluster_.distance_bits, cluster_.wide_steps}, cluster_.vertex_count,
                        cluster_.triangles))
      return Error{kRange, "a triangle with vertices that its cluster lacks"};
    memory_.predictor.begin(cluster_.triangles, cluster_.vertex_count);
    return {};
  }

  /// Takes what says which vertices have residuals, and to which vertices the others refer.
  Result<void> take_references() {
    const uint32_t bytes = bytes_of_bits(cluster_.vertex_count);
    const std::byte* const fresh = in_[kFresh].take(bytes);
    if (fresh == nullptr) return ends(kFresh);
    std::memcpy(cluster_.fresh.data(), fresh, bytes);
    if (std::to_integer<uint32_t>(fresh[bytes - 1]) >> ((cluster_.vertex_count - 1) % 8 + 1) != 0)
      return Error{kReserved, "a fresh bit after the last vertex is set"};
    cluster_.fresh_count = 0;
    for (uint32_t i = 0; i < bytes; ++i)
      cluster_.fresh_count += static_cast<uint32_t>(std::popcount(std::to_integer<uint32_t>(fresh[i])));
    cluster_.references = in_[kReferences].take(cluster_.vertex_count - cluster_.fresh_count);
    return cluster_.references != nullptr ? Result<void>() : ends(kReferences);
  }

  /// Writes the cluster's words to the page. Sets all fields of `record` except the sums over earlier clusters. Returns
  /// the number of words.
  Result<uint32_t> join_cluster(ClusterRecord& record, OffsetBox& box) {
    SCREE_TRY(take_triangles());
    SCREE_TRY(take_references());
    SCREE_TRY(take_residuals());
    if (!place_vertices(box)) return Error{kRange, "a missing vertex"};
    std::array<uint32_t, kMostClusterWords + kWriterSlack> words;
    uint32_t* const steps = words.data() + (cluster_.axis != kNotPredicted ? 2 : 0);
    uint32_t* const end = SCREE_TRY(put_positions(box, words.data(), put_distances(put_steps(steps)), record));
    record.place |= cluster_.axis << 29 | (cluster_.wide_steps ? 1u << 31 : 0);
    record.counts |= (cluster_.triangle_count - 1) | (cluster_.vertex_count - 1) << 7 | cluster_.distance_bits << 14;
    const auto written = static_cast<uint32_t>(end - words.data());
    SCREE_TRY(make_room(4 * uint64_t{written}));
    std::memcpy(page_.data() + done_, words.data(), 4 * uint64_t{written});
    done_ += 4 * uint64_t{written};
    return written;
  }

  /// Computes the vertices' offsets. Returns false if a reference is missing or out of range.
  bool place_vertices(OffsetBox& box) {
    const uint32_t count = cluster_.vertex_count;
    const Places places = read_places();
    if (places.far_count > far_.left()) return false;
    std::array<uint16_t, kMaxClusterVertices + 1> far_backs;
    for (uint32_t i = 0; i < places.far_count; ++i) far_backs[i] = static_cast<uint16_t>(far_.take());
    far_backs[places.far_count] = 0;  // read, but not used

    RecentVertices& recent = memory_.recent;
    const VertexPredictor& predictor = memory_.predictor;
    at_ = recent.make_room();
    const Offsets* const values = recent.values();
    const uint32_t first_index = recent.first_index();
    const uint32_t first_number = recent.count();
    uint32_t named = named_;
    uint32_t residual = 0;
    uint32_t reference = 0;
    uint32_t next_far = 0;
    std::array<uint32_t, kMaxClusterVertices> backs;  // distance back to the vertex that is referred to, in vertices
    const auto place = [&](uint32_t v, const Offsets& expected) {
      const auto is_new = static_cast<uint32_t>(places.is_new[v]);
      const auto is_far = static_cast<uint32_t>(places.is_far[reference]) & ~is_new;
      named += static_cast<uint32_t>(places.step[reference]) & ~is_new;
      reference += 1 + is_new;
      named ^= (named ^ (first_number + v - far_backs[next_far])) & is_far;
      next_far -= is_far;
      backs[v] = first_number + v - named;
      const uint32_t earlier = first_index + named;
      const uint32_t index = earlier ^ ((earlier ^ residual) & is_new);
      residual -= is_new;
      const Offsets value = values[index % kMostValues];  // garbage if the number is wrong, which the last loop checks
      const Offsets adds = __builtin_shufflevector(value, value, 3, 3, 3, 3);
      return modulo_sum(expected & adds, value);
    };
    first_ = place(0, first_);
    at_[0] = first_;
    // Offsets are exact as floats. Every processor has instructions for the minimum and maximum of floats.
    Floats smallest = __builtin_convertvector(first_, Floats);
    Floats largest = smallest;
    for (uint32_t v = 1; v < count; ++v) {
      const Offsets offsets = place(v, predictor.expected(v, at_));
      at_[v] = offsets;
      const Floats exact = __builtin_convertvector(offsets, Floats);
      smallest = exact < smallest ? exact : smallest;
      largest = exact > largest ? exact : largest;
    }
    const Offsets min = __builtin_convertvector(smallest, Offsets);
    const Offsets max = __builtin_convertvector(largest, Offsets);
    for (int axis = 0; axis < 3; ++axis) {
      box.min[axis] = static_cast<uint32_t>(min[axis]);
      box.max[axis] = static_cast<uint32_t>(max[axis]);
    }
    named_ = named;
    recent.add(count);
    int32_t lost = 0;
    for (uint32_t v = 0; v < count; ++v) {
      const auto most = static_cast<int32_t>(std::min(first_number + v, kMostBack));
      const auto back = static_cast<int32_t>(backs[v]);
      lost |= ~places.is_new[v] & -((back < 1) | (back > most));
    }
    return lost == 0;
  }

  /// Where a cluster's vertices come from. Conditions are 0 or -1.
  struct Places {
    std::array<int8_t, kMaxClusterVertices> is_new;  // by vertex: it has a residual
    // By reference; one more than there are is read, but not used.
    std::array<int8_t, kMaxClusterVertices + 1> is_far;  // it has an entry in kFar
    std::array<int8_t, kMaxClusterVertices + 1> step;    // from the reference before, if it is not far
    uint8_t far_count = 0;
  };
  Places read_places() const {
    Places out;
    for (uint32_t i = 0; i < cluster_.fresh.size(); ++i) {  // each bit becomes a byte
      const uint64_t bits = std::to_integer<uint64_t>(cluster_.fresh[i]) * 0x0101010101010101 & 0x8040201008040201;
      const uint64_t ones = (((bits & 0x7f7f7f7f7f7f7f7f) + 0x7f7f7f7f7f7f7f7f) | bits) >> 7 & 0x0101010101010101;
      const uint64_t all = ones * 255;
      std::memcpy(&out.is_new[8 * i], &all, sizeof all);
    }
    const uint32_t count = cluster_.vertex_count - cluster_.fresh_count;
    uint8_t far_count = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const auto code = std::to_integer<uint8_t>(cluster_.references[i]);
      out.is_far[i] = code == kFarReference ? -1 : 0;
      out.step[i] = static_cast<int8_t>(code >> 1 ^ -(code & 1));
      far_count = static_cast<uint8_t>(far_count + (code == kFarReference));
    }
    out.is_far[count] = 0;
    out.step[count] = 0;
    out.far_count = far_count;
    return out;
  }

  /// Reads the residuals of a cluster before the recent vertices. The fourth number is -1 for a residual and 0 for a
  /// vertex.
  Result<void> take_residuals() {
    const uint32_t count = cluster_.fresh_count;
    if (count > residual_count_ - residual_) return ends(kLow);
    uint32_t codes[3][kMaxClusterVertices];
    for (uint32_t axis = 0; axis < 3; ++axis) {
      const std::byte* const low = low_ + axis * residual_count_ + residual_;
      for (uint32_t i = 0; i < count; ++i) codes[axis][i] = std::to_integer<uint32_t>(low[i]);
    }
    if (has_high_) SCREE_TRY(add_high(in_[kHigh].take(count), codes));
    residual_ += count;
    Offsets* const out = memory_.recent.values();
    for (uint32_t i = 0; i < count; ++i) {
      const auto value = [&](uint32_t axis) { return static_cast<int32_t>(unzigzag(codes[axis][i])); };
      out[i] = Offsets{value(0), value(1), value(2), -1};
    }
    return {};
  }

  /// Adds the high bits of a cluster's residuals; open_streams() ensured that they are there.
  Result<void> add_high(const std::byte* high, uint32_t codes[3][kMaxClusterVertices]) {
    const uint32_t count = cluster_.fresh_count;
    for (uint32_t axis = 0; axis < 3; ++axis)
      for (uint32_t i = 0; i < count; ++i) codes[axis][i] |= (std::to_integer<uint32_t>(high[i]) >> 2 * axis & 3) << 8;
    std::array<uint8_t, kMaxClusterVertices + 1> with_tall;  // residuals with a tall code
    uint32_t with_tall_count = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const auto bits = std::to_integer<uint8_t>(high[i]);
      with_tall[with_tall_count] = static_cast<uint8_t>(i);
      with_tall_count += (bits & bits >> 1 & 0x15) != 0 ? 1 : 0;
    }
    if (largest_of({high, count}) >> 6 != 0) return Error{kReserved, "a reserved bit of a residual is set"};
    for (uint32_t i = 0; i < with_tall_count; ++i) {
      const uint32_t residual = with_tall[i];
      for (uint32_t axis = 0; axis < 3; ++axis) {
        if ((std::to_integer<uint32_t>(high[residual]) >> 2 * axis & 3) != kTallCode) continue;
        if (tall_.left() == 0) return ends(kTall);
        codes[axis][residual] = (codes[axis][residual] & 0xff) | tall_.take() << 8;
      }
    }
    return {};
  }

  /// Writes the steps; returns their end.
  uint32_t* put_steps(uint32_t* words) {
    const uint32_t count = cluster_.triangle_count;
    std::array<uint8_t, kMaxClusterTriangles>& all_steps = cluster_.triangles.steps;
    std::fill_n(all_steps.begin() + count, -count % 8, uint8_t{0});
    WordWriter writer(words);
    for (uint32_t bit = 0; bit < (cluster_.wide_steps ? 2u : 1u); ++bit) {
      for (uint32_t i = 0; i < count; i += 8) {
        uint64_t eight;
        std::memcpy(&eight, &all_steps[i], sizeof eight);
        writer.put(gather_bits(eight, bit), std::min(count - i, 8u));
      }
      words = writer.end_section();
    }
    return words;
  }

  /// Writes the distances; returns their end.
  uint32_t* put_distances(uint32_t* words) const {
    const uint32_t bits = cluster_.distance_bits;
    const uint32_t count = cluster_.triangle_count;
    const uint16_t* const back = cluster_.triangles.back.data();
    if (bits == 4) {  // most often
      words[(count - 1) / 4] = 0;
      std::array<uint8_t, kMaxClusterTriangles> both;
      for (uint32_t i = 0; i < count; ++i) both[i] = static_cast<uint8_t>(back[i] | back[i] >> 4);
      std::memcpy(words, both.data(), count);
      return words + (count + 3) / 4;
    }
    std::array<uint16_t, kMaxClusterTriangles + 3> pairs;
    for (uint32_t i = 0; i < count; ++i) pairs[i] = static_cast<uint16_t>((back[i] & 0xff) | back[i] >> 8 << bits);
    std::fill_n(pairs.begin() + count, 3, uint16_t{0});
    WordWriter writer(words);
    for (uint32_t i = 0; i < count; i += 4) {
      uint64_t four;
      std::memcpy(&four, &pairs[i], sizeof four);
      four = (four & 0x0000ffff0000ffffu) | (four >> 16 & 0x0000ffff0000ffffu) << 2 * bits;
      four = (four & 0xffffffffu) | four >> 32 << 4 * bits;
      writer.put(four, 2 * bits * std::min(count - i, 4u));
    }
    return writer.end_section();
  }

  /// Writes the positions to `words` and the prediction to `prediction`. Returns the end of the positions.
  Result<uint32_t*> put_positions(const OffsetBox& box, uint32_t* prediction, uint32_t* words, ClusterRecord& record) {
    const uint32_t count = cluster_.vertex_count;
    int32_t codes[3][kMaxClusterVertices];
    const auto min_x = static_cast<int32_t>(box.min[0]);
    const auto min_y = static_cast<int32_t>(box.min[1]);
    const auto min_z = static_cast<int32_t>(box.min[2]);
    for (uint32_t i = 0; i < count; ++i) {
      codes[0][i] = at_[i][0] - min_x;
      codes[1][i] = at_[i][1] - min_y;
      codes[2][i] = at_[i][2] - min_z;
    }
    uint32_t bits[3];
    for (size_t axis = 0; axis < 3; ++axis)
      bits[axis] = static_cast<uint32_t>(std::bit_width(box.max[axis] - box.min[axis]));
    if (cluster_.axis != kNotPredicted) {
      const uint32_t axis = cluster_.axis;
      const uint32_t u = (axis + 1) % 3;
      const uint32_t v = (axis + 2) % 3;
      const std::byte* slopes = in_[kSlopes].take(4);
      if (slopes == nullptr) return ends(kSlopes);
      if (std::max(bits[u], bits[v]) > kMaxPredictorBits)
        return Error{kRange, "a cluster too large to predict an axis"};
      const auto slope_u = load<int16_t>(slopes);
      const auto slope_v = load<int16_t>(slopes + 2);
      int32_t smallest = INT32_MAX;
      int32_t largest = INT32_MIN;
      for (uint32_t i = 0; i < count; ++i) {
        codes[axis][i] -= (slope_u * codes[u][i] + slope_v * codes[v][i]) >> kPredictorShift;
        smallest = std::min(smallest, codes[axis][i]);
        largest = std::max(largest, codes[axis][i]);
      }
      for (uint32_t i = 0; i < count; ++i) codes[axis][i] -= smallest;
      bits[axis] = static_cast<uint32_t>(std::bit_width(static_cast<uint32_t>(largest - smallest)));
      if (bits[axis] > kMaxPositionBits) return Error{kRange, "more than 24 bits of an axis"};
      prediction[0] = load<uint32_t>(slopes);
      prediction[1] = static_cast<uint32_t>(smallest);
    }
    record.counts |= bits[0] << 17 | bits[1] << 22 | bits[2] << 27;
    const uint32_t xy_bits = bits[0] + bits[1];
    const bool fits = xy_bits + bits[2] <= kMostPutBits;  // else z is put separately
    const auto code = [&codes](size_t axis, uint32_t i) { return uint64_t{static_cast<uint32_t>(codes[axis][i])}; };
    uint64_t packed[kMaxClusterVertices];
    for (uint32_t i = 0; i < count; ++i) packed[i] = code(0, i) | code(1, i) << bits[0];
    for (uint32_t i = 0; i < count && fits; ++i) packed[i] |= code(2, i) << xy_bits;
    WordWriter writer(words);
    for (uint32_t i = 0; i < count; ++i) {
      writer.put(packed[i], fits ? xy_bits + bits[2] : xy_bits);
      if (!fits) writer.put(code(2, i), bits[2]);
    }
    return writer.end_section();
  }

  std::span<std::byte> page_;
  SplitMemory& memory_;
  uint64_t done_ = 0;  // bytes of the page
  std::array<Cursor, kStreams> in_;
  uint64_t residual_count_ = 0;  // of the page
  uint64_t residual_ = 0;        // the next one
  const std::byte* low_ = nullptr;
  bool has_high_ = false;
  PlaneCursor tall_;
  PlaneCursor far_;
  ReadCluster cluster_{};
  Offsets* at_ = nullptr;  // the cluster's vertices
  uint32_t named_ = 0;     // the vertex referred to last, numbered in the part
  Offsets first_{};        // first vertex of the cluster before
};

}  // namespace

Result<void> join_page(std::span<const std::byte> split, std::span<std::byte> page) {
  thread_local std::unique_ptr<SplitMemory> memory;
  if (!memory) memory.reset(new (std::nothrow) SplitMemory);
  if (!memory) return Error{kMemory, "no memory to put clusters together"};
  const Result<void> joined = Joiner(page, *memory).run(split);
  return joined ? joined : Result<void>(at("split page", joined.error()));
}

}  // namespace scree::format
