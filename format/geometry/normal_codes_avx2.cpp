#include "format/geometry/normal_codes.h"

#include <immintrin.h>

// As in cluster_scan_avx2.cpp, do not call inline functions of other headers here.
namespace scree::format::isa_avx2 {

// The steps of format::encode_octahedral(), in the same order and without fused operations, so that every value is the
// same. Integers are doubles here, and exact. A candidate past the edge is replaced by one that was compared before.
void encode_octahedral(const float* normals, uint32_t bits, uint32_t codes[4]) {
  const __m256d zero = _mm256_setzero_pd();
  const __m256d sign = _mm256_set1_pd(-0.0);
  const __m256d one = _mm256_set1_pd(1);
  const double half_steps = (1 << (bits - 1)) - 1;
  const __m256d half = _mm256_set1_pd(half_steps);
  const auto absolute = [&](__m256d value) { return _mm256_andnot_pd(sign, value); };
  // 1 or -1, with the sign of a value that is not -0.
  const auto sign_of = [&](__m256d value) {
    return _mm256_or_pd(one, _mm256_and_pd(sign, _mm256_cmp_pd(value, zero, _CMP_LT_OQ)));
  };

  const __m256d x = _mm256_set_pd(normals[9], normals[6], normals[3], normals[0]);
  const __m256d y = _mm256_set_pd(normals[10], normals[7], normals[4], normals[1]);
  const __m256d z = _mm256_set_pd(normals[11], normals[8], normals[5], normals[2]);
  const __m256d sum = _mm256_add_pd(_mm256_add_pd(absolute(x), absolute(y)), absolute(z));
  const __m256d is_direction = _mm256_and_pd(_mm256_cmp_pd(sum, zero, _CMP_GT_OQ),
                                             _mm256_cmp_pd(sum, _mm256_set1_pd(__builtin_inf()), _CMP_LT_OQ));
  __m256d u = _mm256_div_pd(x, sum);
  __m256d v = _mm256_div_pd(y, sum);
  const __m256d is_lower = _mm256_cmp_pd(z, zero, _CMP_LT_OQ);
  const __m256d folded_u = _mm256_mul_pd(_mm256_sub_pd(one, absolute(v)), sign_of(u));
  const __m256d folded_v = _mm256_mul_pd(_mm256_sub_pd(one, absolute(u)), sign_of(v));
  u = _mm256_blendv_pd(u, folded_u, is_lower);
  v = _mm256_blendv_pd(v, folded_v, is_lower);
  const auto first_of = [&](__m256d place) {
    const __m256d steps = _mm256_floor_pd(_mm256_mul_pd(_mm256_add_pd(place, one), half));
    return _mm256_sub_pd(_mm256_min_pd(steps, _mm256_add_pd(half, half)), half);
  };
  const __m256d u0 = first_of(u), v0 = first_of(v);
  const __m256d us[2] = {u0, _mm256_min_pd(_mm256_add_pd(u0, one), half)};
  const __m256d vs[2] = {v0, _mm256_min_pd(_mm256_add_pd(v0, one), half)};

  __m256d best_u = u0, best_v = v0, best_dot = zero, best_square = zero;
  for (int candidate = 0; candidate < 4; ++candidate) {
    const __m256d point_u = us[candidate & 1], point_v = vs[candidate >> 1];
    const __m256d abs_u = absolute(point_u), abs_v = absolute(point_v);
    const __m256d is_folded = _mm256_cmp_pd(_mm256_add_pd(abs_u, abs_v), half, _CMP_GT_OQ);
    const __m256d px =
        _mm256_blendv_pd(point_u, _mm256_mul_pd(_mm256_sub_pd(half, abs_v), sign_of(point_u)), is_folded);
    const __m256d py =
        _mm256_blendv_pd(point_v, _mm256_mul_pd(_mm256_sub_pd(half, abs_u), sign_of(point_v)), is_folded);
    const __m256d pz = _mm256_sub_pd(_mm256_sub_pd(half, abs_u), abs_v);
    const __m256d dot = _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(x, px), _mm256_mul_pd(y, py)), _mm256_mul_pd(z, pz));
    const __m256d square =
        _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(px, px), _mm256_mul_pd(py, py)), _mm256_mul_pd(pz, pz));
    const __m256d signed_dot = _mm256_mul_pd(dot, absolute(dot));
    if (candidate == 0) {
      best_dot = signed_dot;
      best_square = square;
      continue;
    }
    const __m256d is_better =
        _mm256_cmp_pd(_mm256_mul_pd(signed_dot, best_square), _mm256_mul_pd(best_dot, square), _CMP_GT_OQ);
    best_dot = _mm256_blendv_pd(best_dot, signed_dot, is_better);
    best_square = _mm256_blendv_pd(best_square, square, is_better);
    best_u = _mm256_blendv_pd(best_u, point_u, is_better);
    best_v = _mm256_blendv_pd(best_v, point_v, is_better);
  }
  // (0, 0) stands for (0, 0, 1).
  const auto code_of = [&](__m256d best) {
    return _mm256_cvttpd_epi32(_mm256_add_pd(_mm256_and_pd(best, is_direction), half));
  };
  const __m128i pairs = _mm_or_si128(code_of(best_u), _mm_slli_epi32(code_of(best_v), 16));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(codes), pairs);
}

}  // namespace scree::format::isa_avx2
