#include "tools/convert/images/images.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <span>
#include <tuple>
#include <utility>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/jpeg/index.h"
#include "runtime/images/block_file.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/threads/parallel.h"
#include "tools/common/jobs/prepare_ahead.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/convert/images/jpeg_file.h"
#include "tools/convert/images/jpeg_levels.h"
#include "tools/convert/images/jpeg_transcode.h"

namespace scree::convert {
namespace {

constexpr uint64_t kMaxImageBytes = uint64_t{1} << 30;
constexpr uint64_t kCheckedBytes = uint64_t{128} << 20;  // memory of the checks in flight
constexpr size_t kBlockBytes = size_t{1} << 20;
// Images in flight per thread, if memory suffices. Pages are written in order, so these have to last while one thread
// stores a large image.
constexpr uint64_t kJobsPerThread = 8;
// Files that are read into the page cache before they are stored.
constexpr uint64_t kAheadBytes = uint64_t{256} << 20;

struct CheckedImage {
  runtime::ImageInfo info{};
  ContentHash hash{};
  std::string warning;
  std::string broken;  // ImagePlan::broken
};

Result<void> read_image(const SourceImage& image, uint64_t offset, std::span<std::byte> out) {
  return image.source->read(image.offset + offset, out);
}

Result<ContentHash> hash_image(const SourceImage& image) {
  ContentHasher hash;
  std::vector<std::byte> block(static_cast<size_t>(std::min<uint64_t>(kBlockBytes, image.bytes)));
  for (uint64_t done = 0; done < image.bytes; done += block.size()) {
    block.resize(static_cast<size_t>(std::min<uint64_t>(block.size(), image.bytes - done)));
    SCREE_TRY(read_image(image, done, block));
    hash.add(block);
  }
  return hash.value();
}

/// Whether the image keeps its blocks. Storing it unpacks and checks every level, so only its header is read before.
bool keeps_blocks(const ImageOptions& options, format::ImageCodec codec) {
  return codec == format::ImageCodec::kBlocks && options.textures != Textures::kJpeg;
}

/// Whether the image is stored as an indexed JPEG.
bool is_indexed(const ImageOptions& options, format::ImageCodec codec) {
  return options.textures == Textures::kJpeg ||
         (options.textures == Textures::kKeep && codec == format::ImageCodec::kJpeg);
}

/// `may_repeat`: another image has the same size in bytes.
Result<CheckedImage> check_source(const SourceImage& image, const ImageOptions& options, bool may_repeat) {
  if (image.bytes > kMaxImageBytes)
    return Error{ErrorCode::kUnsupported, std::to_string(image.bytes) + " bytes, but images of at most " +
                                              std::to_string(kMaxImageBytes) + " are read"};
  CheckedImage checked;
  const Result<runtime::ImageInfo> info = runtime::probe_image(image_head(image));
  Result<std::string> warning = std::string();
  const bool is_checked_later =
      info && (is_indexed(options, info->codec) || keeps_blocks(options, info->codec));  // both decode it
  if (info && !is_checked_later) warning = runtime::check_image(image_file(image));
  if (info && warning) {
    checked.info = *info;
    checked.warning = std::move(*warning);
  } else {
    const Error& error = info ? warning.error() : info.error();
    if (!options.keep_going || error.code == ErrorCode::kFile || error.code == ErrorCode::kMemory) return error;
    checked.info.codec = format::ImageCodec::kIndexedJpeg;
    checked.broken = error.message;
  }
  if (!may_repeat && keeps_blocks(options, checked.info.codec)) return checked;
  checked.hash = SCREE_TRY(hash_image(image));
  return checked;
}

/// Memory for checking an image. A file that is no image counts little; the check reports its error.
uint64_t check_cost(const SourceImage& image, const Result<runtime::ImageInfo>& info, const ImageOptions& options) {
  return kBlockBytes +
         (info && !keeps_blocks(options, info->codec) ? runtime::image_check_bytes(*info, image.bytes) : 0);
}

/// The stored form of an image that is not kept as a file.
struct StoredImage {
  std::vector<std::byte> png;                  // of a WebP
  std::vector<std::byte> base;                 // an indexed JPEG,
  std::vector<std::vector<std::byte>> levels;  // and its mip levels
  std::vector<format::SealedPage> pages;       // of a block image; without png, base and pages the file is unchanged
  format::BlockFormat block_format = format::BlockFormat::kNoBlocks;
  uint16_t swizzle = 0;
  std::vector<format::MipLevelRecord> places;  // of a block image's mip levels: page in `pages`, image unset
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t channels = 0;
  std::string warning;

  uint64_t held_bytes() const {
    uint64_t bytes = kBlockBytes + png.capacity() + base.capacity();
    for (const std::vector<std::byte>& level : levels) bytes += level.capacity();
    for (const format::SealedPage& page : pages) bytes += page.stored.capacity();
    return bytes;
  }
};

Error changed() {
  return {ErrorCode::kFile, "was changed while it was converted"};
}

/// Reads the file and compares it with its hash if there is one.
Result<std::vector<std::byte>> read_file(const SourceImage& image, const ContentHash& hash) {
  std::vector<std::byte> file(static_cast<size_t>(image.bytes));
  SCREE_TRY(read_image(image, 0, file));
  ContentHasher found;
  if (hash == ContentHash{}) return file;
  found.add(file);
  if (found.value() != hash) return changed();
  return file;
}

/// Levels below the first that take at most this many bytes share a page. Readers keep all of them in memory, so they
/// should be small.
constexpr uint64_t kMostSharedBytes = uint64_t{1} << 14;

/// The blocks of a KTX2 or DDS file. Each large level has pages of its own, so that it is read without the others.
Result<StoredImage> store_blocks(const SourceImage& source, const format::ImageRecord& record, const ContentHash& hash,
                                 int zstd_level) {
  const auto bytes = SCREE_TRY(read_file(source, hash));
  runtime::ImageFile file(bytes);
  auto head = SCREE_TRY(runtime::open_block_file(file));
  if (head.width != record.width || head.height != record.height) return changed();
  StoredImage stored;
  stored.block_format = head.format;
  stored.swizzle = head.swizzle;
  const auto add_page = [&](std::vector<std::byte> raw) {
    stored.pages.push_back(format::seal_page(format::PageKind::kImage, std::move(raw), zstd_level));
  };
  std::vector<std::byte> together;
  for (uint32_t l = 0; l < head.levels.size(); ++l) {
    auto blocks = SCREE_TRY(runtime::read_block_level(file, head, l));
    const auto first_page = static_cast<uint32_t>(stored.pages.size());
    if (l != 0 && blocks.size() <= kMostSharedBytes) {
      together.resize(format::align_up(together.size(), format::kChunkAlignment));
      stored.places.push_back({together.size(), blocks.size(), first_page, 0});
      together.insert(together.end(), blocks.begin(), blocks.end());
      continue;
    }
    if (l != 0) stored.places.push_back({0, blocks.size(), first_page, 0});
    const format::BlockRows rows =
        format::block_rows(head.format, std::max(1u, head.width >> l), std::max(1u, head.height >> l));
    if (rows.pages() == 1) {
      add_page(std::move(blocks));
      continue;
    }
    std::span<const std::byte> rest(blocks);
    for (uint32_t i = 0; i < rows.pages(); ++i) {
      const auto page = rest.first(rows.page_bytes(i));
      add_page({page.begin(), page.end()});
      rest = rest.subspan(page.size());
    }
  }
  if (!together.empty()) add_page(std::move(together));
  return stored;
}

/// A grey pixel, which replaces an invalid image.
Result<std::vector<std::byte>> grey_jpeg() {
  runtime::Image image;
  image.width = image.height = 1;
  image.rgba = {128, 128, 128, 255};
  return encode_jpeg(image, 90, true);
}

/// Encodes a file of another kind as a JPEG.
Result<std::vector<std::byte>> code_jpeg(std::span<const std::byte> file, uint32_t channels, int quality,
                                         std::string& warning) {
  const runtime::Image image = SCREE_TRY(runtime::decode_image(file));
  warning = image.warning;
  for (size_t i = 3; i < image.rgba.size(); i += 4) {
    if (image.rgba[i] == 255) continue;
    warning += (warning.empty() ? "" : "; ") + std::string("alpha is left out");
    break;
  }
  return encode_jpeg(image, quality, channels <= 2);
}

Result<StoredImage> index_image(std::span<const std::byte> file, std::string warning,
                                runtime::TexelCoding coding = runtime::TexelCoding::kColor) {
  IndexedJpeg indexed = SCREE_TRY(index_jpeg(file));
  const format::JpegIndex index = SCREE_TRY(format::open_jpeg_index(indexed.bytes));
  StoredImage stored;
  stored.width = index.width;
  stored.height = index.height;
  stored.channels = index.component_count;
  stored.warning = std::move(warning);
  if (!indexed.note.empty()) stored.warning += (stored.warning.empty() ? "" : "; ") + indexed.note;
  stored.levels = SCREE_TRY(make_jpeg_levels(index, coding));
  stored.base = std::move(indexed.bytes);
  return stored;
}

Result<StoredImage> grey_image(const std::string& why) {
  const auto file = SCREE_TRY(grey_jpeg());
  return index_image(file, why + "; grey in its place");
}

/// Converts a WebP to a PNG with the same pixels.
Result<StoredImage> store_png(std::span<const std::byte> file, uint32_t channels) {
  runtime::Image image = SCREE_TRY(runtime::decode_image(file));
  auto png = SCREE_TRY(
      runtime::encode_png({image.width, image.height, 4, image.rgba}, {.is_small = true, .has_alpha = channels == 4}));
  StoredImage stored;
  stored.png = std::move(png);
  return stored;
}

/// The form in which an image is stored.
Result<StoredImage> store_image(const SourceImage& source, const format::ImageRecord& record, const ContentHash& hash,
                                const ImageOptions& options, runtime::TexelCoding coding) {
  const auto or_grey = [&](Result<StoredImage> stored) {
    const bool is_bad = !stored && stored.error().code != ErrorCode::kMemory && stored.error().code != ErrorCode::kFile;
    return is_bad && options.keep_going ? grey_image(stored.error().message) : std::move(stored);
  };
  if (keeps_blocks(options, record.codec)) return or_grey(store_blocks(source, record, hash, options.block_zstd_level));
  const auto file = SCREE_TRY(read_file(source, hash));
  Result<StoredImage> stored = StoredImage{};
  if (record.codec == format::ImageCodec::kJpeg) {
    stored = index_image(file, {}, coding);
  } else if (source.is_webp && options.textures != Textures::kJpeg) {
    stored = store_png(file, record.channels);
  } else {
    std::string warning;
    // A swizzle may turn one-channel blocks into any colour.
    const uint32_t channels = record.codec == format::ImageCodec::kBlocks ? 3 : record.channels;
    const auto coded = code_jpeg(file, channels, options.quality, warning);
    stored = coded ? index_image(*coded, std::move(warning), coding) : coded.error();
  }
  return or_grey(std::move(stored));
}

/// Memory that compressing a page of blocks takes beside the page: 4 times the page at level 3, 21 times at level 19.
uint64_t zstd_bytes(int level, uint64_t block_bytes) {
  return level == 0 ? 0 : 24 * std::min(block_bytes, format::kBlockPageBytes);
}

uint64_t store_cost(const SourceImage& source, const runtime::ImageInfo& info, const ImageOptions& options) {
  // Level 0 is in memory twice, as blocks and as pages; with its pages, all other levels take less.
  if (keeps_blocks(options, info.codec))
    return source.bytes + 2 * info.block_bytes + info.codebook_bytes + kBlockBytes +
           zstd_bytes(options.block_zstd_level, info.block_bytes);
  const uint64_t pixels = uint64_t{info.width} * info.height;
  if (!is_indexed(options, info.codec)) {
    // The picture, and a PNG that is at most as large and grows by doubling.
    return info.is_webp ? source.bytes + 16 * pixels : kBlockBytes;
  }
  uint64_t bytes = 4 * source.bytes;
  if (info.codec != format::ImageCodec::kJpeg) bytes += 10 * pixels;
  if (info.codec == format::ImageCodec::kBlocks) bytes += 2 * info.block_bytes + info.codebook_bytes;
  if (info.needs_transcode) bytes += 2 * info.channels * pixels;
  return bytes;
}

/// Appends the pages of an indexed image: one for its base level, and one for all other levels.
Result<void> append_indexed(StoredImage stored, uint32_t number, StoredImageRecord& written,
                            format::ContainerWriter& writer) {
  format::ImageRecord& record = written.record;
  record.codec = format::ImageCodec::kIndexedJpeg;
  record.width = stored.width;
  record.height = stored.height;
  record.channels = static_cast<uint8_t>(stored.channels);
  record.page = SCREE_TRY(writer.append(format::seal_page(format::PageKind::kImage, std::move(stored.base), 0)));
  ++written.page_count;
  if (stored.levels.empty()) return {};
  record.level_count = static_cast<uint32_t>(stored.levels.size());
  std::vector<std::byte> together;
  for (const std::vector<std::byte>& level : stored.levels) {
    written.levels.push_back({together.size(), level.size(), 0, number});
    together.insert(together.end(), level.begin(), level.end());
  }
  const uint32_t levels = SCREE_TRY(writer.append(format::seal_page(format::PageKind::kImage, std::move(together), 0)));
  ++written.page_count;
  for (format::MipLevelRecord& level : written.levels) level.page = levels;
  return {};
}

Result<void> append_blocks(StoredImage stored, uint32_t number, StoredImageRecord& written,
                           format::ContainerWriter& writer) {
  format::ImageRecord& record = written.record;
  record.block_format = stored.block_format;
  record.swizzle = stored.swizzle;
  record.level_count = static_cast<uint32_t>(stored.places.size());
  for (const format::SealedPage& sealed : stored.pages) {
    const uint32_t page = SCREE_TRY(writer.append(sealed));
    if (written.page_count++ == 0) record.page = page;
  }
  for (format::MipLevelRecord& level : stored.places) {
    level.page += record.page;
    level.image = number;
  }
  written.levels = std::move(stored.places);
  return {};
}

Result<void> append_png(StoredImage stored, StoredImageRecord& written, format::ContainerWriter& writer) {
  written.record.page = SCREE_TRY(writer.append(format::seal_page(format::PageKind::kImage, std::move(stored.png), 0)));
  ++written.page_count;
  return {};
}

/// Appends the page of an image whose file is stored unchanged.
Result<void> append_file(const SourceImage& image, const ContentHash& expected, StoredImageRecord& written,
                         format::ContainerWriter& writer) {
  ContentHasher hash;
  // JPEG and PNG are already compressed, and a raw page can be decoded directly from the mapped file.
  const Result<uint32_t> page =
      writer.append_raw(format::PageKind::kImage, image.bytes, [&](uint64_t offset, std::span<std::byte> out) {
        Result<void> read = read_image(image, offset, out);
        hash.add(out);
        return read;
      });
  if (!page) return page.error();
  if (hash.value() != expected) return changed();
  written.record.page = *page;
  ++written.page_count;
  return {};
}

/// Adds a written image to the plan.
void add_stored(const SourceScene& scene, uint64_t number, const StoredImageRecord& stored, ImagePlan& plan) {
  format::ImageRecord& record = plan.records[number];
  record = stored.record;
  if (!stored.levels.empty()) record.first_level = static_cast<uint32_t>(plan.levels.size());
  plan.levels.insert(plan.levels.end(), stored.levels.begin(), stored.levels.end());
  plan.page_count += stored.page_count;
  if (!stored.warning.empty())
    plan.warnings.push_back(image_place(scene, plan.sources[number]) + ": " + stored.warning);
}

}  // namespace

runtime::ImageFile image_file(const SourceImage& image) {
  return {image.bytes, [&image](uint64_t offset, std::span<std::byte> out) { return read_image(image, offset, out); }};
}

runtime::ImageFile image_head(const SourceImage& image) {
  const auto read = [&image](uint64_t offset, std::span<std::byte> out) {
    return image.source->read_alone(image.offset + offset, out);
  };
  return {image.bytes, read, runtime::ImageFile::kHeadBytes};
}

Result<uint64_t> largest_image_bytes(const SourceScene& scene, const ImageOptions& options, uint32_t threads,
                                     const std::atomic<bool>* stop) {
  std::atomic<uint64_t> largest = 0;
  runtime::parallel_for(scene.images.size(), threads, [&](uint64_t i) {
    if (tools::is_stopped(stop)) return;
    const SourceImage& image = scene.images[i];
    if (image.bytes > kMaxImageBytes) return;  // refused later, like pictures with too many pixels
    const Result<runtime::ImageInfo> info = runtime::probe_decodable(image_head(image));
    if (!info) return;
    const uint64_t bytes = std::max(check_cost(image, info, options), store_cost(image, *info, options));
    for (uint64_t most = largest; bytes > most && !largest.compare_exchange_weak(most, bytes);) continue;
  });
  SCREE_TRY(tools::check_stop(stop));
  return largest.load();
}

std::string image_place(const SourceScene& scene, uint32_t image) {
  std::string place = scene.file_name + ": image " + std::to_string(image);
  if (!scene.images[image].name.empty()) place += " (" + scene.images[image].name + ")";
  return place;
}

Result<ImagePlan> check_images(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                               WorkerPool& pool, const std::function<void(uint64_t images, uint64_t bytes)>& progress) {
  ImagePlan plan;
  uint64_t bytes_done = 0;
  plan.places.assign(scene.images.size(), format::kNone);
  std::vector<uint32_t> images;
  for (uint32_t i = 0; i < wanted.size(); ++i)
    if (wanted[i]) images.push_back(i);
  std::map<std::tuple<uint64_t, uint64_t, uint64_t>, uint32_t> known;  // hash and size -> record
  std::map<uint64_t, uint32_t> of_size;                                // images by the bytes of their files
  for (const uint32_t image : images) ++of_size[scene.images[image].bytes];
  std::vector<uint64_t> costs(images.size());
  runtime::parallel_for(costs.size(), pool.threads(), [&](uint64_t i) {
    const SourceImage& image = scene.images[images[i]];
    costs[i] = check_cost(image, runtime::probe_image(image_head(image)), options);
  });
  const auto work = [&](uint64_t i, uint32_t) -> Result<CheckedImage> {
    const SourceImage& image = scene.images[images[i]];
    CheckedImage checked =
        SCREE_TRY_AT(image_place(scene, images[i]), check_source(image, options, of_size.at(image.bytes) > 1));
    return checked;
  };
  const auto cost = [&](uint64_t i) { return costs[i]; };
  const auto take = [&](uint64_t i, CheckedImage checked) -> Result<void> {
    const uint64_t bytes = scene.images[images[i]].bytes;
    bytes_done += bytes;
    progress(i + 1, bytes_done);
    const auto [entry, is_new] =
        known.try_emplace({checked.hash[0], checked.hash[1], bytes}, static_cast<uint32_t>(plan.records.size()));
    plan.places[images[i]] = entry->second;
    const bool is_color = scene.images[images[i]].is_color;
    if (!is_new) {
      if (is_color) plan.is_color[entry->second] = true;
      return {};
    }
    plan.is_color.push_back(is_color);
    format::ImageRecord record{};
    record.page = format::kNone;
    record.first_level = format::kNone;
    record.codec = checked.info.codec;
    record.width = checked.info.width;
    record.height = checked.info.height;
    record.channels = static_cast<uint8_t>(checked.info.channels);
    plan.records.push_back(record);
    plan.hashes.push_back(checked.hash);
    plan.costs.push_back(store_cost(scene.images[images[i]], checked.info, options));
    plan.sources.push_back(images[i]);
    plan.broken.push_back(checked.broken);
    if (!checked.warning.empty()) plan.warnings.push_back(image_place(scene, images[i]) + ": " + checked.warning);
    return {};
  };
  SCREE_TRY(run_ordered<CheckedImage>(
      pool, images.size(), {2 * uint64_t{pool.threads()}, std::min(kCheckedBytes, options.memory)}, work, cost, take));
  return plan;
}

Result<void> write_images(const SourceScene& scene, const ImageOptions& options, ImagePlan& plan, WorkerPool& pool,
                          format::ContainerWriter& writer, const std::vector<StoredImageRecord>& stored_before,
                          const std::function<void(uint64_t number, const StoredImageRecord&)>& note) {
  const uint64_t first = stored_before.size();
  for (uint64_t i = 0; i < first; ++i) add_stored(scene, i, stored_before[i], plan);
  const auto source = [&](uint64_t i) -> const SourceImage& { return scene.images[plan.sources[i]]; };
  // take() changes the records that work() and cost() read.
  const std::vector<format::ImageRecord> records = plan.records;
  const auto coding_of = [&](uint64_t i) {
    return plan.is_color[i] ? runtime::TexelCoding::kColor : runtime::TexelCoding::kNumbers;
  };
  // While all threads work on images, the disk reads the images after those.
  const auto start_reader = [&](uint64_t parity) {
    return std::make_unique<PrepareAhead>(
        records.size() - first, kAheadBytes, [&](uint64_t place) { return source(first + place).bytes; },
        [&, parity](uint64_t place) {
          const SourceImage& image = source(first + place);
          if (place % 2 == parity) image.source->will_need(image.offset, image.bytes);
        });
  };
  const std::array readers = {start_reader(0), start_reader(1)};
  const auto work = [&](uint64_t place, uint32_t) -> Result<StoredImage> {
    const uint64_t i = first + place;
    for (const auto& reader : readers) reader->begun(place);
    if (!plan.broken[i].empty()) return grey_image(plan.broken[i]);
    const bool is_file = !source(i).is_webp && records[i].codec != format::ImageCodec::kBlocks;
    if (is_file && !is_indexed(options, records[i].codec)) return StoredImage{};
    StoredImage stored = SCREE_TRY_AT(image_place(scene, plan.sources[i]),
                                      store_image(source(i), records[i], plan.hashes[i], options, coding_of(i)));
    return stored;
  };
  const auto cost = [&](uint64_t place) { return plan.costs[first + place]; };
  const auto take = [&](uint64_t place, StoredImage stored) -> Result<void> {
    const uint64_t i = first + place;
    StoredImageRecord written;
    written.record = records[i];
    written.warning = stored.warning;
    if (!stored.base.empty()) {
      SCREE_TRY(append_indexed(std::move(stored), static_cast<uint32_t>(i), written, writer));
    } else if (!stored.png.empty()) {
      SCREE_TRY(append_png(std::move(stored), written, writer));
    } else if (!stored.pages.empty()) {
      SCREE_TRY(append_blocks(std::move(stored), static_cast<uint32_t>(i), written, writer));
    } else if (const Result<void> appended = append_file(source(i), plan.hashes[i], written, writer); !appended) {
      return at(image_place(scene, plan.sources[i]), appended.error());
    }
    add_stored(scene, i, written, plan);
    note(i, written);
    return {};
  };
  return run_ordered<StoredImage>(pool, records.size() - first, {kJobsPerThread * pool.threads(), options.memory}, work,
                                  cost, take);
}

}  // namespace scree::convert
