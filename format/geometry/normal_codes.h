// Computes octahedral codes of four normals at a time with AVX2.
#pragma once

#include <cstdint>

namespace scree::format::isa_avx2 {

#ifdef SCREE_HAS_AVX2_CODE
inline constexpr bool kEncodesNormals = true;
/// The codes of four normals, as format::encode_octahedral() returns them. `normals`: 12 floats. `bits`: 2 to 16.
void encode_octahedral(const float* normals, uint32_t bits, uint32_t codes[4]);
#else
inline constexpr bool kEncodesNormals = false;
inline void encode_octahedral(const float*, uint32_t, uint32_t*) {}
#endif

}  // namespace scree::format::isa_avx2
