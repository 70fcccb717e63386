// Checks and stores the images of textures. Equal images are stored once. ConvertOptions::images selects the stored
// form.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "runtime/images/image.h"
#include "tools/common/content_hash.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// How images are stored.
enum class Textures {
  kKeep,  // JPEGs are indexed, with the same coefficients; KTX2 and DDS keep their blocks; PNGs stay files; WebPs
          // become PNGs with the same pixels
  kJpeg,  // all become indexed JPEGs
  kRaw,   // like kKeep, but JPEGs stay files too
};

struct ImageOptions {
  Textures textures = Textures::kKeep;
  int quality = 90;                     // for kJpeg, 1 to 100 on libjpeg's scale, 4:4:4
  bool keep_going = false;              // an image that is damaged or of an unsupported kind becomes grey
  int block_zstd_level = 1;             // 1 to 22, for pages of blocks; 0: not compressed
  uint64_t memory = uint64_t{1} << 30;  // limit for images in flight while they are checked or stored, bytes
};

struct ImagePlan {
  std::vector<uint32_t> places;                // by image of SourceScene::images: its ImageRecord, or kNone
  std::vector<uint32_t> sources;               // by ImageRecord: its image in the source
  std::vector<format::ImageRecord> records;    // name, page and levels unset
  std::vector<bool> is_color;                  // some texture uses it as colour; else its texels are numbers
  std::vector<uint64_t> costs;                 // bytes that storing a record takes
  std::vector<std::string> broken;             // the reason why a record's image becomes grey; empty if it does not
  std::vector<format::MipLevelRecord> levels;  // of the records
  uint32_t page_count = 0;                     // number of written pages
  std::vector<ContentHash> hashes;             // by record: hash of its file, or 0 if that is read only once
  std::vector<std::string> warnings;           // tolerated defects and changes, with the image
};

/// An image as written.
struct StoredImageRecord {
  format::ImageRecord record{};  // complete
  uint32_t page_count = 0;
  std::vector<format::MipLevelRecord> levels;
  std::string warning;
};

/// The file of an image, and the same for reading its head alone.
runtime::ImageFile image_file(const SourceImage& image);
runtime::ImageFile image_head(const SourceImage& image);

/// Largest memory for checking or storing one image of the scene, bytes. Reads the images' heads on up to `threads`
/// threads. Error kFile "interrupted" once `stop` is raised; null: never. Throws std::bad_alloc.
Result<uint64_t> largest_image_bytes(const SourceScene& scene, const ImageOptions& options, uint32_t threads,
                                     const std::atomic<bool>* stop);

/// "city.gltf: image 3 (bark)".
std::string image_place(const SourceScene& scene, uint32_t image);

/// Reads the header of every image of `wanted` (flags). Images that stay files are decoded once to check them, without
/// holding file or pixels. Images that keep their blocks are checked by write_images(). Here they are read only if
/// another image has the same size, and so may be equal. As many images at a time are checked as fit 128 MiB and
/// ImageOptions::memory by runtime::image_check_bytes. `progress(images, bytes)`: images done so far, and the bytes of
/// their files. Errors as runtime::check_image and ByteSource::read, with the image; kUnsupported: more than 1 GiB.
Result<ImagePlan> check_images(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                               WorkerPool& pool, const std::function<void(uint64_t images, uint64_t bytes)>& progress);

/// Appends the pages of every record and completes the plan. The first records are already stored (`stored`); `note` is
/// called for each of the others once it is written. While an image is indexed, about four times its file is held, and
/// for images that are encoded again also the picture (10 bytes per pixel) or its coefficients (2 bytes per sample). As
/// many images at a time are processed as fit ImageOptions::memory, but at least one. Errors as
/// ContainerWriter::append, index_jpeg and decode_image, with the image; kFile: an image has changed since it
/// was checked.
Result<void> write_images(const SourceScene& scene, const ImageOptions& options, ImagePlan& plan, WorkerPool& pool,
                          format::ContainerWriter& writer, const std::vector<StoredImageRecord>& stored,
                          const std::function<void(uint64_t number, const StoredImageRecord&)>& note);

}  // namespace scree::convert
