// Pictures in device memory as JPEGs: the host gets a file of some hundred kilobytes instead of all pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/jpeg/parse.h"
#include "format/result.h"
#include "kernels/cuda/common/check.h"

namespace scree::kernels {

/// MCUs per segment. Each segment ends in a restart marker, and one warp codes it, a lane per block: 30 blocks.
constexpr uint32_t jpeg_segment_mcus(bool is_sharp) {
  return is_sharp ? 10 : 5;
}

/// Keeps its buffers from picture to picture.
class CudaJpegCoder {
 public:
  /// Codes RGBA8 pixels, red in the low byte, rows from the top, on the default stream, and waits for the result.
  /// Returns the bytes of a baseline JPEG between `head` and the EOI marker. `head`: of a file of three components with
  /// Huffman tables 0 for luma and 1 for chroma, and a restart interval of jpeg_segment_mcus(); its size is the
  /// picture's. `is_sharp`: colours in full resolution (4:4:4) instead of a quarter (4:2:0). Source: T.81, A.3 and F.1.
  /// Errors kDevice, kMemory.
  Result<std::vector<std::byte>> encode(const uint32_t* pixels, const format::JpegHeader& head, bool is_sharp);

  /// Device memory for a picture of this size. A picture of noise needs more.
  static uint64_t device_bytes(uint32_t width, uint32_t height);

 private:
  DeviceBuffer codes_;
  DeviceBuffer coefficients_;
  DeviceBuffer segments_;
  DeviceBuffer bytes_;
};

}  // namespace scree::kernels
