// Runs the passes as a warp does: 32 threads in lockstep take the place of its lanes.
#include <barrier>
#include <random>
#include <thread>

#include "kernels/shade/pixels.h"
#include "tests/kernels/scene_builder.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

constexpr uint32_t kLanes = 32;

/// Values that the lanes of a team exchange.
struct Exchange {
  std::barrier<> meet{kLanes};
  uint64_t values[kLanes];
};

class LaneTeam {
 public:
  static constexpr bool kMakesTransforms = false;
  LaneTeam(Exchange& exchange, uint32_t rank) : exchange_(&exchange), rank_(rank) {}

  uint32_t rank() const { return rank_; }
  static constexpr uint32_t size() { return kLanes; }
  uint32_t ballot(bool value) const {
    uint32_t bits = 0;
    exchange(value, [&](const uint64_t* values) {
      for (uint32_t i = 0; i < kLanes; ++i) bits |= static_cast<uint32_t>(values[i]) << i;
    });
    return bits;
  }
  uint64_t share(uint64_t value, uint32_t lane) const {
    uint64_t shared = 0;
    exchange(value, [&](const uint64_t* values) { shared = values[lane]; });
    return shared;
  }

 private:
  template <class Read>
  void exchange(uint64_t value, const Read& read) const {
    exchange_->values[rank_] = value;
    exchange_->meet.arrive_and_wait();
    read(exchange_->values);
    exchange_->meet.arrive_and_wait();
  }

  Exchange* exchange_;
  uint32_t rank_;
};

/// Runs body(team) on all lanes of a team.
template <class Body>
void on_lanes(const Body& body) {
  Exchange exchange;
  std::vector<std::thread> lanes;
  for (uint32_t i = 0; i < kLanes; ++i) lanes.emplace_back([&exchange, &body, i] { body(LaneTeam(exchange, i)); });
  for (std::thread& lane : lanes) lane.join();
}

struct Values {
  const std::vector<uint64_t>* values;
  uint64_t operator()(uint64_t i) const { return (*values)[i]; }
};

}  // namespace

TEST_CASE("lanes: a team finds the last value not above a key", "[lanes]") {
  std::mt19937_64 random(3);
  struct Case {
    std::vector<uint64_t> values, keys;
  };
  std::vector<Case> cases;
  for (const size_t count : {1, 2, 3, 31, 32, 33, 34, 64, 65, 1000, 1024, 1025, 1057}) {
    Case made;
    uint64_t value = 0;
    for (size_t i = 0; i < count; ++i) {
      made.values.push_back(value);
      value += random() % 3;  // values may be equal: the last of them is expected
    }
    for (uint64_t key = 0; key < value + 2; key += 1 + value / 12) made.keys.push_back(key);
    cases.push_back(made);
  }
  std::vector<std::vector<uint64_t>> found(kLanes);
  on_lanes([&](LaneTeam team) {
    for (const Case& c : cases)
      for (const uint64_t key : c.keys)
        found[team.rank()].push_back(last_not_above_together(team, c.values.size(), key, Values{&c.values}));
  });
  size_t at = 0;
  for (const Case& c : cases)
    for (const uint64_t key : c.keys) {
      const auto expected =
          static_cast<uint64_t>(std::upper_bound(c.values.begin(), c.values.end(), key) - c.values.begin()) - 1;
      for (uint32_t lane = 0; lane < kLanes; ++lane) REQUIRE(found[lane][at] == expected);
      ++at;
    }
}

TEST_CASE("lanes: a team draws the same pixels as a thread", "[lanes]") {
  // Many small instances in chunks of few triangles: some tiles have one chunk, some a few, and some more than are
  // searched at once.
  SceneBuilder builder;
  const uint32_t ball = builder.mesh(sphere(8, 0.2), {.chunk_triangles = 7});
  builder.instance(builder.mesh(grid(3, 0.3), Encoding{}), builder.identity());
  for (int i = 0; i < 60; ++i) {
    const double size = 0.02 + 0.003 * i;
    builder.instance(ball, builder.matrix({size, 0, 0, 0.03 * i - 0.9, 0, size, 0, 0.4, 0, 0, size, 0.5 - 0.01 * i}));
  }
  const SceneView scene = builder.view();
  for (const uint32_t side : {1u, 2u}) {
    const uint32_t width = 29;  // not a multiple of the tile width
    const uint32_t height = 19;
    const View view = look_at({0.1, 1.2, 1.4}, {0, 0.2, 0}, width * side, height * side);
    const std::vector<uint64_t> samples = draw(scene, view);
    std::vector<Transform> transforms;
    const FrameView frame = make_frame_view(view);
    for (const format::InstanceRecord& instance : builder.instances) {
      const format::MeshRecord& mesh = builder.meshes[instance.mesh];
      transforms.push_back(make_transform(frame, builder.matrices[instance.matrix], mesh.lattice_exponent, false));
    }
    const SrgbTables tables = make_srgb_tables();
    for (const Show show : {Show::kTexture, Show::kMesh, Show::kTriangle}) {
      const ShadeOptions options{.show = show};
      std::vector<uint8_t> expected(size_t{4} * width * height);
      REQUIRE(resolve_cpu(scene, view, side, samples, options, 4, expected, 1));
      std::vector<uint8_t> pixels(expected.size());
      const PixelTiles tiles{width, 0, height};
      visit_shader<false>(make_shade_inputs(scene, view, options, transforms.data(), &tables, nullptr),
                          [&]<class Shader>(const Shader& shader) {
                            const Resolve<Shader> pass{shader, tiles, samples.data(), side, nullptr, 4, pixels.data()};
                            on_lanes([&](LaneTeam team) {
                              for (uint32_t item = 0; item < tiles.count(); ++item) pass(item, team);
                            });
                          });
      CHECK(std::equal(pixels.begin(), pixels.end(), expected.begin(),
                       [](uint8_t a, uint8_t b) { return std::abs(a - b) <= 1; }));
    }
  }
}
