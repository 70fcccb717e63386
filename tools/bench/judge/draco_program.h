// Draco's own programs, where they are installed: nothing of it is linked.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>

#include "format/result.h"

namespace scree::bench {

/// What draco_encoder and draco_decoder say of a mesh.
struct DracoRun {
  uint64_t bytes = 0;
  // At most: wall time as they print it, or processor time with reading and writing the files; the least of three runs.
  double encode_s = INFINITY;
  double decode_s = INFINITY;
};

/// Whether both programs are on the path.
bool draco_is_there();

/// Encodes `input` (.obj) as `packed` with so many bits a position, 12 an axis of normals, at a level of 0 to 10 (7 is
/// its default), and decodes it to `output` (.ply). Paths hold no quotes. Errors kFile.
Result<DracoRun> run_draco(const std::string& input, const std::string& packed, const std::string& output,
                           uint32_t position_bits, int level);

}  // namespace scree::bench
