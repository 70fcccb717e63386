// Finds the vertices of a window whose stored values are all equal, so that each is stored once. A chunk has its own
// vertices, and a window consists of whole chunks, so comparing within a window loses nothing.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::convert {

/// Divides vertices into classes of equal ones, by positions first and then by one attribute after another. An
/// attribute is read only for vertices that still have an equal vertex. Equal means bit for bit, except that -0 equals
/// 0 with kUnsigned. A class is represented by its first vertex. Memory: 14 to 24 bytes per vertex, 8 more with
/// attributes, kept for the next window.
class Welder {
 public:
  enum class Zeros {
    kUnsigned,  // -0 equals 0, for values that are quantised
    kSigned,    // for values that are stored unchanged
  };

  /// Makes one class per distinct position. `positions`: 3 floats per vertex, at most 2^32 - 2 vertices.
  void start(std::span<const float> positions, Zeros zeros);

  /// The vertices that have an equal vertex, ascending. The next part() takes their values of the attribute.
  std::span<const uint32_t> find_candidates();

  /// Divides the classes by an attribute. `values`: `components` floats, at most 4, per vertex of find_candidates().
  void part(std::span<const float> values, uint32_t components);

  /// By vertex: the first vertex of its class, which may be itself.
  std::span<const uint32_t> firsts() const { return firsts_; }

  /// Vertices that are not the first of their class.
  uint64_t duplicates() const { return duplicates_; }

 private:
  template <class Item>
  void find_equals(uint64_t count, const Item& item);
  void count_duplicates();

  std::vector<uint32_t> firsts_;
  std::vector<uint32_t> candidates_;
  std::vector<uint32_t> table_;  // a power of two of slots: bits of the hash over an item's number, or kEmpty
  std::vector<uint32_t> first_items_;
  std::vector<bool> has_equal_;
  uint64_t duplicates_ = 0;
};

}  // namespace scree::convert
