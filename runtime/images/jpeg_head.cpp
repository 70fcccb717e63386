#include "runtime/images/jpeg_head.h"

#include <new>
#include <span>
#include <string>

#include "runtime/images/jpeg_writer.h"

namespace scree::runtime {
namespace {

constexpr std::byte kFrameMarker{0xc0};

void put_big_endian(std::byte* at, uint32_t value) {
  at[0] = static_cast<std::byte>(value >> 8);
  at[1] = static_cast<std::byte>(value);
}

/// Offset of the frame's marker in a file that libjpeg wrote.
size_t find_frame(std::span<const std::byte> file) {
  size_t at = 2;  // after SOI
  while (file[at + 1] != kFrameMarker)
    at += 2 + (std::to_integer<size_t>(file[at + 2]) << 8 | std::to_integer<size_t>(file[at + 3]));
  return at;
}

}  // namespace

Result<JpegHead> make_jpeg_head(uint32_t width, uint32_t height, int quality, bool is_sharp,
                                uint16_t restart_mcus) try {
  constexpr uint32_t kMostSide = 65535;
  if (width == 0 || height == 0 || width > kMostSide || height > kMostSide)
    return Error{ErrorCode::kRange, "JPEG: " + std::to_string(width) + " x " + std::to_string(height) +
                                        " pixels, expected sides of 1 to 65535"};
  // libjpeg writes a picture of one MCU. Its header is then changed to the wanted size.
  JpegCoding coding;
  coding.width = coding.height = is_sharp ? 8 : 16;
  coding.components[0].h = coding.components[0].v = is_sharp ? 1 : 2;
  coding.quality = quality;
  coding.has_own_tables = false;
  JpegWriter writer = SCREE_TRY(JpegWriter::create(coding));
  const std::vector<uint8_t> row(size_t{3} * coding.width);
  for (uint32_t y = 0; y < coding.height; ++y) SCREE_TRY(writer.row(row));
  std::vector<std::byte> file = SCREE_TRY(writer.finish());
  format::JpegHeader header = SCREE_TRY(format::parse_jpeg(file));

  JpegHead head{std::move(file), header};
  head.bytes.resize(header.data_offset);
  const size_t frame = find_frame(head.bytes);
  put_big_endian(head.bytes.data() + frame + 5, height);
  put_big_endian(head.bytes.data() + frame + 7, width);
  head.header.width = static_cast<uint16_t>(width);
  head.header.height = static_cast<uint16_t>(height);
  std::byte restart[6] = {std::byte{0xff}, std::byte{0xdd}, std::byte{0}, std::byte{4}};
  put_big_endian(restart + 4, restart_mcus);
  head.bytes.insert(head.bytes.begin() + static_cast<ptrdiff_t>(frame), std::begin(restart), std::end(restart));
  head.header.restart_interval = restart_mcus;
  head.header.data_offset = head.bytes.size();
  return head;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "JPEG: out of memory"};
}

}  // namespace scree::runtime
