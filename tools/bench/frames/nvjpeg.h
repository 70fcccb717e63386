// NVIDIA's JPEG decoder, where it is installed: what the throughput of ours stands beside.
#pragma once

#include <string>
#include <vector>

#include "format/result.h"

namespace scree::bench {

struct NvJpegTimes {
  std::string way;         // "GPU Huffman, 12 at once"
  double seconds = 0;      // the wall clock's, from the files in host memory to interleaved RGB on the GPU
  double pixels = 0;       // of all pictures
  std::string impossible;  // why there are no times, else empty
};

/// Decodes JPEG files whole with each of nvJPEG's backends, one after another and all at once with a thread and a
/// stream each, after a first time that is not counted. libnvjpeg.so is loaded for it; empty where there is none.
/// Errors kFile: a JPEG that cannot be read. Whatever nvJPEG or the GPU refuses is a row's `impossible`.
Result<std::vector<NvJpegTimes>> time_nvjpeg(const std::vector<std::string>& files);

}  // namespace scree::bench
