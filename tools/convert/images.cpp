#include "tools/convert/images.h"

#include <algorithm>
#include <array>
#include <map>
#include <span>
#include <tuple>

#include "runtime/image.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::convert {
namespace {

constexpr uint64_t kMaxImageBytes = uint64_t{1} << 30;
constexpr uint64_t kCheckedBytes = uint64_t{128} << 20;  // memory of the checks in flight
constexpr size_t kBlockBytes = size_t{1} << 20;

/// XXH3-128 of bytes that come in parts.
class FileHash {
 public:
  FileHash() { XXH3_128bits_reset(&state_); }
  void add(std::span<const std::byte> bytes) { XXH3_128bits_update(&state_, bytes.data(), bytes.size()); }
  std::array<uint64_t, 2> value() const {
    const XXH128_hash_t hash = XXH3_128bits_digest(&state_);
    return {hash.high64, hash.low64};
  }

 private:
  XXH3_state_t state_;
};

struct CheckedImage {
  runtime::ImageInfo info{};
  std::array<uint64_t, 2> hash{};
  std::string warning;
};

Result<void> read_image(const SourceImage& image, uint64_t offset, std::span<std::byte> out) {
  return image.source->read(image.offset + offset, out);
}

runtime::ImageFile image_file(const SourceImage& image) {
  return {image.bytes, [&image](uint64_t offset, std::span<std::byte> out) { return read_image(image, offset, out); }};
}

Result<std::array<uint64_t, 2>> hash_image(const SourceImage& image) {
  FileHash hash;
  std::vector<std::byte> block(static_cast<size_t>(std::min<uint64_t>(kBlockBytes, image.bytes)));
  for (uint64_t done = 0; done < image.bytes; done += block.size()) {
    block.resize(static_cast<size_t>(std::min<uint64_t>(block.size(), image.bytes - done)));
    if (const Result<void> read = read_image(image, done, block); !read) return read.error();
    hash.add(block);
  }
  return hash.value();
}

Result<CheckedImage> check_source(const SourceImage& image) {
  if (image.bytes > kMaxImageBytes)
    return Error{ErrorCode::kUnsupported, std::to_string(image.bytes) + " bytes, but images of at most " +
                                              std::to_string(kMaxImageBytes) + " are read"};
  CheckedImage checked;
  const Result<runtime::ImageInfo> info = runtime::probe_image(image_file(image));
  if (!info) return info.error();
  checked.info = *info;
  Result<std::string> warning = runtime::check_image(image_file(image));
  if (!warning) return warning.error();
  checked.warning = std::move(*warning);
  const Result<std::array<uint64_t, 2>> hash = hash_image(image);
  if (!hash) return hash.error();
  checked.hash = *hash;
  return checked;
}

/// What checking an image takes; the check itself says what is wrong with those that are no images.
uint64_t check_cost(const SourceImage& image) {
  const Result<runtime::ImageInfo> info = runtime::probe_image(image_file(image));
  return kBlockBytes + (info ? runtime::image_check_bytes(*info) : 0);
}

}  // namespace

std::string image_place(const SourceScene& scene, uint32_t image) {
  std::string place = scene.file_name + ": image " + std::to_string(image);
  if (!scene.images[image].name.empty()) place += " (" + scene.images[image].name + ")";
  return place;
}

Result<ImagePlan> check_images(const SourceScene& scene, const std::vector<bool>& wanted, WorkerPool& pool) {
  ImagePlan plan;
  plan.places.assign(scene.images.size(), format::kNone);
  std::vector<uint32_t> images;
  for (uint32_t i = 0; i < wanted.size(); ++i)
    if (wanted[i]) images.push_back(i);
  std::map<std::tuple<uint64_t, uint64_t, uint64_t>, uint32_t> known;  // hash and size -> record
  std::vector<uint64_t> costs;
  for (const uint32_t image : images) costs.push_back(check_cost(scene.images[image]));
  const auto work = [&](uint64_t i, uint32_t) -> Result<CheckedImage> {
    Result<CheckedImage> checked = check_source(scene.images[images[i]]);
    if (!checked) return at(image_place(scene, images[i]), checked.error());
    return checked;
  };
  const auto cost = [&](uint64_t i) { return costs[i]; };
  const auto take = [&](uint64_t i, CheckedImage checked) -> Result<void> {
    const uint64_t bytes = scene.images[images[i]].bytes;
    const auto [entry, is_new] =
        known.try_emplace({checked.hash[0], checked.hash[1], bytes}, static_cast<uint32_t>(plan.records.size()));
    plan.places[images[i]] = entry->second;
    if (!is_new) return {};
    format::ImageRecord record{};
    record.page = format::kNone;
    record.index_page = format::kNone;
    record.codec = checked.info.codec;
    record.width = checked.info.width;
    record.height = checked.info.height;
    record.channels = checked.info.channels;
    plan.records.push_back(record);
    plan.hashes.push_back(checked.hash);
    plan.sources.push_back(images[i]);
    if (!checked.warning.empty()) plan.warnings.push_back(image_place(scene, images[i]) + ": " + checked.warning);
    return {};
  };
  const Result<void> run =
      run_ordered<CheckedImage>(pool, images.size(), {2 * uint64_t{pool.threads()}, kCheckedBytes}, work, cost, take);
  if (!run) return run.error();
  return plan;
}

Result<void> write_images(const SourceScene& scene, ImagePlan& plan, format::ContainerWriter& writer) {
  for (size_t i = 0; i < plan.sources.size(); ++i) {
    const SourceImage& image = scene.images[plan.sources[i]];
    FileHash hash;
    // JPEG and PNG are compressed already; a raw page can be decoded where it is mapped.
    const Result<uint32_t> page =
        writer.append_raw(format::PageKind::kImage, image.bytes, [&](uint64_t offset, std::span<std::byte> out) {
          Result<void> read = read_image(image, offset, out);
          if (!read) return Result<void>(at(image_place(scene, plan.sources[i]), read.error()));
          hash.add(out);
          return read;
        });
    if (!page) return page.error();
    if (hash.value() != plan.hashes[i])
      return Error{ErrorCode::kFile, image_place(scene, plan.sources[i]) + ": was changed while it was converted"};
    plan.records[i].page = *page;
  }
  return {};
}

}  // namespace scree::convert
