// Base-colour images: checked once, equal ones stored once, as ConvertOptions::textures says.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/content_hash.h"
#include "tools/common/ordered_pool.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// What becomes of images.
enum class Textures {
  kKeep,  // JPEGs are indexed, with the same coefficients; KTX2 and DDS keep their blocks; PNGs stay the files they
          // are, and WebPs become PNGs of the same pixels
  kJpeg,  // all become indexed JPEGs
  kRaw,   // as kKeep, but JPEGs stay the files they are too
};

struct ImageOptions {
  Textures textures = Textures::kKeep;
  int quality = 90;                       // of kJpeg, 1 to 100 in libjpeg's scale, 4:4:4
  bool keep_going = false;                // an image that is damaged or of an unsupported kind becomes a grey one
  int zstd_level = 0;                     // of the pages of blocks; 0: not compressed
  uint64_t memory = uint64_t{256} << 20;  // bytes that images in flight may take while they are checked or indexed
};

struct ImagePlan {
  std::vector<uint32_t> places;                // for each of SourceScene::images: its ImageRecord, or kNone
  std::vector<uint32_t> sources;               // for each ImageRecord: the image of the source it is
  std::vector<format::ImageRecord> records;    // name, page and levels unset
  std::vector<uint64_t> costs;                 // bytes that storing a record takes
  std::vector<std::string> broken;             // why a record's file becomes grey; empty where it does not
  std::vector<format::MipLevelRecord> levels;  // of the records
  uint32_t page_count = 0;                     // written
  std::vector<ContentHash> hashes;             // of each record's file
  std::vector<std::string> warnings;           // what was put up with or changed, image named
};

/// An image as it was written.
struct StoredImageRecord {
  format::ImageRecord record{};  // complete
  uint32_t page_count = 0;
  std::vector<format::MipLevelRecord> levels;
  std::string warning;
};

/// What checking or storing one image of the scene takes at most, bytes.
uint64_t largest_image_bytes(const SourceScene& scene, const ImageOptions& options);

/// "city.gltf: image 3 (bark)".
std::string image_place(const SourceScene& scene, uint32_t image);

/// Reads the head of every image of `wanted` (flags), and decodes those that stay files once to see that they can be,
/// without holding file or pixels: as many at a time as runtime::image_check_bytes of them fit into 128 MiB and
/// ImageOptions::memory. `progress(images, bytes)`: done so far, and what their files have. Errors as
/// runtime::check_image and ByteSource::read, the image named; kUnsupported: more than 1 GiB.
Result<ImagePlan> check_images(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                               WorkerPool& pool, const std::function<void(uint64_t images, uint64_t bytes)>& progress);

/// Appends the pages of every record and completes the plan; the first ones are `stored` already, `note` is called for
/// each of the others once it is written. Holds an image's file about four times while it is
/// indexed, and, of images coded anew, the picture (10 bytes a pixel) or its coefficients (2 bytes a sample); as many
/// at a time as fit into ImageOptions::memory, but one always. Errors as ContainerWriter::append, runtime::index_jpeg
/// and decode_image, the image named; kFile: an image is not what it was when it was checked.
Result<void> write_images(const SourceScene& scene, const ImageOptions& options, ImagePlan& plan, WorkerPool& pool,
                          format::ContainerWriter& writer, const std::vector<StoredImageRecord>& stored,
                          const std::function<void(uint64_t number, const StoredImageRecord&)>& note);

}  // namespace scree::convert
