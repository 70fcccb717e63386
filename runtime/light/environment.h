// Light from all around: a picture of the surroundings, filtered once for every roughness.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::runtime {

/// The light of a clear day, of scree's own: a blue-grey sky with a broad bright patch at the front's upper right over
/// grey ground. World space, y up. kernels::kEnvironmentFloats floats (kernels/shade/environment.h); the same for any
/// number of threads. Throws std::bad_alloc.
std::vector<float> make_sky(uint32_t threads);

/// make_sky(), made when it is first asked for and kept as long as the process.
const std::vector<float>& sky(uint32_t threads);

/// The same from a Radiance picture of all directions: longitude across, latitude down, -z in the middle, y up. Holds
/// the file and 8 MiB. Errors as MappedFile::open and read_hdr, the file named.
Result<std::vector<float>> load_environment(const std::string& path, uint32_t threads);

}  // namespace scree::runtime
