// The fuzz targets: functions that accept any bytes and must neither crash, nor hang, nor break a promise. Each is a
// libFuzzer program (SCREE_FUZZ, scripts/fuzz). Over the committed corpus it is also a normal test (test_corpus.cpp).
#pragma once

#include <cstddef>
#include <span>

namespace scree::fuzz {

using Bytes = std::span<const std::byte>;

void index_codec(Bytes bytes);
void position_codec(Bytes bytes);
void attribute_codec(Bytes bytes);
void cluster_codec(Bytes bytes);
void cluster_page(Bytes bytes);
void jpeg_index(Bytes bytes);    // an indexed JPEG as in a container
void jpeg_file(Bytes bytes);     // a JPEG file as convert handles it, with mip levels
void block_file(Bytes bytes);    // a KTX2 or DDS file, level by level
void hdr(Bytes bytes);           // a Radiance picture, row by row
void image(Bytes bytes);         // a file of any image format, as a texture
void container(Bytes bytes);     // inspect --verify, and export
void scene(Bytes bytes);         // render
void gltf(Bytes bytes);          // convert
void view_message(Bytes bytes);  // a message from a page to scree view
void camera_path(Bytes bytes);   // render --path
void shard(Bytes bytes);         // merge

struct Target {
  const char* name;
  void (*run)(Bytes);
  bool is_container;  // bytes are a .scree file, with its own mutations (mutate_container.h)
};

inline constexpr Target kTargets[] = {
    {"index_codec", index_codec, false},
    {"position_codec", position_codec, false},
    {"attribute_codec", attribute_codec, false},
    {"cluster_codec", cluster_codec, false},
    {"cluster_page", cluster_page, false},
    {"jpeg_index", jpeg_index, false},
    {"jpeg_file", jpeg_file, false},
    {"block_file", block_file, false},
    {"hdr", hdr, false},
    {"image", image, false},
    {"container", container, true},
    {"scene", scene, true},
    {"gltf", gltf, false},
    {"view_message", view_message, false},
    {"camera_path", camera_path, false},
    {"shard", shard, false},
};

}  // namespace scree::fuzz
