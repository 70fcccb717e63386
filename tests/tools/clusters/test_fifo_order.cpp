// The order for vertex caches equals the order of meshoptimizer's optimiser, for any list.
#include <meshoptimizer.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tools/clusters/fifo_order.h"

using namespace scree;

namespace {

struct List {
  std::string name;
  std::vector<uint32_t> indices;
  uint32_t vertices;
};

List grid_of(uint32_t side) {
  List list{"grid of " + std::to_string(side), {}, (side + 1) * (side + 1)};
  for (uint32_t y = 0; y < side; ++y) {
    for (uint32_t x = 0; x < side; ++x) {
      const uint32_t at = y * (side + 1) + x;
      const uint32_t below = at + side + 1;
      list.indices.insert(list.indices.end(), {at, at + 1, below, below, at + 1, below + 1});
    }
  }
  return list;
}

/// The triangles in a random order, with rotated corners and random vertex numbers.
List shuffled(const List& list, std::mt19937& random) {
  List out{"shuffled " + list.name, {}, list.vertices};
  std::vector<uint32_t> triangles(list.indices.size() / 3), numbers(list.vertices);
  std::iota(triangles.begin(), triangles.end(), 0u);
  std::iota(numbers.begin(), numbers.end(), 0u);
  std::shuffle(triangles.begin(), triangles.end(), random);
  std::shuffle(numbers.begin(), numbers.end(), random);
  for (const uint32_t triangle : triangles) {
    const auto turn = static_cast<uint32_t>(random() % 3);
    for (uint32_t i = 0; i < 3; ++i) out.indices.push_back(numbers[list.indices[3 * triangle + (i + turn) % 3]]);
  }
  return out;
}

/// Equal, degenerate and unconnected triangles, and vertices that no triangle uses.
List random_list(uint32_t triangles, uint32_t vertices, std::mt19937& random) {
  List list{std::to_string(triangles) + " random triangles of " + std::to_string(vertices), {}, vertices};
  for (uint32_t i = 0; i < 3 * triangles; ++i) list.indices.push_back(static_cast<uint32_t>(random() % vertices));
  return list;
}

List fan(uint32_t triangles) {
  List list{"fan of " + std::to_string(triangles), {}, triangles + 2};
  for (uint32_t i = 0; i < triangles; ++i) list.indices.insert(list.indices.end(), {i + 1, 0, i + 2});
  return list;
}

}  // namespace

TEST_CASE("triangles are in the order of meshoptimizer's FIFO optimiser", "[fifo_order]") {
  std::mt19937 random(1);
  std::vector<List> lists{grid_of(60), shuffled(grid_of(90), random), fan(1000), grid_of(1), {"nothing", {}, 0},
                          grid_of(30)};
  for (const uint32_t vertices : {1u, 2u, 5u, 40u, 3000u}) lists.push_back(random_list(1500, vertices, random));
  tools::FifoOrder fifo;  // one object for all lists: nothing may remain of the previous list
  for (const List& list : lists) {
    INFO(list.name);
    std::vector<uint32_t> expected(list.indices.size());
    meshopt_optimizeVertexCacheFifo(expected.data(), list.indices.data(), list.indices.size(), list.vertices, 16);
    const std::span<const uint32_t> order = fifo.run(list.indices, list.vertices);
    REQUIRE(order.size() == list.indices.size() / 3);
    std::vector<uint32_t> corners;
    std::map<std::vector<uint32_t>, uint32_t> last;  // by equal triangles
    bool is_each_after_its_equals = true;
    for (const uint32_t triangle : order) {
      REQUIRE(triangle < order.size());
      const auto first = list.indices.begin() + 3 * static_cast<ptrdiff_t>(triangle);
      corners.insert(corners.end(), first, first + 3);
      const auto [equal, is_new] = last.try_emplace(std::vector<uint32_t>(first, first + 3), triangle);
      is_each_after_its_equals &= is_new || equal->second < triangle;
      equal->second = triangle;
    }
    CHECK(corners == expected);
    CHECK(is_each_after_its_equals);  // so that each triangle occurs once
  }
}
