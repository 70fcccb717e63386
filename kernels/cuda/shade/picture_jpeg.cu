#include "kernels/cuda/shade/picture_jpeg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <new>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/common/warp.cuh"

namespace scree::kernels {
namespace {

constexpr uint32_t kBlockValues = 64;  // 8 x 8
constexpr uint32_t kTransformed = 4;   // JPEG blocks per block of threads, one coefficient per thread
constexpr uint32_t kSegmentBlocks = 30;
constexpr uint32_t kGuessedBytes = 24;  // per coded block
constexpr uint32_t kCoders = 4;         // warps per block of threads
// A block takes at most 11 + 11 bits of DC and 63 times 16 + 10 bits of AC.
constexpr uint32_t kSegmentWords = (kSegmentBlocks * (22 + 63 * 26) + 31) / 32;

/// The picture and the constants of the transform from pixels to coefficients.
struct Transform {
  const uint32_t* pixels;
  uint32_t width;
  uint32_t height;
  uint32_t mcus_across;
  uint32_t block_count;
  bool is_sharp;
  int16_t cosines[8][8];  // [frequency][position]: of the DCT, times 2^13
  uint16_t quant[2][64];  // row-major
  uint8_t zigzag[64];     // zigzag index of a row-major coefficient

  SCREE_HD uint32_t mcu_blocks() const { return is_sharp ? 3 : 6; }
};

/// Codes of symbols: code << 8 | length in bits.
struct Codes {
  uint32_t dc[2][16];
  uint32_t ac[2][256];
};

/// A segment's coded bytes. One more Segment follows the last; its offset is the number of bytes of all.
struct Segment {
  uint64_t offset;
  uint32_t bytes;
  uint32_t reserved;
};

struct SegmentBits {
  uint32_t words[kSegmentWords];  // bits begin at the most significant
};

/// 0 is luma; 1 and 2 are its differences from blue and red.
__device__ uint32_t component_of(uint32_t block_of_mcu, bool is_sharp) {
  return is_sharp ? block_of_mcu : block_of_mcu < 4 ? 0 : block_of_mcu - 3;
}

/// A component of a pixel, minus 128. Source: JFIF 1.02, in fixed point of 16 bits.
__device__ int32_t component_value(uint32_t rgba, uint32_t component) {
  const auto r = static_cast<int32_t>(rgba & 255u);
  const auto g = static_cast<int32_t>(rgba >> 8 & 255u);
  const auto b = static_cast<int32_t>(rgba >> 16 & 255u);
  constexpr int32_t kHalf = 1 << 15;
  if (component == 0) return ((19595 * r + 38470 * g + 7471 * b + kHalf) >> 16) - 128;
  if (component == 1) return (-11059 * r - 21709 * g + 32768 * b + kHalf - 1) >> 16;
  return (32768 * r - 27439 * g - 5329 * b + kHalf - 1) >> 16;
}

__device__ uint32_t pixel_at(const Transform& picture, uint32_t x, uint32_t y) {
  return picture.pixels[uint64_t{min_of(y, picture.height - 1)} * picture.width + min_of(x, picture.width - 1)];
}

/// The sample at (x, y) of a block.
__device__ int32_t sample_at(const Transform& picture, uint32_t block, uint32_t x, uint32_t y) {
  const uint32_t mcu = block / picture.mcu_blocks();
  const uint32_t k = block % picture.mcu_blocks();
  const uint32_t side = picture.is_sharp ? 8 : 16;
  const uint32_t left = mcu % picture.mcus_across * side;
  const uint32_t top = mcu / picture.mcus_across * side;
  const uint32_t component = component_of(k, picture.is_sharp);
  if (picture.is_sharp) return component_value(pixel_at(picture, left + x, top + y), component);
  if (component == 0) return component_value(pixel_at(picture, left + (k & 1) * 8 + x, top + (k >> 1) * 8 + y), 0);
  int32_t sum = 2;
  for (uint32_t i = 0; i < 4; ++i)
    sum += component_value(pixel_at(picture, left + 2 * x + (i & 1), top + 2 * y + (i >> 1)), component);
  return sum >> 2;
}

/// Transforms samples to quantised coefficients in zigzag order, blocks in coding order. Uses integers only, so that
/// every GPU makes the same file.
__global__ void __launch_bounds__(kBlockValues* kTransformed)
    transform_blocks(const __grid_constant__ Transform picture, int16_t* coefficients) {
  __shared__ int32_t samples[kTransformed][kBlockValues];
  __shared__ int32_t rows[kTransformed][kBlockValues];
  const uint32_t slot = threadIdx.x / kBlockValues;
  const uint32_t at = threadIdx.x % kBlockValues;
  const uint32_t y = at / 8;
  const uint32_t x = at % 8;
  const uint32_t block = blockIdx.x * kTransformed + slot;
  const bool is_there = block < picture.block_count;
  if (is_there) samples[slot][at] = sample_at(picture, block, x, y);
  __syncthreads();
  if (is_there) {
    int32_t sum = 1 << 8;  // keeps 4 bits of fraction
    for (uint32_t i = 0; i < 8; ++i) sum += picture.cosines[x][i] * samples[slot][8 * y + i];
    rows[slot][at] = sum >> 9;
  }
  __syncthreads();
  if (!is_there) return;
  int32_t sum = 0;  // times 2^17
  for (uint32_t i = 0; i < 8; ++i) sum += picture.cosines[y][i] * rows[slot][8 * i + x];
  const uint32_t table = component_of(block % picture.mcu_blocks(), picture.is_sharp) == 0 ? 0 : 1;
  const uint32_t step = uint32_t{picture.quant[table][at]} << 17;
  const uint32_t size = (static_cast<uint32_t>(sum < 0 ? -sum : sum) + step / 2) / step;
  const auto value = static_cast<int32_t>(min_of(size, 1023u));  // the limit of baseline codes
  coefficients[uint64_t{block} * kBlockValues + picture.zigzag[at]] = static_cast<int16_t>(sum < 0 ? -value : value);
}

__device__ uint32_t bit_width_of(uint32_t value) {
  return value == 0 ? 0 : 32 - static_cast<uint32_t>(__clz(static_cast<int>(value)));
}

/// Calls put(bits, count) for a code and the bits after it (T.81, F.1.2.1).
template <class Put>
__device__ void put_value(uint32_t code, int32_t value, uint32_t size, const Put& put) {
  const uint32_t low = static_cast<uint32_t>(value < 0 ? value - 1 : value) & ((1u << size) - 1);
  put((code >> 8) << size | low, (code & 255u) + size);
}

__device__ uint32_t size_of(int32_t value) {
  return bit_width_of(static_cast<uint32_t>(value < 0 ? -value : value));
}

/// Calls put(bits, count) for all codes of a block, in order. `difference`: of its DC from that of the previous block.
template <class Put>
__device__ void code_block(const int16_t* coefficients, int32_t difference, const uint32_t* dc, const uint32_t* ac,
                           const Put& put) {
  const uint32_t dc_size = size_of(difference);
  put_value(dc[dc_size], difference, dc_size, put);
  uint32_t zeros = 0;
  for (uint32_t k = 1; k < kBlockValues; ++k) {
    const int32_t value = coefficients[k];
    if (value == 0) {
      ++zeros;
      continue;
    }
    for (; zeros > 15; zeros -= 16) put(ac[0xf0] >> 8, ac[0xf0] & 255u);
    const uint32_t size = size_of(value);
    put_value(ac[zeros << 4 | size], value, size, put);
    zeros = 0;
  }
  if (zeros != 0) put(ac[0] >> 8, ac[0] & 255u);  // end of block
}

/// The distance in the scan, in blocks, to the previous block of the same component.
__device__ uint32_t blocks_back(uint32_t block_of_mcu, bool is_sharp) {
  return is_sharp ? 3 : block_of_mcu >= 4 ? 6 : block_of_mcu == 0 ? 3 : 1;
}

/// One warp per segment. Its lanes count the bits of their blocks, write the blocks one after the other, and copy the
/// bits as bytes into `bytes`, with a zero after each 255. The counter of all bytes may run past the capacity.
__global__ void __launch_bounds__(kWarpLanes* kCoders)
    code_segments(const int16_t* coefficients, uint32_t block_count, bool is_sharp, const Codes* codes,
                  Segment* segments, uint32_t segment_count, std::byte* bytes, uint64_t capacity) {
  __shared__ Codes shared_codes;
  __shared__ SegmentBits bits[kCoders];
  const auto* const from = reinterpret_cast<const uint32_t*>(codes);
  for (uint32_t i = threadIdx.x; i < sizeof(Codes) / 4; i += blockDim.x)
    reinterpret_cast<uint32_t*>(&shared_codes)[i] = from[i];
  uint32_t* const words = bits[threadIdx.x / kWarpLanes].words;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  for (uint32_t i = lane; i < kSegmentWords; i += kWarpLanes) words[i] = 0;
  __syncthreads();
  const uint32_t number = blockIdx.x * kCoders + threadIdx.x / kWarpLanes;
  if (number >= segment_count) return;

  const uint32_t block = number * kSegmentBlocks + lane;
  const bool has_block = lane < kSegmentBlocks && block < block_count;
  const uint32_t block_of_mcu = block % (is_sharp ? 3 : 6);
  const uint32_t table = component_of(block_of_mcu, is_sharp) == 0 ? 0 : 1;
  const int16_t* const values = coefficients + uint64_t{block} * kBlockValues;
  int32_t difference = 0;
  if (has_block) {
    const uint32_t back = blocks_back(block_of_mcu, is_sharp);
    difference = values[0] - (lane < back ? 0 : values[-static_cast<int32_t>(back * kBlockValues)]);
  }
  const auto code = [&](const auto& put) {
    if (has_block) code_block(values, difference, shared_codes.dc[table], shared_codes.ac[table], put);
  };
  uint32_t count = 0;
  code([&](uint32_t, uint32_t length) { count += length; });
  uint32_t bit_count;
  uint32_t at = sum_before(count, lane, bit_count);
  code([&](uint32_t value, uint32_t length) {
    const uint64_t window = uint64_t{value} << (64 - length - at % 32);
    atomicOr(words + at / 32, static_cast<uint32_t>(window >> 32));
    if (static_cast<uint32_t>(window) != 0) atomicOr(words + at / 32 + 1, static_cast<uint32_t>(window));
    at += length;
  });
  const uint32_t byte_count = (bit_count + 7) / 8;
  if (lane == 0 && bit_count % 8 != 0)  // pads the last byte with ones
    atomicOr(words + bit_count / 32, ((1u << (8 - bit_count % 8)) - 1) << (24 - bit_count / 8 % 4 * 8));
  __syncwarp();

  const auto byte_at = [&](uint32_t i) { return words[i / 4] >> (24 - i % 4 * 8) & 255u; };
  const uint32_t share = (byte_count + kWarpLanes - 1) / kWarpLanes;
  const uint32_t first = min_of(lane * share, byte_count);
  const uint32_t last = min_of(first + share, byte_count);
  uint32_t size = last - first;
  for (uint32_t i = first; i < last; ++i) size += byte_at(i) == 255 ? 1 : 0;
  uint32_t total;
  const uint32_t size_before = sum_before(size, lane, total);
  unsigned long long offset = 0;
  if (lane == 0) {
    auto& all = reinterpret_cast<unsigned long long&>(segments[segment_count].offset);
    offset = atomicAdd(&all, static_cast<unsigned long long>(total));
    segments[number].offset = offset;
    segments[number].bytes = total;
  }
  offset = __shfl_sync(~0u, offset, 0);
  if (offset + total > capacity) return;
  std::byte* to = bytes + offset + size_before;
  for (uint32_t i = first; i < last; ++i) {
    const uint32_t value = byte_at(i);
    *to++ = static_cast<std::byte>(value);
    if (value == 255) *to++ = std::byte{0};
  }
}

/// Assigns codes as in T.81, C.2.
template <size_t kCount>
void set_codes(const format::JpegHuffmanSpec& spec, uint32_t (&codes)[kCount]) {
  uint32_t code = 0;
  size_t symbol = 0;
  for (uint32_t length = 1; length <= spec.counts.size(); ++length, code <<= 1)
    for (uint32_t i = 0; i < spec.counts[length - 1]; ++i, ++code, ++symbol)
      if (spec.symbols[symbol] < kCount) codes[spec.symbols[symbol]] = code << 8 | length;
}

Transform make_transform(const uint32_t* pixels, const format::JpegHeader& head, bool is_sharp) {
  Transform out{};
  out.pixels = pixels;
  out.width = head.width;
  out.height = head.height;
  out.is_sharp = is_sharp;
  const uint32_t side = is_sharp ? 8 : 16;
  out.mcus_across = (out.width + side - 1) / side;
  out.block_count = out.mcus_across * ((out.height + side - 1) / side) * out.mcu_blocks();
  for (int u = 0; u < 8; ++u) {
    const double scale = std::sqrt(u == 0 ? 0.125 : 0.25) * 8192;
    for (int x = 0; x < 8; ++x)
      out.cosines[u][x] = static_cast<int16_t>(std::lround(scale * std::cos((2 * x + 1) * u * (M_PI / 16))));
  }
  for (size_t k = 0; k < kBlockValues; ++k) {
    const uint8_t at = format::kJpegNaturalOrder[k];
    out.zigzag[at] = static_cast<uint8_t>(k);
    for (size_t table = 0; table < 2; ++table) out.quant[table][at] = head.quant[head.components[table].quant][k];
  }
  return out;
}

}  // namespace

uint64_t CudaJpegCoder::device_bytes(uint32_t width, uint32_t height) {
  const uint64_t blocks =
      uint64_t{3} * ((width + 15) / 8) * ((height + 15) / 8);  // of 4:4:4, which has more than 4:2:0
  const uint64_t segments = (blocks + kSegmentBlocks - 1) / kSegmentBlocks + 1;
  return blocks * (kBlockValues * sizeof(int16_t) + kGuessedBytes) + segments * sizeof(Segment) + sizeof(Codes);
}

Result<std::vector<std::byte>> CudaJpegCoder::encode(const uint32_t* pixels, const format::JpegHeader& head,
                                                     bool is_sharp) try {
  const Transform picture = make_transform(pixels, head, is_sharp);
  const uint32_t count = (picture.block_count + kSegmentBlocks - 1) / kSegmentBlocks;
  Codes codes{};
  for (size_t i = 0; i < 2; ++i) {
    set_codes(head.dc[i], codes.dc[i]);
    set_codes(head.ac[i], codes.ac[i]);
  }
  Result<void> done = codes_.reserve(sizeof codes, "allocating a JPEG's tables");
  if (done)
    done = cuda_check(cudaMemcpy(codes_.data(), &codes, sizeof codes, cudaMemcpyHostToDevice),
                      "bringing the tables of a JPEG to the GPU");
  if (done)
    done = coefficients_.reserve(uint64_t{picture.block_count} * kBlockValues * sizeof(int16_t),
                                 "allocating a JPEG's coefficients");
  if (done) done = segments_.reserve((count + uint64_t{1}) * sizeof(Segment), "allocating a JPEG's segments");
  // Enough for pictures that are not noise.
  if (done) done = bytes_.reserve(uint64_t{picture.block_count} * kGuessedBytes, "allocating a JPEG");
  if (!done) return done.error();
  auto* const coefficients = reinterpret_cast<int16_t*>(coefficients_.data());
  auto* const device_segments = reinterpret_cast<Segment*>(segments_.data());
  transform_blocks<<<(picture.block_count + kTransformed - 1) / kTransformed, kBlockValues * kTransformed>>>(
      picture, coefficients);
  std::vector<Segment> segments(count + uint64_t{1});
  for (;;) {
    done = cuda_check(cudaMemsetAsync(device_segments + count, 0, sizeof(Segment), nullptr), "clearing a count");
    if (!done) return done.error();
    code_segments<<<(count + kCoders - 1) / kCoders, kWarpLanes * kCoders>>>(
        coefficients, picture.block_count, is_sharp, reinterpret_cast<const Codes*>(codes_.data()), device_segments,
        count, bytes_.data(), bytes_.bytes());
    done = cuda_check(cudaGetLastError(), "starting to code a JPEG");
    if (done)
      done = cuda_check(
          cudaMemcpy(segments.data(), device_segments, segments.size() * sizeof(Segment), cudaMemcpyDeviceToHost),
          "coding a JPEG");
    if (!done) return done.error();
    const uint64_t all = segments[count].offset;
    if (all <= bytes_.bytes()) break;
    if (done = bytes_.reserve(all, "allocating a JPEG"); !done) return done.error();
  }
  std::vector<std::byte> bytes(segments[count].offset);
  done = cuda_check(cudaMemcpy(bytes.data(), bytes_.data(), bytes.size(), cudaMemcpyDeviceToHost), "reading a JPEG");
  if (!done) return done.error();
  std::vector<std::byte> out;
  out.reserve(bytes.size() + 2 * uint64_t{count});
  for (uint32_t i = 0; i < count; ++i) {
    if (i != 0) out.insert(out.end(), {std::byte{0xff}, static_cast<std::byte>(0xd0 + (i - 1) % 8)});
    const std::byte* from = bytes.data() + segments[i].offset;
    out.insert(out.end(), from, from + segments[i].bytes);
  }
  return out;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to encode a picture"};
}

}  // namespace scree::kernels
