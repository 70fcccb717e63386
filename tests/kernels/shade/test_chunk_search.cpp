// From a triangle's number to its chunk, for chunks of any sizes.
#include "kernels/shade/locate.h"

#include <algorithm>
#include <random>
#include <vector>

#include "tests/catch.h"

namespace scree {
namespace {

/// Checks the first, the last and a random triangle of every chunk.
void check_chunks(const std::vector<uint32_t>& counts, std::mt19937_64& random) {
  std::vector<format::ChunkRecord> chunks(counts.size());
  format::MeshRecord mesh{};
  for (size_t i = 0; i < counts.size(); ++i) {
    chunks[i].first_triangle = mesh.triangle_count;
    chunks[i].triangle_count = counts[i];
    mesh.triangle_count += counts[i];
  }
  mesh.chunk_count = chunks.size();
  uint64_t wrong = 0;
  for (size_t i = 0; i < counts.size(); ++i) {
    for (const uint64_t triangle : {uint64_t{0}, random() % counts[i], uint64_t{counts[i]} - 1})
      if (kernels::chunk_of_triangle(mesh, chunks.data(), chunks[i].first_triangle + triangle) != i) ++wrong;
  }
  CHECK(wrong == 0);
}

}  // namespace

TEST_CASE("a triangle's chunk is found, whatever the sizes of the chunks") {
  std::mt19937_64 random(7);
  check_chunks({1}, random);
  check_chunks({4'000'000'000, 4'000'000'000, 1}, random);
  check_chunks(std::vector<uint32_t>(3001, 65'536), random);
  for (const uint32_t largest : {2u, 100u, 65'536u, ~0u}) {
    for (const size_t count : {2, 3, 17, 500}) {
      std::vector<uint32_t> counts(count);
      for (uint32_t& triangles : counts) triangles = static_cast<uint32_t>(random() % largest) + 1;
      check_chunks(counts, random);
    }
  }
  std::vector<uint32_t> growing;  // the first guess is far from right
  for (uint32_t i = 0; i < 31; ++i) growing.push_back(1u << i);
  check_chunks(growing, random);
  std::reverse(growing.begin(), growing.end());
  check_chunks(growing, random);
}

}  // namespace scree
