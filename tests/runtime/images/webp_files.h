// Makes WebP files for the tests, if scree is built with libwebp.
#pragma once

#include <webp/encode.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "tests/catch.h"

namespace scree::tests {

/// RGBA with similar neighbours, so that lossy coding is accurate.
inline std::vector<uint8_t> smooth_pixels(uint32_t width, uint32_t height, bool has_alpha) {
  std::vector<uint8_t> pixels;
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x)
      for (const uint32_t value : {255 * x / width, 255 * y / height, 255 * (x + y) / (width + height),
                                   has_alpha ? 255 - 127 * x / width : 255})
        pixels.push_back(static_cast<uint8_t>(value));
  return pixels;
}

/// `quality`: 0 is lossless; higher values are lossy.
inline std::vector<std::byte> make_webp(const std::vector<uint8_t>& rgba, uint32_t width, uint32_t height,
                                        float quality = 0) {
  WebPConfig config;
  REQUIRE(WebPConfigInit(&config) != 0);
  config.lossless = quality == 0 ? 1 : 0;
  config.exact = 1;  // keeps colours under alpha 0
  config.quality = quality == 0 ? 50 : quality;
  config.method = 1;
  WebPPicture picture;
  REQUIRE(WebPPictureInit(&picture) != 0);
  picture.use_argb = config.lossless;
  picture.width = static_cast<int>(width);
  picture.height = static_cast<int>(height);
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  REQUIRE(WebPPictureImportRGBA(&picture, rgba.data(), static_cast<int>(4 * width)) != 0);
  REQUIRE(WebPEncode(&config, &picture) != 0);
  std::vector<std::byte> file(writer.size);
  std::memcpy(file.data(), writer.mem, writer.size);
  WebPMemoryWriterClear(&writer);
  WebPPictureFree(&picture);
  return file;
}

}  // namespace scree::tests
