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

/// The header of a cluster in a split page.
struct Form {
  uint32_t triangle_count;
  uint32_t vertex_count;
  uint32_t distance_bits;
  bool wide_steps;
  uint32_t axis;  // predicted, or kNotPredicted
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
      const uint64_t left = i == kResiduals ? (residual_count_ - residual_) : in_[i].left();
      if (left != 0) return Error{kTrailing, std::string("bytes of ") + kNames[i] + " are left over"};
    }
    return {};
  }

 private:
  Result<void> open(std::span<const std::byte> split) {
    const SplitStreams streams = SCREE_TRY(open_streams(split));
    planes_ = streams.planes;
    residual_count_ = streams.residual_count();
    residuals_ = streams.bytes[kResiduals].data();
    for (uint32_t i = 0; i < kStreams; ++i) in_[i] = Cursor(streams.bytes[i]);
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
      next.first_triangle += form_.triangle_count;
      next.first_vertex += form_.vertex_count;
    }
    const uint64_t stream = packed_bytes(next.place, 32);
    done_ = data;
    SCREE_TRY(make_room(stream));
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
    if (bits >> 6 != 0) return Error{kReserved, "a reserved bit of a form is set"};
    if (form_.triangle_count > kMaxClusterTriangles || form_.vertex_count > kMaxClusterVertices)
      return Error{kRange, "more than 128 triangles or vertices of a cluster"};
    return {};
  }

  /// Writes the cluster's words to the page. Sets all fields of `record` except the sums over earlier clusters. Returns
  /// the number of words.
  Result<uint32_t> join_cluster(ClusterRecord& record, OffsetBox& box) {
    SCREE_TRY(take_form());
    SCREE_TRY(take_triangles());
    if (!place_vertices(box)) return Error{kRange, "a missing vertex, or too few residuals"};
    std::array<uint32_t, kMostClusterWords + kWriterSlack> words;
    uint32_t* const steps = words.data() + (form_.axis != kNotPredicted ? 2 : 0);
    uint32_t* const end = SCREE_TRY(put_positions(box, words.data(), put_distances(put_steps(steps)), record));
    record.place |= form_.axis << 29 | (form_.wide_steps ? 1u << 31 : 0);
    record.counts |= (form_.triangle_count - 1) | (form_.vertex_count - 1) << 7 | form_.distance_bits << 14;
    const auto written = static_cast<uint32_t>(end - words.data());
    SCREE_TRY(make_room(4 * uint64_t{written}));
    std::memcpy(page_.data() + done_, words.data(), 4 * uint64_t{written});
    done_ += 4 * uint64_t{written};
    return written;
  }

  /// Reads the triangles, and the places of the vertices.
  Result<void> take_triangles() {
    const uint32_t count = form_.triangle_count;
    steps_ = in_[kSteps].take((form_.wide_steps ? 2 : 1) * step_bytes());
    if (steps_ == nullptr) return ends(kSteps);
    pairs_ = in_[kDistances].take(form_.distance_bits <= kShortDistance ? count : 2 * count);
    if (pairs_ == nullptr) return ends(kDistances);
    places_ = in_[kPlaces].take(form_.vertex_count);
    if (places_ == nullptr) return ends(kPlaces);
    if (!read_triangles({steps_, pairs_, count, form_.distance_bits, form_.wide_steps}, form_.vertex_count, triangles_))
      return Error{kRange, "a triangle with vertices that its cluster lacks"};
    return {};
  }

  uint32_t step_bytes() const { return bytes_of_steps(form_.triangle_count); }

  /// Computes the vertices' offsets. Returns false if a reference or a residual is missing or out of range.
  bool place_vertices(OffsetBox& box) {
    const uint32_t count = form_.vertex_count;
    const Places places = read_places();
    if (!take_residuals(places.new_count)) return false;
    const std::byte* const far = in_[kFar].take(2 * places.far_count);
    if (far == nullptr) return false;
    std::array<uint16_t, kMaxClusterVertices + 1> far_backs;
    std::memcpy(far_backs.data(), far, 2 * places.far_count);
    far_backs[places.far_count] = 0;  // read, but not used

    RecentVertices& recent = memory_.recent;
    VertexPredictor& predictor = memory_.predictor;
    predictor.begin(triangles_, count);
    at_ = recent.make_room();
    const Offsets* const values = recent.values();
    const uint32_t first_index = recent.first_index();
    const uint32_t first_number = recent.count();
    uint32_t named = named_;
    uint32_t residual = 0;
    uint32_t next_far = 0;
    std::array<uint32_t, kMaxClusterVertices> backs;  // distance back to the vertex that is referred to, in vertices
    const auto place = [&](uint32_t v, const Offsets& expected) {
      const auto is_new = static_cast<uint32_t>(places.is_new[v]);
      const auto is_far = static_cast<uint32_t>(places.is_far[v]);
      named += static_cast<uint32_t>(places.step[v]);
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

  /// A cluster's places, one by one. Conditions are 0 or -1.
  struct Places {
    std::array<int8_t, kMaxClusterVertices> is_new;  // it has a residual
    std::array<int8_t, kMaxClusterVertices> is_far;  // it has an entry in kFar
    std::array<int8_t, kMaxClusterVertices> step;    // from the vertex referred to before, if it is neither
    uint8_t new_count = 0;
    uint8_t far_count = 0;
  };
  Places read_places() const {
    Places out;
    const std::byte* const places = places_;
    const uint32_t count = form_.vertex_count;
    uint8_t new_count = 0;
    uint8_t far_count = 0;
    for (uint32_t v = 0; v < count; ++v) {
      const auto place = std::to_integer<uint8_t>(places[v]);
      const auto code = static_cast<uint8_t>(place - 1);
      const auto step = static_cast<int8_t>(code >> 1 ^ -(code & 1));
      out.is_new[v] = place == 0 ? -1 : 0;
      out.is_far[v] = place == kFarPlace ? -1 : 0;
      out.step[v] = place == 0 ? int8_t{0} : step;
      new_count -= static_cast<uint8_t>(out.is_new[v]);
      far_count -= static_cast<uint8_t>(out.is_far[v]);
    }
    out.new_count = new_count;
    out.far_count = far_count;
    return out;
  }

  /// Reads the residuals of a cluster. Returns false if too few are left.
  bool take_residuals(uint32_t count) {
    if (count > residual_count_ - residual_) return false;
    if (planes_ == 1) unpack_residuals<1>(count);
    if (planes_ == 2) unpack_residuals<2>(count);
    if (planes_ == 3) unpack_residuals<3>(count);
    residual_ += count;
    return true;
  }

  /// Writes residuals before the recent vertices. The fourth number is -1 for a residual and 0 for a vertex.
  template <uint32_t kPlanes>
  void unpack_residuals(uint32_t count) {
    int32_t values[3][kMaxClusterVertices];
    for (uint32_t axis = 0; axis < 3; ++axis) {
      const std::byte* const plane = residuals_ + axis * residual_count_ + residual_;
      for (uint32_t i = 0; i < count; ++i) {
        uint32_t code = std::to_integer<uint32_t>(plane[i]);
        if constexpr (kPlanes > 1) code |= std::to_integer<uint32_t>(plane[3 * residual_count_ + i]) << 8;
        if constexpr (kPlanes > 2) code |= std::to_integer<uint32_t>(plane[6 * residual_count_ + i]) << 16;
        values[axis][i] = static_cast<int32_t>(unzigzag(code));
      }
    }
    Offsets* const out = memory_.recent.values();
    for (uint32_t i = 0; i < count; ++i) out[i] = Offsets{values[0][i], values[1][i], values[2][i], -1};
  }

  /// Writes the steps; returns their end.
  uint32_t* put_steps(uint32_t* words) const {
    const uint32_t step_words = (form_.triangle_count + 31) / 32;
    for (uint32_t half = 0; half < (form_.wide_steps ? 2u : 1u); ++half, words += step_words) {
      words[step_words - 1] = 0;
      std::memcpy(words, steps_ + half * step_bytes(), step_bytes());
    }
    return words;
  }

  /// Writes the distances; returns their end.
  uint32_t* put_distances(uint32_t* words) const {
    const uint32_t bits = form_.distance_bits;
    const uint32_t count = form_.triangle_count;
    if (bits == kShortDistance) {  // most often; pairs are packed as they are
      words[(count - 1) / 4] = 0;
      std::memcpy(words, pairs_, count);
      return words + (count + 3) / 4;
    }
    std::array<uint16_t, kMaxClusterTriangles + 3> pairs;
    for (uint32_t i = 0; i < count; ++i)
      pairs[i] = static_cast<uint16_t>(triangles_.back[0][i] | triangles_.back[1][i] << bits);
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
    const uint32_t count = form_.vertex_count;
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
    if (form_.axis != kNotPredicted) {
      const uint32_t axis = form_.axis;
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
  uint32_t planes_ = 0;
  const std::byte* residuals_ = nullptr;
  uint64_t residual_count_ = 0;
  uint64_t residual_ = 0;
  Form form_{};
  const std::byte* steps_ = nullptr;
  const std::byte* pairs_ = nullptr;  // of distances
  const std::byte* places_ = nullptr;
  ClusterTriangles triangles_;
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
