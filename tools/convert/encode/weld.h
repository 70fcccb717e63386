// Finds the vertices of a window that are equal in everything that is stored of them, so that each is stored once. A
// chunk carries its own vertices and a window is whole chunks, so looking within a window loses nothing.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::convert {

/// Parts vertices into classes of equal ones, by positions first and then by one attribute after the other, of which
/// only the vertices that still have an equal need be read. Equal means bit for bit; where zeros have no sign, -0 is
/// 0. Which vertex stands for a class depends on nothing but the values: it is the first. Memory: 14 to 24 bytes a
/// vertex, 8 more with attributes, kept for the next window.
class Welder {
 public:
  enum class Zeros {
    kUnsigned,  // -0 is 0: for values that are quantised
    kSigned,    // for values that are kept as they are
  };

  /// A class for every different position; `positions`: 3 floats a vertex, at most 2^32 - 2 vertices.
  void start(std::span<const float> positions, Zeros zeros);

  /// Vertices that have an equal, ascending: those whose next attribute part() asks for.
  std::span<const uint32_t> find_candidates();

  /// Parts the classes by an attribute. `values`: `components` floats, at most 4, for each that find_candidates()
  /// found.
  void part(std::span<const float> values, uint32_t components);

  /// For each vertex the first of its class, which may be itself.
  std::span<const uint32_t> firsts() const { return firsts_; }

  /// Vertices that are not the first of their class.
  uint64_t duplicates() const { return duplicates_; }

 private:
  template <class Item>
  void find_equals(uint64_t count, const Item& item);
  void count_duplicates();

  std::vector<uint32_t> firsts_;
  std::vector<uint32_t> candidates_;
  std::vector<uint64_t> table_;  // powers of two of slots: 32 bits of the hash over the number of an item, or kEmpty
  std::vector<uint32_t> first_items_;
  std::vector<bool> has_equal_;
  uint64_t duplicates_ = 0;
};

}  // namespace scree::convert
