#include "tools/synth/slope.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "format/vec3.h"
#include "runtime/threads/parallel.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/textures.h"

namespace scree::synth {
namespace {

using namespace tools;

using Quaternion = std::array<double, 4>;  // xyzw

/// Octaves of noise3, for a point of any sign; values approximately in [-1, 1].
double fbm(uint32_t seed, uint32_t octaves, double x, double y, double z) {
  double sum = 0, height = 0.5;
  for (uint32_t o = 0; o < octaves; ++o, height *= 0.5) {
    sum += height * noise3(seed + 101 * o, x + 4096.0, y + 4096.0, z + 4096.0);
    x *= 2.0;
    y *= 2.0;
    z *= 2.0;
  }
  return sum;
}

/// A point in the unit ball, not at its centre.
Vec3 in_ball(Random& random) {
  for (;;) {
    const Vec3 p{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
    const double square = dot(p, p);
    if (square <= 1 && square > 1e-4) return p;
  }
}

void add_vertex(Mesh& mesh, const Vec3& at, double u, double v, double light) {
  mesh.add_vertex(at, u, v);
  const uint8_t level = static_cast<uint8_t>(std::clamp(light, 0.0, 1.0) * 255.0 + 0.5);
  mesh.colors.insert(mesh.colors.end(), {level, level, level, 255});
}

// ---- The ground: s metres up the slope (towards -z), x to the right ----

constexpr double kFoot = 28.0;    // the slope changes from flat to its angle over 0 to kFoot
constexpr double kRepose = 0.64;  // tangent of the angle of repose of stones
constexpr double kCliffFoot = 92.0;
constexpr double kNear = -24.0;  // the ground begins behind the camera

/// Height of the slope without its bumps.
double slope_profile(double s) {
  if (s <= 0) return 0.02 * s;
  const double u = std::min(s / kFoot, 1.0);
  const double bent = kRepose * kFoot * (u * u * u - 0.5 * u * u * u * u);  // the integral of kRepose * smooth_step
  return 0.02 * s + bent + kRepose * std::max(0.0, s - kFoot);
}

/// Height of the ground at (x, s); valid below the cliff, smooth beyond.
double ground_height(double x, double s) {
  const double cones = 2.6 * ramp(10, 60, s) * fbm(11, 2, x / 38.0, s / 160.0, 0.5);  // debris cones run downhill
  const double swells = 1.5 * fbm(12, 4, x / 22.0, s / 26.0, 1.5);
  const double bumps = 0.22 * fbm(13, 4, x / 3.0, s / 3.0, 2.5);
  return slope_profile(s) + cones + swells + bumps;
}

Vec3 ground_point(double x, double s) {
  return {x, ground_height(x, s), -s};
}

Vec3 ground_normal(double x, double s) {
  const double step = 0.4;
  const Vec3 right = ground_point(x + step, s) - ground_point(x - step, s);
  const Vec3 up = ground_point(x, s + step) - ground_point(x, s - step);
  return normalized(cross(right, up));
}

// ---- Stones ----

struct Stone {
  double x, s, radius;
  uint32_t kind;  // index of its rock mesh
};

constexpr uint32_t kBoulderKinds = 4;
constexpr uint32_t kStoneKinds = 8;
constexpr uint32_t kBoulderQuads = 26;   // along one side of a cube face: 8,112 triangles
constexpr uint32_t kStoneQuads = 7;      // 588
constexpr double kBoulderRadius = 1.15;  // from here on a stone is a boulder
constexpr uint32_t kStones = 12000;
constexpr double kSmallest = 0.23, kLargest = 2.9;  // radius, metres
constexpr double kApart = 0.72;                     // least distance, as a share of both radii: stones may touch

/// Half the width of the scattered ground at s: wider than the view.
double half_width(double s) {
  return 16.0 + 0.92 * std::max(0.0, s + 14.0);
}

/// Scatters stones with a minimum distance, the large ones first, so that the small ones fill the gaps.
std::vector<Stone> scatter(uint32_t count, uint32_t seed) {
  Random random(hash2(seed, 77, 0));
  std::vector<double> sizes(count);
  for (uint32_t i = 0; i < count; ++i) {
    // Few large, many small: a radius of 0.23 to 2.9 m, whose frequency falls with its cube.
    const double u = random.next();
    sizes[i] = kSmallest / std::sqrt(1.0 - u * (1.0 - kSmallest * kSmallest / (kLargest * kLargest)));
  }
  std::sort(sizes.begin(), sizes.end(), std::greater<>());
  const double largest = sizes.front();

  // The stones by square metre.
  constexpr int kWide = 256, kDeep = 128, kMiddle = 128, kBehind = 16;
  std::vector<std::vector<uint32_t>> cells(kWide * kDeep);
  const auto column = [](double x) { return std::clamp(static_cast<int>(std::floor(x)) + kMiddle, 0, kWide - 1); };
  const auto row = [](double s) { return std::clamp(static_cast<int>(std::floor(s)) + kBehind, 0, kDeep - 1); };
  std::vector<Stone> stones;
  for (const double radius : sizes) {
    for (int attempt = 0; attempt < 24; ++attempt) {
      // Larger stones roll farther and lie near the foot; the small ones remain above (fall sorting).
      const double large = ramp(0.25, 1.6, radius);
      const double top = synth::mix(kCliffFoot, 46.0, large);
      const double along = random.next();
      const double s = synth::mix(-12.0 + 6.0 * large, top, large > 0.5 ? along * std::sqrt(along) : along);
      const double x = random.between(-1, 1) * half_width(s);
      // Streaks without stones run down the slope; the meadow before its foot has few stones.
      const double streak = fbm(21, 3, x / 13.0, s / 70.0, 0.5) + 0.5 * fbm(22, 2, x / 5.0, s / 9.0, 0.5);
      const double density = ramp(-0.42, 0.05, streak) * (0.12 + 0.88 * ramp(-9.0, 6.0, s + 5.0 * streak));
      if (random.next() > density) continue;
      // Keeps the position of the camera free.
      if (std::abs(x) < 2.4 + radius && s < -9.5 + radius) continue;
      bool free = true;
      const double reach = kApart * (radius + largest);
      for (int j = row(s - reach); free && j <= row(s + reach); ++j)
        for (int i = column(x - reach); free && i <= column(x + reach); ++i)
          for (const uint32_t other : cells[j * kWide + i]) {
            const double dx = stones[other].x - x, ds = (stones[other].s - s) * 1.15;
            const double apart = kApart * (stones[other].radius + radius);
            free = free && dx * dx + ds * ds >= apart * apart;
          }
      if (!free) continue;
      const uint32_t kind = radius >= kBoulderRadius
                                ? static_cast<uint32_t>(random.next() * kBoulderKinds)
                                : kBoulderKinds + static_cast<uint32_t>(random.next() * kStoneKinds);
      cells[row(s) * kWide + column(x)].push_back(static_cast<uint32_t>(stones.size()));
      stones.push_back({x, s, radius, kind});
      break;
    }
  }
  return stones;
}

/// The rotation that takes +y to `up`, after a rotation about +y by the angle of the direction (c, s).
Quaternion upright(const Vec3& up, double c, double s) {
  const double half_c = std::sqrt(std::max(0.0, (1 + c) / 2)), half_s = std::sqrt(std::max(0.0, (1 - c) / 2));
  const Quaternion turn{0, s < 0 ? -half_s : half_s, 0, half_c};
  // From +y to up: the axis is y x up, and half the angle follows from the half-way vector.
  const Vec3 half = normalized(Vec3{up[0], up[1] + 1.0, up[2]});
  const Vec3 axis = cross({0, 1, 0}, half);
  const Quaternion tilt{axis[0], axis[1], axis[2], half[1]};
  const Vec3 a{tilt[0], tilt[1], tilt[2]}, b{turn[0], turn[1], turn[2]};
  const Vec3 v = b * tilt[3] + a * turn[3] + cross(a, b);
  const double w = tilt[3] * turn[3] - dot(a, b);
  const double length = std::sqrt(dot(v, v) + w * w);
  return {v[0] / length, v[1] / length, v[2] / length, w / length};
}

/// Rounds to four decimals, a tenth of a millimetre, which halves the length of the document.
double rounded(double value) {
  return std::round(value * 1e4) / 1e4;
}

std::vector<Placement> place_stones(const std::vector<Stone>& stones, uint32_t seed) {
  std::vector<Placement> placements;
  Random random(hash2(seed, 78, 0));
  for (const Stone& stone : stones) {
    const Vec3 normal = ground_normal(stone.x, stone.s);
    const Vec3 up = normalized(normal + in_ball(random) * 0.45);
    Vec3 turn = in_ball(random);
    turn[1] = 0;
    if (dot(turn, turn) < 1e-6) turn[0] = 1;
    turn = normalized(turn);
    Placement placement{.mesh = stone.kind, .rotation = upright(up, turn[0], turn[2])};
    const double flat = random.between(0.75, 1.1);
    placement.scale = {stone.radius * random.between(0.85, 1.15), stone.radius * flat,
                       stone.radius * random.between(0.85, 1.15)};
    // A third of the stone is in the ground, less at the foot, where stones lie upon others.
    const double lift = random.between(0.12, 0.42) * stone.radius * flat;
    placement.translation = ground_point(stone.x, stone.s) + normal * lift;
    for (double& part : placement.translation) part = rounded(part);
    for (double& part : placement.rotation) part = rounded(part);
    for (double& part : placement.scale) part = rounded(part);
    placements.push_back(placement);
  }
  return placements;
}

/// A broken block: the polytope of some planes about the origin, with rounded edges, roughened, and darker in its
/// hollows. Radius about 1, flattened in y.
Mesh make_rock(uint32_t kind, uint32_t n, double repeat) {
  Random random(hash2(31, kind, 0));
  const uint32_t planes = 13 + kind % 4 * 3;
  const double roundness = random.between(0.0, 0.5);  // variation of the faces' distances
  std::vector<Vec3> normals;
  std::vector<double> distances;
  for (uint32_t i = 0; i < planes; ++i) {
    normals.push_back(normalized(in_ball(random)));
    distances.push_back(random.between(0.62 + 0.25 * roundness, 1.0));
  }
  const Vec3 shape{random.between(0.9, 1.25), random.between(0.5, 0.85), random.between(0.75, 1.0)};
  const uint32_t seed = 1000 + 131 * kind;

  Mesh mesh{.name = (n == kBoulderQuads ? "boulder" : "stone") + std::to_string(kind)};
  for (uint32_t face = 0; face < 6; ++face)
    for (uint32_t y = 0; y <= n; ++y)
      for (uint32_t x = 0; x <= n; ++x) {
        const uint32_t axis = face >> 1, positive = face & 1u;
        Vec3 d{};
        d[axis] = positive != 0 ? 1.0 : -1.0;
        const double a = 2.0 * x / n - 1.0, b = 2.0 * y / n - 1.0;
        d[(axis + 1) % 3] = positive != 0 ? a : b;
        d[(axis + 2) % 3] = positive != 0 ? b : a;
        d = normalized(d);
        // 1 / r is the 16-norm of the planes' values of 1 / r, a smooth maximum.
        double sum = 0, nearest = 0;
        for (uint32_t i = 0; i < planes; ++i) {
          const double inverse = std::max(0.0, dot(d, normals[i])) / distances[i];
          const double square = inverse * inverse, fourth = square * square, eighth = fourth * fourth;
          sum += eighth * eighth;
          nearest = std::max(nearest, inverse);
        }
        const double inverse = std::max(std::sqrt(std::sqrt(std::sqrt(std::sqrt(sum)))), 0.7);
        const double rough = fbm(seed, 5, d[0] * 1.7, d[1] * 1.7, d[2] * 1.7);
        const double fine = fbm(seed + 7, 4, d[0] * 7.0, d[1] * 7.0, d[2] * 7.0);
        const double r = (1.0 + 0.16 * rough + 0.05 * fine) / inverse;
        const double light = 0.9 + 0.5 * rough + 0.55 * fine + 0.22 * d[1];
        // The four sides share one strip of the texture, which is seamless around; u runs to the right, seen from
        // outside.
        const double u = positive != 0 ? a : b, v = positive != 0 ? b : a;
        add_vertex(mesh, {d[0] * r * shape[0], d[1] * r * shape[1], d[2] * r * shape[2]},
                   repeat * (0.5 * u + 0.5) + 0.37 * face, repeat * (0.5 - 0.5 * v) + 0.21 * face, light);
      }
  const MeshRecipe grid{.n = n};
  for (uint32_t quad = 0; quad < 6 * n * n; ++quad) {
    uint32_t corners[6];
    quad_indices(grid, quad, corners);
    mesh.add_quad(corners[0], corners[1], corners[2], corners[5]);
  }
  return mesh;
}

// ---- Ground and cliff meshes ----

/// The share of light that stones leave on the ground around them: 1 in the open.
class ContactShade {
 public:
  explicit ContactShade(const std::vector<Stone>& stones) {
    for (const Stone& stone : stones) {
      const double reach = stone.radius * kReach;
      for (int j = cell(stone.s - reach); j <= cell(stone.s + reach); ++j)
        for (int i = cell(stone.x - reach); i <= cell(stone.x + reach); ++i) cells_[key(i, j)].push_back(stone);
    }
  }
  double at(double x, double s) const {
    const auto found = cells_.find(key(cell(x), cell(s)));
    double light = 1;
    if (found == cells_.end()) return light;
    for (const Stone& stone : found->second) {
      const double dx = x - stone.x, ds = (s - stone.s) * 1.15;
      const double distance = std::sqrt(dx * dx + ds * ds) / stone.radius;
      light *= 1.0 - 0.62 * ramp(kReach, 0.8, distance);
    }
    return light;
  }

 private:
  static constexpr double kReach = 1.7;  // radii
  static int cell(double place) { return static_cast<int>(std::floor(place / 2.0)); }
  static uint64_t key(int i, int j) { return uint64_t{static_cast<uint32_t>(i)} << 32 | static_cast<uint32_t>(j); }
  std::unordered_map<uint64_t, std::vector<Stone>> cells_;
};

constexpr uint32_t kGroundColumns = 240;
constexpr uint32_t kGroundRows = 250;
constexpr uint32_t kCliffRows = 120;
constexpr double kCliffHeight = 34.0;

Mesh make_ground(const std::vector<Stone>& stones, uint32_t threads) {
  const ContactShade shade(stones);
  struct Row {
    std::vector<Vec3> points;
    std::vector<double> light;
  };
  std::vector<Row> rows(kGroundRows + 1);
  runtime::parallel_for(rows.size(), thread_count(threads, rows.size()), [&](uint64_t j) {
    // The spacing of rows grows with the distance from the camera.
    const double t = static_cast<double>(j) / kGroundRows;
    const double s = kNear + (kCliffFoot + 6.0 - kNear) * (0.3 * t + 0.7 * t * t);
    for (uint32_t i = 0; i <= kGroundColumns; ++i) {
      const double x = (2.0 * i / kGroundColumns - 1.0) * (half_width(s) + 14.0);
      rows[j].points.push_back(ground_point(x, s));
      rows[j].light.push_back(shade.at(x, s) * (0.95 + 0.4 * fbm(14, 3, x / 7.0, s / 7.0, 0.5)));
    }
  });
  Mesh mesh{.name = "ground"};
  for (uint32_t j = 0; j <= kGroundRows; ++j)
    for (uint32_t i = 0; i <= kGroundColumns; ++i) {
      const Vec3& p = rows[j].points[i];
      // Metres along the slope, so that the texture is not stretched where it is steep.
      add_vertex(mesh, p, p[0] / 5.0, (p[2] - 0.6 * p[1]) / 5.5, rows[j].light[i]);
    }
  mesh.add_grid(kGroundColumns, kGroundRows, Mesh::Rows::kUp);
  return mesh;
}

/// A wall with ribs, ledges and gullies behind the top of the slope.
Mesh make_cliff() {
  Mesh mesh{.name = "cliff"};
  const double width = half_width(kCliffFoot) + 30.0;
  for (uint32_t j = 0; j <= kCliffRows; ++j)
    for (uint32_t i = 0; i <= kGroundColumns; ++i) {
      const double t = static_cast<double>(j) / kCliffRows;
      const double x0 = (2.0 * i / kGroundColumns - 1.0) * width;
      const double peaks = 1.0 + 1.1 * fbm(61, 4, x0 / 46.0, 0.5, 0.5);
      const double y = -5.0 + t * kCliffHeight * peaks;
      const double rib =
          1.0 - std::abs(fbm(62, 3, x0 / 16.0, y / 60.0, 0.5)) * 3.2;  // ridges where the noise crosses 0
      const double ledge = fbm(63, 3, x0 / 40.0, y / 5.0, 0.5);
      const double block = fbm(64, 5, x0 / 6.0, y / 5.0, 0.5);
      const double back = 17.0 * t + 6.0 * t * t - 5.5 * rib - 2.6 * ledge - 2.4 * block;
      const double s = kCliffFoot - 1.0 + back;
      const Vec3 p{x0 + 1.2 * block, slope_profile(kCliffFoot) + y, -s};
      const double light = 0.74 + 0.2 * rib + 0.5 * block + 0.3 * ledge;
      add_vertex(mesh, p, x0 / 11.0, -y / 11.0 - 0.05 * back, light);
    }
  mesh.add_grid(kGroundColumns, kCliffRows, Mesh::Rows::kUp);
  return mesh;
}

// ---- The document ----

/// A stone's appearance: a texture and a tint.
struct Look {
  const char* name;
  uint32_t texture;  // 0 granite, 1 sandstone, 2 slate, 3 ground
  std::array<double, 3> tint;
};

constexpr Look kLooks[] = {
    {"granite", 0, {1, 1, 1}},
    {"granite, dark", 0, {0.66, 0.66, 0.7}},
    {"sandstone", 1, {0.92, 0.92, 0.92}},
    {"sandstone, pale", 1, {1, 1, 1}},
    {"slate", 2, {1, 1, 1}},
    {"granite, warm", 0, {0.95, 0.85, 0.74}},
    {"ground", 3, {1, 1, 1}},
    {"cliff", 0, {0.86, 0.83, 0.8}},
};
constexpr uint32_t kGroundLook = 6, kCliffLook = 7;
constexpr uint32_t kRockLooks[kBoulderKinds + kStoneKinds] = {0, 2, 5, 4, 0, 1, 5, 4, 0, 3, 1, 2};

Result<void> add_looks(GltfWriter& writer, const SynthOptions& options) {
  const uint32_t size = *options.texture_size;
  const TextureRecipe recipes[] = {
      {"granite", TextureKind::kGranite, size, format::ImageCodec::kJpeg},
      {"sandstone", TextureKind::kSandstone, size, format::ImageCodec::kJpeg},
      {"slate", TextureKind::kSlate, size / 2, format::ImageCodec::kPng},
      {"ground", TextureKind::kGround, size, format::ImageCodec::kJpeg},
  };
  std::vector<uint32_t> textures;
  for (const TextureRecipe& recipe : recipes)
    textures.push_back(SCREE_TRY(add_texture(writer, recipe, options.threads, options.stop)));
  for (const Look& look : kLooks) {
    GltfMaterial material{.name = look.name, .texture = textures[look.texture]};
    std::copy(look.tint.begin(), look.tint.end(), material.base_color);
    writer.add_material(std::move(material));
  }
  return {};
}

}  // namespace

Result<SynthReport> write_slope(const SynthOptions& options) {
  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output, {}, options.existing));
  writer.stop_on(options.stop);
  SCREE_TRY(add_looks(writer, options));

  const uint32_t count = std::max(16u, static_cast<uint32_t>(std::lround(kStones * options.scale)));
  const std::vector<Stone> stones = scatter(count, options.seed);
  const std::vector<Placement> placements = place_stones(stones, options.seed);
  std::vector<Mesh> meshes;
  for (uint32_t kind = 0; kind < kBoulderKinds + kStoneKinds; ++kind) {
    const bool boulder = kind < kBoulderKinds;
    meshes.push_back(make_rock(kind, boulder ? kBoulderQuads : kStoneQuads, boulder ? 1.0 : 0.5));
    meshes.back().material = kRockLooks[kind];
  }
  meshes.push_back(make_ground(stones, options.threads));
  meshes.back().material = kGroundLook;
  meshes.push_back(make_cliff());
  meshes.back().material = kCliffLook;

  SynthReport report;
  for (Mesh& mesh : meshes) mesh.may_have_short_indices = true;
  for (const Mesh& mesh : meshes) {
    GltfPrimitive primitive = SCREE_TRY(append_primitive(writer, mesh));
    writer.add_mesh({mesh.name, {std::move(primitive)}});
    report.vertices += mesh.vertex_count();
    report.unique_triangles += mesh.indices.size() / 3;
  }
  std::vector<uint32_t> children;
  for (uint32_t mesh = kBoulderKinds + kStoneKinds; mesh < meshes.size(); ++mesh) {
    children.push_back(writer.add_node({.name = meshes[mesh].name, .mesh = mesh}));
    report.drawn_triangles += meshes[mesh].indices.size() / 3;
  }
  for (const Placement& placement : placements) report.drawn_triangles += meshes[placement.mesh].indices.size() / 3;
  report.instances = placements.size() + children.size();
  if (options.gpu_instancing) {
    SCREE_TRY(add_instanced_nodes(writer, placements, children));
  } else {
    for (const Placement& placement : placements)
      children.push_back(writer.add_node(node_of(placement, meshes[placement.mesh].name)));
  }
  children.push_back(add_camera(writer, {.name = "view", .y = std::numbers::pi / 4, .x = 16.0 / 9.0, .z_near = 0.1},
                                {0.5, ground_height(0.5, -16.0) + 2.6, 16.0}, {-2.0, 14.5, -40.0}));
  writer.add_scene({"slope", {writer.add_node({.name = "slope", .children = std::move(children)})}});
  SCREE_TRY(writer.finish());
  report.file_bytes = writer.total_bytes();
  return report;
}

}  // namespace scree::synth
