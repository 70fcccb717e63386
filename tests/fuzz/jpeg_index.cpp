// An indexed JPEG: opened, every MCU and group decoded as in kernels, and the file rebuilt.
#include "format/jpeg/index.h"

#include "format/jpeg/picture.h"
#include "format/jpeg/pixels.h"
#include "tests/format/jpeg/decode_mcu.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {

void jpeg_index(Bytes bytes) {
  const ExactCopy copy(bytes);
  const auto index = format::open_jpeg_index(copy.bytes());
  if (!index) return;
  const format::JpegView view = index->view();
  const uint32_t groups = std::min(index->layout.group_count, 512u);
  for (uint32_t mcu = 0; mcu < std::min(view.mcu_count, groups * view.group_mcus); ++mcu) {
    (void)tests::decode_jpeg_mcu(view, mcu, [&](uint32_t block, uint32_t k, int32_t value) {
      must(block < index->layout.mcu_blocks && k < 64 && value >= -32768 && value <= 32767,
           "a coefficient is one of its MCU");
    });
  }
  const std::vector<uint32_t> factors = format::jpeg_factors(*index);
  const format::JpegPicture picture = format::jpeg_picture(*index, factors.data());
  std::vector<uint8_t> samples(64 * size_t{index->layout.mcu_blocks} * index->layout.group_mcus);
  for (uint32_t group = 0; group < groups; ++group) {
    format::decode_jpeg_group(picture, group, samples.data());
    const uint32_t mcu = group * view.group_mcus;
    const uint32_t x = mcu % view.mcus_across * picture.mcu_width;
    const uint32_t y = mcu / view.mcus_across * picture.mcu_height;
    const format::JpegPlace place = format::jpeg_place(picture, x, y);
    must(place.group == group, "a pixel lies in its group");
    (void)format::jpeg_colour(picture, place, samples.data());
  }
  std::vector<std::byte> file(format::jpeg_file_bound(*index));
  const auto size = format::decode_jpeg_index(file, *index);
  if (!size) return;
  // An accepted index is complete: its rows decode, and the rebuilt file can be indexed again.
  must(bool(format::decode_jpeg_rows(*index, [](uint32_t, std::span<const uint8_t>) {})), "checked data decode");
  const auto header = format::parse_jpeg({file.data(), *size});
  must(bool(header), "a rebuilt file has a header");
  must(header->width == index->width && header->height == index->height, "a rebuilt file has the picture's size");
  const auto bound = format::jpeg_index_bound(*header, *size);
  must(bool(bound), "a rebuilt file can be indexed");
  std::vector<std::byte> again(*bound);
  must(bool(format::encode_jpeg_index(again, *header, {file.data(), *size})), "a rebuilt file is indexed");
}

}  // namespace scree::fuzz
