// Lit surfaces, compared with glTF 2.0's appendix B in double precision, and with cases whose result needs no formula.
#include "kernels/shade/surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "kernels/shade/material_views.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/kernels/shade_samples.h"
#include "tests/kernels/square.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

constexpr double kPiWide = 3.14159265358979323846;

using Vector = std::array<double, 3>;

/// A surface whose normal is +z, in double precision.
struct Material {
  Vector base{1, 1, 1};
  double metallic = 0, roughness = 1, specular = 1, ior = 1.5;
  Vector specular_color{1, 1, 1};
};

Float3 narrow(const Vector& a) {
  return {static_cast<float>(a[0]), static_cast<float>(a[1]), static_cast<float>(a[2])};
}

Vector share_of(const Material& material, const Vector& viewer, const Vector& light) {
  const SurfaceValues values{.metallic = static_cast<float>(material.metallic),
                             .roughness = static_cast<float>(material.roughness),
                             .specular = static_cast<float>(material.specular),
                             .specular_color = narrow(material.specular_color)};
  SurfacePoint at{};
  set_reflectance(values, narrow(material.base), static_cast<float>(material.ior), at);
  at.normal = {0, 0, 1};
  at.to_viewer = narrow(viewer);
  const Float3 share = reflected_share(at, narrow(light));
  return {static_cast<double>(share.x), static_cast<double>(share.y), static_cast<double>(share.z)};
}

/// Appendix B's metal and dielectric, with KHR_materials_specular and KHR_materials_ior, and their mix.
Vector expected_share(const Material& material, const Vector& v, const Vector& l) {
  const Vector n{0, 0, 1};
  const auto product = [](const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  Vector h{v[0] + l[0], v[1] + l[1], v[2] + l[2]};
  const double length = std::sqrt(product(h, h));
  for (double& c : h) c /= length;
  const double n_l = product(n, l), n_v = std::abs(product(n, v)), n_h = product(n, h), v_h = product(v, h);
  if (n_l <= 0) return {};
  const double a2 = std::pow(material.roughness, 4);
  const double d = a2 / (kPiWide * std::pow(n_h * n_h * (a2 - 1) + 1, 2));
  const double g1 = 2 * n_l / (n_l + std::sqrt(a2 + (1 - a2) * n_l * n_l));
  const double g2 = 2 * n_v / (n_v + std::sqrt(a2 + (1 - a2) * n_v * n_v));
  const double glossy = d * g1 * g2 / (4 * n_l * n_v);
  const auto fresnel = [&](double f0) { return f0 + (1 - f0) * std::pow(1 - std::abs(v_h), 5); };
  const double root = (1 - material.ior) / (1 + material.ior);
  Vector coat;
  for (size_t c = 0; c < 3; ++c) coat[c] = fresnel(std::min(material.specular_color[c] * root * root, 1.0));
  const double entering = 1 - material.specular * std::max({coat[0], coat[1], coat[2]});
  Vector share;
  for (size_t c = 0; c < 3; ++c) {
    const double dielectric = entering * material.base[c] / kPiWide + material.specular * coat[c] * glossy;
    const double metal = fresnel(material.base[c]) * glossy;
    share[c] = (dielectric + (metal - dielectric) * material.metallic) * n_l;
  }
  return share;
}

/// A white square from -1 to 1 that faces +z and the camera, with one surface.
struct LitSquare {
  explicit LitSquare(const Soup& soup = square(0, 0, 1, 1)) {
    encoding.material = builder.material(0);
    builder.instance(builder.mesh(soup, encoding), builder.identity());
    surface.roughness = 1;
    surface.ior = 1.5f;
    surface.normal_scale = surface.occlusion_strength = 1;
    for (format::SurfaceTexture& use : surface.textures) use = {format::kNone, {0, 0}, {1, 1}, 0};
  }

  void set_texture(format::SurfaceUse use, const std::array<uint8_t, 4>& rgba) {
    texel = rgba;
    builder.textures.push_back({.texels = texel.data(), .width = 1, .height = 1, .level_count = 1});
    surface.textures[static_cast<size_t>(use)].texture = static_cast<uint32_t>(builder.textures.size() - 1);
  }

  /// The colour at the picture's middle.
  std::array<float, 3> middle(const View& view, const ShadeOptions& options) {
    SceneView scene = builder.view();
    scene.surfaces = &surface;
    scene.surface_count = 1;
    MaterialView material{.surface = 0};
    bundle_textures(scene, {&material, 1});
    scene.material_views = &material;
    scene.lights = lights.data();
    scene.light_count = static_cast<uint32_t>(lights.size());
    scene.environment = environment.empty() ? nullptr : environment.data();
    const std::vector<uint64_t> samples = draw(scene, view);
    std::vector<float> rgba(4 * samples.size());
    scree::tests::shade_samples(scene, view, samples, options, rgba);
    const size_t at = 4 * (size_t{view.height / 2} * view.width + view.width / 2);
    return {rgba[at], rgba[at + 1], rgba[at + 2]};
  }

  SceneBuilder builder;
  Encoding encoding;
  format::SurfaceRecord surface{};
  std::vector<PlacedLight> lights;
  std::vector<float> environment;
  std::array<uint8_t, 4> texel{};
};

/// The same light from everywhere.
std::vector<float> even_light(float value) {
  std::vector<float> out(kEnvironmentFloats, value);
  std::fill_n(out.begin(), 27, 0.0f);
  for (size_t c = 0; c < 3; ++c) out[c] = value / 0.282095f;
  return out;
}

PlacedLight sun(float x, float y, float z, float lux) {
  PlacedLight light{};
  const float length = std::sqrt(x * x + y * y + z * z);
  light.direction[0] = -x / length;  // the light comes from there
  light.direction[1] = -y / length;
  light.direction[2] = -z / length;
  for (float& c : light.color) c = lux;
  light.kind = format::LightKind::kDirectional;
  return light;
}

std::vector<View> cameras() {
  return {look_at({0, 0, 3}, {0, 0, 0}, 33, 33), orthographic(look_at({0, 0, 3}, {0, 0, 0}, 33, 33), 1.5, 0.5, 8)};
}

ShadeOptions lit_by(Lighting lighting) {
  return {.lighting = lighting};
}

}  // namespace

TEST_CASE("surface: the BRDF equals glTF's appendix B", "[surface]") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto direction = [&] {
    const double z = unit(random), angle = 2 * kPiWide * unit(random), r = std::sqrt(1 - z * z);
    return Vector{r * std::cos(angle), r * std::sin(angle), z};
  };
  for (int i = 0; i < 20000; ++i) {
    const Vector v = direction(), l = direction();
    if (v[2] < 0.01) continue;
    const Material material{{unit(random), unit(random), unit(random)},
                            unit(random),
                            0.1 + 0.9 * unit(random),
                            unit(random),
                            1 + unit(random),
                            {2 * unit(random), 2 * unit(random), 2 * unit(random)}};
    const Vector expected = expected_share(material, v, l), found = share_of(material, v, l);
    for (size_t c = 0; c < 3; ++c) REQUIRE(found[c] == Approx(expected[c]).epsilon(2e-3).margin(1e-5));
  }
}

TEST_CASE("surface: examples of the specification", "[surface]") {
  size_t mixed = 0;
  for (const SpecVector& vector : spec_vectors("surfaces.txt")) {
    const auto three = [&](const char* key, size_t first = 0) {
      const std::vector<float> values = vector.floats(key);
      REQUIRE(values.size() == first + 3);
      return Vector{static_cast<double>(values[first]), static_cast<double>(values[first + 1]),
                    static_cast<double>(values[first + 2])};
    };
    const Material material{three("base"),
                            vector.number("metallic"),
                            vector.number("roughness"),
                            static_cast<double>(vector.floats("specular").at(0)),
                            vector.number("ior"),
                            three("specular", 1)};
    mixed += material.metallic > 0 && material.metallic < 1;
    const Vector expected = three("share"), found = share_of(material, three("viewer"), three("light"));
    for (size_t c = 0; c < 3; ++c) CHECK(found[c] == Approx(expected[c]).epsilon(1e-3));
  }
  CHECK(mixed > 5);
}

/// The share of equal light from the whole hemisphere that a metal reflects, integrated over GGX's half vectors.
double reflected_of_all(double base, double roughness, double n_v) {
  constexpr int kRings = 256, kSteps = 64;
  const Vector v{std::sqrt(1 - n_v * n_v), 0, n_v};
  const double a2 = std::pow(roughness, 4);
  double sum = 0;
  for (int i = 0; i < kRings; ++i) {
    const double u = (i + 0.5) / kRings;
    const double cosine = std::sqrt((1 - u) / (1 + (a2 - 1) * u)), sine = std::sqrt(1 - cosine * cosine);
    const double density = cosine * a2 / (kPiWide * std::pow(cosine * cosine * (a2 - 1) + 1, 2));
    for (int k = 0; k < kSteps; ++k) {
      const double angle = (k + 0.5) / kSteps * 2 * kPiWide;
      const Vector h{sine * std::cos(angle), sine * std::sin(angle), cosine};
      const double v_h = v[0] * h[0] + v[2] * h[2];
      if (v_h <= 0) continue;
      const Vector l{2 * v_h * h[0] - v[0], 2 * v_h * h[1], 2 * v_h * h[2] - v[2]};
      const Material metal{.base = {base, base, base}, .metallic = 1, .roughness = roughness};
      sum += expected_share(metal, v, l)[0] * 4 * v_h / density;
    }
  }
  return sum / (kRings * kSteps);
}

TEST_CASE("surface: the reflectance of light from all around is the integral of the BRDF", "[surface]") {
  for (const float roughness : {0.1f, 0.3f, 0.5f, 0.7f, 0.85f, 1.0f}) {
    for (const float n_v : {0.2f, 0.4f, 0.6f, 0.8f, 1.0f}) {
      CAPTURE(roughness, n_v);
      float scale, bias;
      split_sum(roughness, n_v, scale, bias);
      CHECK(scale + bias == Approx(reflected_of_all(1, double{roughness}, double{n_v})).margin(0.014));
      CHECK(bias == Approx(reflected_of_all(0, double{roughness}, double{n_v})).margin(0.007));
    }
  }
  float largest = 0, least = 1;
  for (int i = 45; i <= 1000; ++i) {
    for (int j = 0; j <= 100; ++j) {
      float scale, bias;
      split_sum(static_cast<float>(i) / 1000, static_cast<float>(j) / 100, scale, bias);
      largest = std::max(largest, scale + bias);
      least = std::min({least, scale, bias});
    }
  }
  CHECK(largest <= 1.0f);
  CHECK(least >= 0.0f);
}

TEST_CASE("surface: light from all around is a mix of a dielectric's and a metal's", "[surface]") {
  const View view = cameras()[0];
  LitSquare scene;
  scene.environment = even_light(1);
  const float base[] = {0.9f, 0.6f, 0.2f};
  std::copy_n(base, 3, scene.builder.materials[0].base_color);
  scene.surface.roughness = 0.5f;
  scene.surface.specular = 1;
  std::fill_n(scene.surface.specular_color, 3, 1.0f);
  float scale, bias;
  split_sum(0.5f, 1, scale, bias);
  for (const float metallic : {0.0f, 0.3f, 0.5f, 0.8f, 1.0f}) {
    scene.surface.metallic = metallic;
    const auto lit = scene.middle(view, lit_by(Lighting::kEnvironment));
    const float coat = 0.04f * scale + bias;
    for (size_t c = 0; c < 3; ++c) {
      const float dielectric = (1 - coat) * base[c] + coat;
      const float metal = base[c] * scale + bias;
      CHECK(lit[c] == Approx(dielectric + (metal - dielectric) * metallic).epsilon(2e-3));
    }
  }
}

TEST_CASE("surface: white stays white under uniform light, and metal reflects no more than it receives", "[surface]") {
  for (const View& view : cameras()) {
    LitSquare scene;
    scene.environment = even_light(1);
    for (const float roughness : {0.0f, 0.3f, 1.0f}) {
      scene.surface.roughness = roughness;
      scene.surface.metallic = 0;
      for (const float c : scene.middle(view, lit_by(Lighting::kAuto))) CHECK(c == Approx(1).margin(2e-3));
      scene.surface.metallic = 1;
      const float metal = scene.middle(view, lit_by(Lighting::kEnvironment))[0];
      CHECK(metal <= 1.0f);
      CHECK(metal >= 0.29f);
    }
    scene.surface.metallic = 0;
    ShadeOptions brighter = lit_by(Lighting::kAuto);
    brighter.exposure = 2;
    CHECK(scene.middle(view, brighter)[1] == Approx(2).margin(4e-3));
    scene.set_texture(format::SurfaceUse::kOcclusion, {51, 255, 255, 255});
    CHECK(scene.middle(view, lit_by(Lighting::kAuto))[0] == Approx(0.2).margin(1e-3));
    scene.surface.occlusion_strength = 0.5f;
    CHECK(scene.middle(view, lit_by(Lighting::kAuto))[0] == Approx(0.6).margin(1e-3));
    scene.surface.emission[2] = 3;
    CHECK(scene.middle(view, lit_by(Lighting::kAuto))[2] == Approx(3.6).margin(1e-3));
    // The camera's light applies without an environment or on request. Unlit materials have their own colour.
    CHECK(scene.middle(view, lit_by(Lighting::kCamera))[0] == Approx(0.2 * 0.6 + 0.8).margin(1e-3));
    scene.environment.clear();
    CHECK(scene.middle(view, lit_by(Lighting::kAuto))[0] == Approx(0.2 * 0.6 + 0.8).margin(1e-3));
    scene.builder.materials[0].flags = format::kMaterialUnlit;
    CHECK(scene.middle(view, lit_by(Lighting::kAuto))[2] == 1.0f);
  }
}

TEST_CASE("surface: textures of roughness, metalness and specular multiply their factors", "[surface]") {
  const View view = cameras()[0];
  const auto lit = [&](float metallic, float specular, const std::array<uint8_t, 4>* texel, format::SurfaceUse use) {
    LitSquare scene;
    scene.environment = even_light(1);
    scene.builder.materials[0].base_color[0] = 0.25f;
    scene.surface.metallic = metallic;
    scene.surface.specular = specular;
    if (texel != nullptr) scene.set_texture(use, *texel);
    return scene.middle(view, lit_by(Lighting::kEnvironment))[0];
  };
  const std::array<uint8_t, 4> half{0, 255, 51, 255}, alpha{0, 0, 0, 51};
  using Use = format::SurfaceUse;
  CHECK(lit(1, 1, &half, Use::kMetallicRoughness) == Approx(lit(0.2f, 1, nullptr, Use::kMetallicRoughness)));
  CHECK(lit(0, 1, &alpha, Use::kSpecular) == Approx(lit(0, 0.2f, nullptr, Use::kSpecular)));
  CHECK(lit(0, 0, nullptr, Use::kSpecular) == Approx(0.25f));  // only diffuse light
}

TEST_CASE("surface: a normal map's red points along u, its green against v", "[surface]") {
  for (const View& view : cameras()) {
    for (const bool is_mirrored : {false, true}) {
      const auto lit = [&](const std::array<uint8_t, 4>& normal, const PlacedLight& light) {
        LitSquare scene(is_mirrored ? square(1, 0, 0, 1) : square(0, 0, 1, 1));
        scene.surface.specular = 0;
        scene.lights = {light};
        scene.set_texture(format::SurfaceUse::kNormalMap, normal);
        return scene.middle(view, lit_by(Lighting::kScene))[0];
      };
      const float along = is_mirrored ? -1.0f : 1.0f;
      const std::array<uint8_t, 4> right{218, 128, 218, 255}, up{128, 218, 218, 255}, flat{128, 128, 255, 255};
      CHECK(lit(right, sun(along, 0, 1, 1)) == Approx(1 / kPiWide).epsilon(0.01));
      CHECK(lit(right, sun(-along, 0, 1, 1)) == Approx(0).margin(0.01));
      CHECK(lit(up, sun(0, 1, 1, 1)) == Approx(1 / kPiWide).epsilon(0.01));
      CHECK(lit(up, sun(0, -1, 1, 1)) == Approx(0).margin(0.01));
      CHECK(lit(flat, sun(0, 0, 1, 1)) == Approx(1 / kPiWide).epsilon(0.01));
    }
  }
}

TEST_CASE("surface: a texture with second coordinates is sampled at them", "[surface]") {
  // Black on the left and white on the right. The first coordinates all lie on the left, the second ones on the right.
  const std::array<uint8_t, 8> texels{0, 0, 0, 255, 255, 255, 255, 255};
  for (const View& view : cameras()) {
    for (const uint32_t exact_scale : {1u, 1u << 17}) {  // 2^17: in double, as for many texels per triangle
      Soup soup = square(0.125, 0, 0.375, 1);
      soup.second_uvs = square(0.625, 0, 0.875, 1).uvs;
      const auto emitted = [&](uint32_t second_uv, bool has_second) {
        Soup made = soup;
        if (!has_second) made.second_uvs.clear();
        LitSquare scene(made);
        scene.builder.textures.push_back({.texels = texels.data(),
                                          .width = 2,
                                          .height = 1,
                                          .level_count = 1,
                                          .wrap_s = format::Wrap::kRepeat,
                                          .wrap_t = format::Wrap::kRepeat});
        format::SurfaceTexture& use = scene.surface.textures[static_cast<size_t>(format::SurfaceUse::kEmission)];
        use.texture = 0;
        use.uv_scale[1] = static_cast<float>(exact_scale);
        std::fill_n(scene.surface.emission, 3, 0.5f);
        scene.surface.second_uv = second_uv;
        return scene.middle(view, lit_by(Lighting::kScene))[0];
      };
      constexpr uint32_t kBit = 1u << static_cast<uint32_t>(format::SurfaceUse::kEmission);
      CHECK(emitted(0, true) == Approx(0).margin(1e-3));
      CHECK(emitted(kBit, true) == Approx(0.5));
      CHECK(emitted(kBit, false) == Approx(0.5));  // a mesh without them is drawn without the texture
    }
  }
}

TEST_CASE("surface: a mesh's own tangents turn its normal map", "[surface]") {
  constexpr double kDegree = kPiWide / 180;
  for (const View& view : cameras()) {
    for (const bool is_mirrored : {false, true}) {  // the instance
      for (const float sign : {1.0f, -1.0f}) {      // of the bitangent
        for (const double degrees : {0.0, 35.0, 140.0, 250.0}) {
          const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
          Soup soup = square(0, 0, 1, 1);
          for (int i = 0; i < 4; ++i) {
            soup.normals.insert(soup.normals.end(), {0, 0, 1});
            soup.tangents.insert(soup.tangents.end(), {static_cast<float>(c), static_cast<float>(s), 0, sign});
          }
          const auto lit = [&](const std::array<uint8_t, 4>& normal, double x, double y) {
            LitSquare scene(soup);
            const double along = is_mirrored ? -1 : 1;
            scene.builder.instances[0].matrix = scene.builder.matrix({along, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
            scene.surface.specular = 0;
            scene.builder.materials[0].flags |= format::kMaterialDoubleSided;
            scene.lights = {sun(static_cast<float>(along * x), static_cast<float>(y), 1, 1)};
            scene.set_texture(format::SurfaceUse::kNormalMap, normal);
            return scene.middle(view, lit_by(Lighting::kScene))[0];
          };
          CAPTURE(is_mirrored, sign, degrees);
          const std::array<uint8_t, 4> right{218, 128, 218, 255}, up{128, 218, 218, 255};
          // Red points along the tangent, green along cross(normal, tangent) times the sign.
          CHECK(lit(right, c, s) == Approx(1 / kPiWide).epsilon(0.01));
          CHECK(lit(right, -c, -s) == Approx(0).margin(0.01));
          CHECK(lit(up, -s * sign, c * sign) == Approx(1 / kPiWide).epsilon(0.01));
          CHECK(lit(up, s * sign, -c * sign) == Approx(0).margin(0.01));
        }
      }
    }
  }
}

TEST_CASE("surface: lights of a scene fall off by the formulas of KHR_lights_punctual", "[surface]") {
  for (const View& view : cameras()) {
    LitSquare scene;
    scene.surface.specular = 0;
    PlacedLight light = sun(0, 0, 1, 5);
    scene.lights = {light};
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == Approx(5 / kPiWide).epsilon(1e-3));
    light.kind = format::LightKind::kPoint;
    light.position[2] = 2;
    scene.lights = {light};
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == Approx(5 / kPiWide / 4).epsilon(1e-2));
    scene.lights[0].range = 4;
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == Approx(5 / kPiWide / 4 * (1 - 1.0 / 16)).epsilon(1e-2));
    scene.lights[0].range = 1.5f;
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == 0.0f);
    scene.lights[0].range = 0;
    // A spot light that points 30 degrees off the middle, with cones of 0 and 60 degrees.
    scene.lights[0].kind = format::LightKind::kSpot;
    scene.lights[0].direction[0] = 0.5f;
    scene.lights[0].direction[2] = -std::sqrt(0.75f);
    scene.lights[0].cone_scale = 2;
    scene.lights[0].cone_offset = -1;
    const double cone = std::sqrt(0.75) * 2 - 1;
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == Approx(5 / kPiWide / 4 * cone * cone).epsilon(2e-2));
    scene.lights[0].direction[2] = std::sqrt(0.75f);
    CHECK(scene.middle(view, lit_by(Lighting::kScene))[0] == 0.0f);
  }
}

TEST_CASE("surface: scenes of base colours are lit by the camera unless another light is requested", "[surface]") {
  LitSquare scene;
  const SceneView view = scene.builder.view();
  CHECK(!shades_surfaces(view, {}));
  CHECK(!shades_surfaces(view, lit_by(Lighting::kCamera)));
  CHECK(!shades_surfaces(view, lit_by(Lighting::kEnvironment)));  // there is none
  CHECK(shades_surfaces(view, lit_by(Lighting::kScene)));
  const ShadeOptions color{.show = Show::kColor};
  SceneView with = view;
  with.surface_count = 1;
  CHECK(shades_surfaces(with, {}));
  CHECK(!shades_surfaces(with, color));
}
