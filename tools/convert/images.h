// Base-colour images: checked once, carried over as they are, equal ones once.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "format/container.h"
#include "format/result.h"
#include "tools/convert/gltf_source.h"
#include "tools/convert/ordered_pool.h"

namespace scree::convert {

struct ImagePlan {
  std::vector<uint32_t> places;                 // for each of SourceScene::images: its ImageRecord, or kNone
  std::vector<uint32_t> sources;                // for each ImageRecord: the image of the source it is
  std::vector<format::ImageRecord> records;     // name and page unset
  std::vector<std::array<uint64_t, 2>> hashes;  // XXH3-128 of each record's file
  std::vector<std::string> warnings;            // what the decoder put up with, image named
};

/// "city.gltf: image 3 (bark)".
std::string image_place(const SourceScene& scene, uint32_t image);

/// Decodes every image of `wanted` (flags) once to see that it can be, without holding its file or its pixels: as many
/// at a time as runtime::image_check_bytes of them fit into 128 MiB. Errors as runtime::check_image and
/// ByteSource::read, the image named; kUnsupported: more than 1 GiB.
Result<ImagePlan> check_images(const SourceScene& scene, const std::vector<bool>& wanted, WorkerPool& pool);

/// Appends a page for every record and sets the records' pages. Errors as ContainerWriter::append_raw; kFile: an image
/// is not what it was when it was checked.
Result<void> write_images(const SourceScene& scene, ImagePlan& plan, format::ContainerWriter& writer);

}  // namespace scree::convert
