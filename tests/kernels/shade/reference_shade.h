// Shading in double precision, sample by sample, from world positions. The single precision of the shading passes is
// compared with it.
#pragma once

#include <array>

#include "kernels/shade/shade.h"
#include "tests/catch.h"

namespace scree::tests {

using Light = std::array<double, 3>;

/// The corners' weights where the ray through (x, y), in sub-pixels from the image's centre, intersects their plane;
/// not clamped. `turned`: whether the weights' sum is negative before it is divided out: the other side of the plane
/// faces the ray.
inline std::array<double, 3> plane_weights(const double corner[3][3], double x, double y, bool& turned) {
  double q[3][2];
  for (int i = 0; i < 3; ++i) {
    q[i][0] = corner[i][0] - x * corner[i][2];
    q[i][1] = corner[i][1] - y * corner[i][2];
  }
  std::array<double, 3> weights{};
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) {
    const double* a = q[(i + 1) % 3];
    const double* b = q[(i + 2) % 3];
    weights[i] = a[0] * b[1] - a[1] * b[0];
    sum += weights[i];
  }
  turned = sum < 0;
  for (double& weight : weights) weight /= sum;
  return weights;
}

/// Linear light of a covered sample, Show::kTexture.
inline Light reference_light(const kernels::SceneView& scene, const kernels::View& view, uint64_t sample, uint32_t px,
                             uint32_t py, const float* srgb) {
  using namespace kernels;
  const Hit hit = find_triangle(scene, sample_id(sample));
  const format::ChunkRecord& chunk = scene.chunks[hit.chunk];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const format::MatrixRecord& matrix = scene.matrices[scene.instances[hit.instance].matrix];
  const FrameView frame = make_frame_view(view);
  const Transform transform = make_transform(frame, matrix, mesh.lattice_exponent,
                                             mesh.position_encoding == format::PositionEncoding::kFloat32);
  const std::byte* page = scene.pages[chunk.page];
  const ChunkReader reader = make_reader(mesh, chunk, page, transform, hit.triangle);
  const format::ChunkStreams streams = streams_of(mesh, chunk);
  const std::byte* payload = page + chunk.offset;
  uint32_t vertex[3];
  reader.triangle(hit.triangle, vertex);
  double d[3][3];
  double corner[3][3];
  for (int i = 0; i < 3; ++i) {
    reader.exact_relative(vertex[i], d[i]);
    const double* rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
    for (int r = 0; r < 3; ++r) corner[i][r] = dot3(rows[r], d[i]) + rows[r][3];
    if (view.orthographic) corner[i][2] = 1;
  }
  const double x = px * 256.0 + 128 - static_cast<double>(frame.half_width);
  const double y = py * 256.0 + 128 - static_cast<double>(frame.half_height);
  bool turned;
  const std::array<double, 3> free = plane_weights(corner, x, y, turned);
  std::array<double, 3> weights = free;
  double sum = 0;
  for (double& weight : weights) {
    weight = std::clamp(weight, 0.0, 1.0);
    sum += weight;
  }
  for (double& weight : weights) weight /= sum;

  Light light{1, 1, 1};
  bool lit = true;
  if (mesh.material != format::kNone) {
    const format::MaterialRecord& material = scene.materials[mesh.material];
    lit = (material.flags & format::kMaterialUnlit) == 0;
    if ((mesh.attributes & format::kHasUv) != 0 && material.texture != format::kNone) {
      const TextureView& texture = scene.textures[material.texture];
      double uv[3][2];
      const double cosine = std::cos(static_cast<double>(material.uv_rotation));
      const double sine = std::sin(static_cast<double>(material.uv_rotation));
      for (int i = 0; i < 3; ++i) {
        uint64_t bit = uint64_t{vertex[i]} * (uint32_t{chunk.uv_bits[0]} + chunk.uv_bits[1]);
        double scaled[2];
        for (int c = 0; c < 2; ++c) {
          const uint32_t code =
              chunk.uv_bits[c] == 0 ? 0 : unpack_bits(payload + streams.uvs.offset, bit, chunk.uv_bits[c]);
          bit += chunk.uv_bits[c];
          scaled[c] = static_cast<double>(chunk.uv_min[c] + code) * format::exp2i(chunk.uv_exponent) *
                      static_cast<double>(material.uv_scale[c]);
        }
        uv[i][0] = cosine * scaled[0] + sine * scaled[1] + static_cast<double>(material.uv_offset[0]);
        uv[i][1] = cosine * scaled[1] - sine * scaled[0] + static_cast<double>(material.uv_offset[1]);
      }
      const auto place = [&](const std::array<double, 3>& w, int c) {
        return w[0] * uv[0][c] + w[1] * uv[1][c] + w[2] * uv[2][c];
      };
      float footprint = 0;
      for (int side = 0; side < 2; ++side) {
        bool other;
        const std::array<double, 3> moved =
            plane_weights(corner, x + (side == 0 ? 256 : 0), y + (side == 1 ? 256 : 0), other);
        const double du = (place(moved, 0) - place(free, 0)) * texture.width;
        const double dv = (place(moved, 1) - place(free, 1)) * texture.height;
        const double squared = other != turned ? 1e30 : std::min(du * du + dv * dv, 1e30);
        footprint = std::max(footprint, static_cast<float>(squared));
      }
      float rgb[3];
      SceneTexels::Lane lane;
      sample_texture(SceneTexels{scene.blocks}, lane, texture, srgb, texture_point(place(weights, 0)),
                     texture_point(place(weights, 1)), footprint, rgb);
      for (size_t c = 0; c < 3; ++c) light[c] = static_cast<double>(rgb[c]);
    }
    for (size_t c = 0; c < 3; ++c) light[c] *= static_cast<double>(material.base_color[c]);
  }
  if ((mesh.attributes & format::kHasColor) != 0) {
    const auto* colors = reinterpret_cast<const uint8_t*>(payload + streams.colors.offset);
    for (size_t c = 0; c < 3; ++c) {
      double color = 0;
      for (size_t i = 0; i < 3; ++i) color += weights[i] * colors[4 * size_t{vertex[i]} + c] / 255.0;
      light[c] *= color;
    }
  }
  if (!lit) return light;

  double ray[3];
  for (int i = 0; i < 3; ++i) {
    ray[i] = view.forward[i];
    if (!view.orthographic)
      ray[i] += view.right[i] * (x / static_cast<double>(frame.half_width) * view.half_width) -
                view.up[i] * (y / static_cast<double>(frame.half_height) * view.half_height);
  }
  normalize3(ray);
  double normal[3];
  if ((mesh.attributes & format::kHasNormal) != 0 && chunk.normal_bits >= 2) {
    double object[3] = {0, 0, 0};
    for (size_t i = 0; i < 3; ++i) {
      const uint64_t bit = uint64_t{vertex[i]} * (2u * chunk.normal_bits);
      float unit[3];
      format::decode_octahedral(
          unpack_bits(payload + streams.normals.offset, bit, chunk.normal_bits),
          unpack_bits(payload + streams.normals.offset, bit + chunk.normal_bits, chunk.normal_bits), chunk.normal_bits,
          unit);
      for (int j = 0; j < 3; ++j) object[j] += weights[i] * static_cast<double>(unit[j]);
    }
    for (int i = 0; i < 3; ++i) {
      double cofactors[3];
      cross3(matrix.rows[(i + 1) % 3], matrix.rows[(i + 2) % 3], cofactors);
      normal[i] = dot3(cofactors, object);
    }
  } else {
    double edge[2][3];
    for (int n = 0; n < 2; ++n) {
      const double object[3] = {d[n + 1][0] - d[0][0], d[n + 1][1] - d[0][1], d[n + 1][2] - d[0][2]};
      for (int j = 0; j < 3; ++j) edge[n][j] = dot3(matrix.rows[j], object);
      normalize3(edge[n]);
    }
    cross3(edge[0], edge[1], normal);
  }
  normalize3(normal);
  for (double& value : light) value *= 0.2 + 0.8 * std::fabs(dot3(normal, ray));
  return light;
}

}  // namespace scree::tests
