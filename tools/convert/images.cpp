#include "tools/convert/images.h"

#include <xxhash.h>

#include <map>
#include <span>
#include <tuple>

#include "runtime/image.h"

namespace scree::convert {
namespace {

constexpr uint64_t kMaxImageBytes = uint64_t{1} << 30;
constexpr uint64_t kCostLimit = uint64_t{128} << 20;  // bytes of decoded pixels and image files in flight
constexpr uint64_t kPixelsPerByte = 16;               // of a guess of the size of an image that is still compressed

struct CheckedImage {
  runtime::ImageInfo info{};
  XXH128_hash_t hash{};
  std::string warning;
};

Result<std::vector<std::byte>> read_image(const SourceScene& scene, uint32_t image) {
  const SourceImage& source = scene.images[image];
  if (source.bytes > kMaxImageBytes)
    return Error{ErrorCode::kUnsupported, image_place(scene, image) + ": " + std::to_string(source.bytes) +
                                              " bytes, but images of at most " + std::to_string(kMaxImageBytes) +
                                              " are read"};
  std::vector<std::byte> file(source.bytes);
  if (const Result<void> read = source.source->read(source.offset, file); !read)
    return at(image_place(scene, image), read.error());
  return file;
}

Result<CheckedImage> check_image(const SourceScene& scene, uint32_t image) {
  const Result<std::vector<std::byte>> file = read_image(scene, image);
  if (!file) return file.error();
  CheckedImage checked;
  const Result<runtime::ImageInfo> info = runtime::probe_image(*file);
  if (!info) return at(image_place(scene, image), info.error());
  checked.info = *info;
  const Result<runtime::Image> decoded = runtime::decode_image(*file);
  if (!decoded) return at(image_place(scene, image), decoded.error());
  if (!decoded->warning.empty()) checked.warning = image_place(scene, image) + ": " + decoded->warning;
  checked.hash = XXH3_128bits(file->data(), file->size());
  return checked;
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
  const auto work = [&](uint64_t i, uint32_t) { return check_image(scene, images[i]); };
  const auto cost = [&](uint64_t i) { return (1 + kPixelsPerByte) * scene.images[images[i]].bytes; };
  const auto take = [&](uint64_t i, CheckedImage checked) -> Result<void> {
    const uint64_t bytes = scene.images[images[i]].bytes;
    const auto [entry, is_new] =
        known.try_emplace({checked.hash.high64, checked.hash.low64, bytes}, static_cast<uint32_t>(plan.records.size()));
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
    plan.sources.push_back(images[i]);
    if (!checked.warning.empty()) plan.warnings.push_back(checked.warning);
    return {};
  };
  const Result<void> run =
      run_ordered<CheckedImage>(pool, images.size(), {2 * uint64_t{pool.threads()}, kCostLimit}, work, cost, take);
  if (!run) return run.error();
  return plan;
}

Result<void> write_images(const SourceScene& scene, ImagePlan& plan, WorkerPool& pool,
                          format::ContainerWriter& writer) {
  const auto work = [&](uint64_t i, uint32_t) -> Result<format::SealedPage> {
    Result<std::vector<std::byte>> file = read_image(scene, plan.sources[i]);
    if (!file) return file.error();
    // JPEG and PNG are compressed already; a raw page can be decoded where it is mapped.
    return format::seal_page(format::PageKind::kImage, std::move(*file), 0);
  };
  const auto cost = [&](uint64_t i) { return scene.images[plan.sources[i]].bytes; };
  const auto take = [&](uint64_t i, format::SealedPage page) -> Result<void> {
    const Result<uint32_t> number = writer.append(page);
    if (!number) return number.error();
    plan.records[i].page = *number;
    return {};
  };
  return run_ordered<format::SealedPage>(pool, plan.sources.size(), {2 * uint64_t{pool.threads()}, kCostLimit}, work,
                                         cost, take);
}

}  // namespace scree::convert
