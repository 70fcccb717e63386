#include "tests/tools/flat_images.h"

#include <csetjmp>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include <png.h>

namespace scree::tests {
namespace {

void add_word(std::string& out, uint32_t value) {
  out.push_back(static_cast<char>(value >> 8));
  out.push_back(static_cast<char>(value & 255));
}

/// Adds a Huffman table of `count` ascending symbols with codes of `bits` bits each.
void add_huffman_table(std::string& out, uint32_t place, uint32_t bits, uint32_t count, uint32_t symbol_step) {
  add_word(out, 0xffc4);
  add_word(out, 2 + 17 + count);
  out.push_back(static_cast<char>(place));
  for (uint32_t length = 1; length <= 16; ++length) out.push_back(static_cast<char>(length == bits ? count : 0));
  for (uint32_t i = 0; i < count; ++i) out.push_back(static_cast<char>(i * symbol_step));
}

void add_scan(std::string& out, uint32_t first_component, uint32_t components, uint32_t spectrum_begin,
              uint32_t spectrum_end) {
  add_word(out, 0xffda);
  add_word(out, 6 + 2 * components);
  out.push_back(static_cast<char>(components));
  for (uint32_t i = 0; i < components; ++i) add_word(out, (first_component + i) << 8);  // tables 0
  add_word(out, spectrum_begin << 8 | spectrum_end);
  out.push_back(0);
}

/// Writes entropy-coded bits, with a zero after every 0xff byte.
class BitWriter {
 public:
  explicit BitWriter(std::string& out) : out_(out) {}
  void add(uint32_t value, uint32_t bits) {
    for (uint32_t i = bits; i-- > 0;) {
      byte_ = byte_ << 1 | (value >> i & 1);
      if (++held_ < 8) continue;
      out_.push_back(static_cast<char>(byte_));
      if (byte_ == 0xff) out_.push_back(0);
      byte_ = held_ = 0;
    }
  }
  void finish() {
    while (held_ != 0) add(1, 1);
  }

 private:
  std::string& out_;
  uint32_t byte_ = 0, held_ = 0;
};

}  // namespace

std::string flat_jpeg(uint32_t side, JpegKind kind) {
  const bool is_progressive = kind == JpegKind::kProgressive;
  const uint64_t blocks = uint64_t{side / 8} * (side / 8);  // per component
  std::string out;
  add_word(out, 0xffd8);
  add_word(out, 0xffdb);  // one quantisation table, of ones
  add_word(out, 67);
  out.push_back(0);
  out.append(64, 1);
  add_word(out, is_progressive ? 0xffc2 : 0xffc0);
  add_word(out, 17);
  out.push_back(8);
  add_word(out, side);
  add_word(out, side);
  out.push_back(3);
  for (uint32_t component = 1; component <= 3; ++component) {
    add_word(out, component << 8 | 0x11);
    out.push_back(0);
  }
  add_huffman_table(out, 0x00, 1, 1, 0);  // the bit 0 codes a difference of 0
  if (!is_progressive) {
    add_huffman_table(out, 0x10, 1, 1, 0);  // the bit 0 also ends a block
    add_scan(out, 1, 3, 0, 63);
    out.append(3 * blocks * 2 / 8, 0);
  } else {
    add_huffman_table(out, 0x10, 4, 15, 0x10);  // code k, plus a number of k more bits: 2^k blocks end here
    add_scan(out, 1, 3, 0, 0);
    out.append(3 * blocks / 8, 0);
    for (uint32_t component = 1; component <= 3; ++component) {
      add_scan(out, component, 1, 1, 63);
      BitWriter bits(out);
      for (uint64_t left = blocks; left > 0;) {
        uint32_t k = 14;
        while (uint64_t{1} << k > left) --k;
        const uint64_t more = left >= 32767 ? 16383 : left - (uint64_t{1} << k);
        bits.add(k, 4);
        bits.add(static_cast<uint32_t>(more), k);
        left -= (uint64_t{1} << k) + more;
      }
      bits.finish();
    }
  }
  add_word(out, 0xffd9);
  return out;
}

void write_flat_png(const std::string& path, uint32_t side, bool is_interlaced) {
  std::FILE* const file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) throw std::runtime_error("cannot write a picture for the test");
  const std::vector<png_byte> row(side);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  if (setjmp(png_jmpbuf(png)) != 0) throw std::runtime_error("cannot write a PNG for the test");
  png_init_io(png, file);
  png_set_compression_level(png, 1);
  png_set_filter(png, 0, PNG_FILTER_NONE);
  png_set_IHDR(png, info, side, side, 8, PNG_COLOR_TYPE_GRAY, is_interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (int passes = png_set_interlace_handling(png); passes > 0; --passes)
    for (uint32_t y = 0; y < side; ++y) png_write_row(png, row.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

}  // namespace scree::tests
