// Places on textures: conversion of coordinates to integers, and wrap modes. Source: spec/rasterization.md, resolve.
#pragma once

#include <cmath>

#include "format/geometry/quantize.h"
#include "format/layout.h"
#include "kernels/math.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// A place along one axis of a texture: the coordinate in 2^-32 of the texture's side, modulo 2^32 sides. It is an
/// integer, because many GPUs have few units for double precision.
using TexturePoint = uint64_t;

/// Not inlined, because few pixels need it.
[[gnu::noinline]] SCREE_HD inline TexturePoint texture_point(double coordinate) {
  if (!(abs_of(coordinate) < 2251799813685248.0)) return 0;  // 2^51; also NaN
  const double whole = std::floor(coordinate);
  const uint64_t fraction = static_cast<uint64_t>((coordinate - whole) * 4294967296.0 + 0.5);
  return (static_cast<uint64_t>(static_cast<int64_t>(whole)) << 32) + fraction;
}

/// Limited to +-2^23, beyond which a float has no fraction.
SCREE_HD inline TexturePoint texture_point(float coordinate) {
  const float limited = min_of(max_of(coordinate, -8388608.0f), 8388608.0f);
  const float whole = round_even(limited);
  const int32_t fraction = static_cast<int32_t>((limited - whole) * 2147483648.0f);  // of magnitude 2^30 at most
  return (static_cast<uint64_t>(static_cast<int64_t>(whole)) << 32) + 2 * static_cast<uint64_t>(int64_t{fraction});
}

/// The point of `code` times 2^exponent, for an exponent of a lattice.
SCREE_HD inline TexturePoint texture_point(int64_t code, int32_t exponent) {
  if (exponent >= -32 && exponent < 32) return static_cast<uint64_t>(code) << (exponent + 32);
  return texture_point(static_cast<double>(code) * format::exp2i(exponent));
}

/// A point brought into the texture by its wrap mode, in 2^-32 of the texture's side.
SCREE_HD inline uint32_t wrap_point(TexturePoint point, format::Wrap wrap) {
  const uint32_t fraction = static_cast<uint32_t>(point);
  const int32_t whole = static_cast<int32_t>(point >> 32);
  if (wrap == format::Wrap::kClamp) return whole < 0 ? 0u : whole > 0 ? ~0u : fraction;
  if (wrap == format::Wrap::kMirror && (whole & 1) != 0) return ~fraction;
  return fraction;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
