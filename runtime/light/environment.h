// Light from all around: a picture of the surroundings, filtered once for every roughness.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::runtime {

/// scree's built-in light of a clear day: a blue-grey sky over grey ground, with a broad bright patch in front at the
/// upper right. World space, y up. kernels::kEnvironmentFloats floats (kernels/shade/environment.h); the same for any
/// number of threads. Throws std::bad_alloc.
std::vector<float> make_sky(uint32_t threads);

/// The result of make_sky(), made by the first call and kept until the process ends.
const std::vector<float>& sky(uint32_t threads);

/// Makes the same from a Radiance picture of all directions: longitude across, latitude down, -z in the middle, y up.
/// Takes the file's size and 8 MiB of memory. Errors as MappedFile::open and read_hdr, with the file's name.
Result<std::vector<float>> load_environment(const std::string& path, uint32_t threads);

}  // namespace scree::runtime
