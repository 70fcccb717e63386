#include "tools/inspect/verify.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <new>
#include <thread>
#include <utility>

#include "format/bytes.h"
#include "format/container/checksum.h"
#include "format/container/mip_levels.h"
#include "runtime/images/image.h"
#include "runtime/scene/pages.h"
#include "runtime/textures/jpeg_image.h"
#include "runtime/threads/parallel.h"
#include "tools/common/chunk_decode.h"
#include "tools/convert/passes/shard.h"
#include "tools/gltf/box.h"

namespace scree::inspect {
namespace {

using format::ChunkRecord;
using format::PageKind;

std::string hex(uint64_t value) {
  char text[19];
  std::snprintf(text, sizeof text, "0x%016llx", static_cast<unsigned long long>(value));
  return text;
}

/// The index of the first byte that is not zero, or bytes.size().
size_t first_set(std::span<const std::byte> bytes) {
  return static_cast<size_t>(std::find_if(bytes.begin(), bytes.end(), [](std::byte b) { return b != std::byte{0}; }) -
                             bytes.begin());
}

class Verifier {
 public:
  Verifier(const format::Container& file, std::span<const std::byte> bytes, const VerifyHooks& hooks)
      : file_(file), bytes_(bytes), hooks_(hooks) {
    boxes_.assign(file.meshes().size(), convert::empty_box());
    vertices_.assign(file.meshes().size(), 0);
    undecoded_.assign(file.meshes().size(), false);
    report_.is_shard = convert::is_shard(file);
    list_by_page();
  }

  VerifyReport run(uint32_t threads) {
    check_extents();
    check_pages(threads);
    check_meshes();
    std::stable_sort(failures_.begin(), failures_.end(),
                     [](const Failure& a, const Failure& b) { return a.offset < b.offset; });
    std::sort(warnings_.begin(), warnings_.end());
    for (auto& warning : warnings_) report_.warnings.push_back(std::move(warning.second));
    report_.failure_count = failures_.size();
    if (failures_.size() > kMaxFailures) failures_.resize(kMaxFailures);
    report_.failures = std::move(failures_);
    return std::move(report_);
  }

 private:
  void fail(uint64_t offset, Error error) {
    const std::lock_guard lock(mutex_);
    failures_.push_back({offset, std::move(error)});
  }

  /// Groups chunks and images by their page: [starts[page], starts[page + 1]) of the list.
  void list_by_page() {
    const uint64_t pages = file_.pages().size();
    const auto group = [&](std::vector<uint64_t>& starts, std::vector<uint64_t>& list, uint64_t count, auto page_of) {
      starts.assign(pages + 1, 0);
      list.resize(count);
      for (uint64_t i = 0; i < count; ++i) ++starts[page_of(i) + 1];
      for (uint64_t page = 0; page < pages; ++page) starts[page + 1] += starts[page];
      std::vector<uint64_t> next(starts.begin(), starts.end() - 1);
      for (uint64_t i = 0; i < count; ++i) list[next[page_of(i)]++] = i;
    };
    const auto chunks = file_.chunks();
    const auto images = file_.images();
    group(chunk_starts_, chunk_list_, chunks.size(), [&](uint64_t i) { return chunks[i].page; });
    group(image_starts_, image_list_, images.size(), [&](uint64_t i) { return images[i].page; });
    const auto levels = file_.mip_levels();
    group(level_starts_, level_list_, levels.size(), [&](uint64_t i) { return levels[i].page; });
    for (uint64_t page = 0; page < pages; ++page) {
      std::sort(chunk_list_.begin() + static_cast<std::ptrdiff_t>(chunk_starts_[page]),
                chunk_list_.begin() + static_cast<std::ptrdiff_t>(chunk_starts_[page + 1]),
                [&](uint64_t a, uint64_t b) {
                  return chunks[a].offset != chunks[b].offset ? chunks[a].offset < chunks[b].offset : a < b;
                });
    }
  }

  /// Checks the tables' checksums, that header, tables and pages do not overlap, and that bytes between them are zero.
  void check_extents() {
    struct Extent {
      uint64_t offset, size;
      std::string name;
    };
    const format::FileHeader& header = file_.header();
    std::vector<Extent> extents{
        {0, header.header_bytes, "the header"},
        {header.toc_offset, header.toc_count * sizeof(format::TocEntry), "the table of contents"}};
    for (uint32_t i = 0; i < header.toc_count; ++i) {
      const auto entry =
          format::load<format::TocEntry>(bytes_.data() + header.toc_offset + i * sizeof(format::TocEntry));
      const std::string name = "table " + std::to_string(i);
      const uint64_t size = entry.record_count * entry.record_bytes;
      extents.push_back({entry.offset, size, name});
      ++report_.tables;
      if (!format::range_within(entry.offset, size, bytes_.size())) continue;  // open() rejects it
      const uint64_t found = format::checksum(bytes_.subspan(entry.offset, size));
      if (found != entry.checksum) {
        fail(entry.offset, {ErrorCode::kChecksum, name + " at byte " + std::to_string(entry.offset) + ": checksum " +
                                                      hex(found) + ", expected " + hex(entry.checksum)});
      }
    }
    const auto pages = file_.pages();
    for (uint64_t i = 0; i < pages.size(); ++i)
      extents.push_back({pages[i].offset, pages[i].stored_bytes, "page " + std::to_string(i)});
    std::stable_sort(extents.begin(), extents.end(), [](const Extent& a, const Extent& b) {
      return a.offset != b.offset ? a.offset < b.offset : a.size < b.size;
    });
    uint64_t end = 0;
    for (const Extent& extent : extents) {
      if (extent.size == 0) continue;
      if (extent.offset < end) {
        fail(extent.offset,
             {ErrorCode::kRange, extent.name + " at byte " + std::to_string(extent.offset) +
                                     ": overlaps the item before it, which ends at byte " + std::to_string(end)});
      } else {
        check_padding(end, extent.offset - end);
      }
      end = std::max(end, extent.offset + extent.size);
    }
    check_padding(end, bytes_.size() - end);
  }

  void check_padding(uint64_t offset, uint64_t size) {
    report_.padding_bytes += size;
    const size_t place = first_set(bytes_.subspan(offset, size));
    if (place < size) {
      fail(offset + place,
           {ErrorCode::kReserved, "padding at byte " + std::to_string(offset + place) + ": found " +
                                      std::to_string(static_cast<unsigned>(bytes_[offset + place])) + ", expected 0"});
    }
  }

  void check_pages(uint32_t threads) {
    const uint64_t pages = file_.pages().size();
    std::atomic<uint64_t> next{0};
    const auto work = [&](bool is_caller) {
      std::vector<std::byte> scratch;
      tools::DecodedChunk decoded;
      for (uint64_t page = next.fetch_add(1); page < pages; page = next.fetch_add(1)) {
        try {
          check_page(static_cast<uint32_t>(page), scratch, decoded);
        } catch (const std::bad_alloc&) {
          fail(file_.pages()[page].offset, {ErrorCode::kMemory, page_place(page) + ": out of memory"});
        }
        if (hooks_.is_done_with) hooks_.is_done_with(file_.pages()[page].offset, file_.pages()[page].stored_bytes);
        if (is_caller && hooks_.progress) {
          std::unique_lock lock(mutex_);
          const uint64_t triangles = report_.triangles, page_bytes = report_.page_bytes;
          lock.unlock();
          hooks_.progress(triangles, page_bytes);
        }
      }
    };
    runtime::on_threads(std::min<uint64_t>(threads, pages), work);
  }

  std::string page_place(uint64_t page) const {
    return "page " + std::to_string(page) + " at byte " + std::to_string(file_.pages()[page].offset);
  }

  void check_page(uint32_t number, std::vector<std::byte>& scratch, tools::DecodedChunk& decoded) {
    const format::PageRecord& page = file_.pages()[number];
    const auto loaded = file_.load_page(number, scratch);
    if (!loaded) {
      fail(page.offset, at(page_place(number), loaded.error()));
      give_up(number);
      return;
    }
    {
      const std::lock_guard lock(mutex_);
      ++report_.pages;
      report_.page_bytes += page.stored_bytes;
      report_.raw_bytes += loaded->size();
    }
    if (page.kind == PageKind::kGeometry && !report_.is_shard) check_chunks(number, *loaded, decoded);
    if (page.kind == PageKind::kImage) {
      check_images(number, *loaded);
      check_levels(number, *loaded);
    }
  }

  /// Excludes the meshes of an unreadable page from the comparison of boxes.
  void give_up(uint32_t page) {
    const std::lock_guard lock(mutex_);
    for (uint64_t i = chunk_starts_[page]; i < chunk_starts_[page + 1]; ++i)
      undecoded_[file_.chunks()[chunk_list_[i]].mesh] = true;
  }

  void check_chunks(uint32_t number, std::span<const std::byte> raw, tools::DecodedChunk& decoded) {
    const uint64_t page_offset = file_.pages()[number].offset;
    uint64_t end = 0;
    const auto check_gap = [&](uint64_t to) {
      const size_t place = first_set(raw.subspan(end, to - end));
      if (place < to - end) {
        fail(page_offset,
             {ErrorCode::kReserved, page_place(number) + ": byte " + std::to_string(end + place) +
                                        " of its raw bytes, in no chunk: found " +
                                        std::to_string(static_cast<unsigned>(raw[end + place])) + ", expected 0"});
      }
    };
    for (uint64_t i = chunk_starts_[number]; i < chunk_starts_[number + 1]; ++i) {
      const uint64_t chunk = chunk_list_[i];
      const ChunkRecord& record = file_.chunks()[chunk];
      if (record.offset < end && record.bytes != 0) {
        fail(page_offset,
             {ErrorCode::kRange, page_place(number) + ": " + runtime::chunk_place(file_, chunk) +
                                     ": begins inside another chunk, which ends at byte " + std::to_string(end)});
      } else if (record.offset > end && record.offset <= raw.size()) {
        check_gap(record.offset);
      }
      if (format::range_within(record.offset, record.bytes, raw.size()))
        end = std::max(end, record.offset + record.bytes);
      check_chunk(number, chunk, raw, decoded);
    }
    check_gap(raw.size());
  }

  void check_chunk(uint32_t number, uint64_t chunk, std::span<const std::byte> raw, tools::DecodedChunk& decoded) {
    const ChunkRecord& record = file_.chunks()[chunk];
    const auto done = tools::decode_chunk(file_, chunk, raw, tools::kPartAll, decoded);
    if (!done) fail(file_.pages()[number].offset, at(page_place(number), done.error()));
    const convert::Box box = done ? convert::box_of(decoded.positions) : convert::Box{};
    const std::lock_guard lock(mutex_);
    if (!done) {
      undecoded_[record.mesh] = true;
      return;
    }
    ++report_.chunks;
    report_.triangles += record.triangle_count;
    report_.vertices += record.vertex_count;
    vertices_[record.mesh] += record.vertex_count;
    convert::grow(boxes_[record.mesh], box);
  }

  void check_images(uint32_t number, std::span<const std::byte> raw) {
    for (uint64_t i = image_starts_[number]; i < image_starts_[number + 1]; ++i) {
      const uint64_t image = image_list_[i];
      const format::ImageRecord& record = file_.images()[image];
      const std::string place = page_place(number) + ": image " + std::to_string(image);
      if (record.codec == format::ImageCodec::kIndexedJpeg) {
        check_indexed(number, place, raw, record, 0);
        continue;
      }
      if (record.codec == format::ImageCodec::kBlocks) {  // any bytes are valid; open() checked their number
        count_image(record, 0);
        continue;
      }
      const auto info = runtime::probe_image(raw);
      if (!info) {
        fail(file_.pages()[number].offset, at(place, info.error()));
        continue;
      }
      if (info->is_webp) {
        fail(file_.pages()[number].offset, {ErrorCode::kFormat, place + ": is WebP, expected PNG"});
        continue;
      }
      if (info->codec != record.codec || info->width != record.width || info->height != record.height ||
          info->channels != record.channels) {
        const auto shape = [](format::ImageCodec codec, uint32_t width, uint32_t height, uint32_t channels) {
          return std::string(codec == format::ImageCodec::kJpeg ? "JPEG " : "PNG ") + std::to_string(width) + " x " +
                 std::to_string(height) + " x " + std::to_string(channels);
        };
        fail(file_.pages()[number].offset,
             {ErrorCode::kRange, place + ": is " + shape(info->codec, info->width, info->height, info->channels) +
                                     ", but its record says " +
                                     shape(record.codec, record.width, record.height, record.channels)});
        continue;
      }
      const Result<std::string> warning = runtime::check_image(raw);
      if (!warning) {
        fail(file_.pages()[number].offset, at(place, warning.error()));
        continue;
      }
      count_image(record, 0);
      const std::lock_guard lock(mutex_);
      if (!warning->empty()) warnings_.emplace_back(image, place + ": " + *warning);
    }
  }

  void count_image(const format::ImageRecord& record, uint32_t level) {
    const std::lock_guard lock(mutex_);
    if (level == 0) ++report_.images;
    report_.pixels += uint64_t{std::max(1u, record.width >> level)} * std::max(1u, record.height >> level);
  }

  /// Checks level `level` of an image: decodes it completely and compares its anchors.
  void check_indexed(uint32_t number, const std::string& place, std::span<const std::byte> bytes,
                     const format::ImageRecord& record, uint32_t level) {
    const uint32_t width = std::max(1u, record.width >> level);
    const uint32_t height = std::max(1u, record.height >> level);
    const auto index = runtime::open_jpeg_level(bytes, width, height, record.channels);
    Result<uint64_t> size = index ? Result<uint64_t>(uint64_t{0}) : Result<uint64_t>(index.error());
    if (index) {
      std::vector<std::byte> file(format::jpeg_file_bound(*index));
      size = format::decode_jpeg_index(file, *index);
    }
    if (size) {
      count_image(record, level);
    } else {
      fail(file_.pages()[number].offset, at(place, size.error()));
    }
  }

  void check_levels(uint32_t number, std::span<const std::byte> raw) {
    uint64_t end = 0;
    for (uint64_t i = level_starts_[number]; i < level_starts_[number + 1]; ++i) {
      const uint64_t level = level_list_[i];
      const format::MipLevelRecord& record = file_.mip_levels()[level];
      const format::ImageRecord& image = file_.images()[record.image];
      const auto number_of_image = static_cast<uint32_t>(level - image.first_level + 1);
      const std::string place =
          page_place(number) + ": image " + std::to_string(record.image) + ", level " + std::to_string(number_of_image);
      const uint64_t begin = format::align_up(end, format::kChunkAlignment);
      if (record.offset != begin) {
        fail(file_.pages()[number].offset,
             {ErrorCode::kRange,
              place + ": begins at byte " + std::to_string(record.offset) + ", expected " + std::to_string(begin)});
      } else if (first_set(raw.subspan(end, begin - end)) != begin - end) {
        fail(file_.pages()[number].offset, {ErrorCode::kReserved, place + ": a byte before it is not 0"});
      }
      // A level in several pages fills them completely.
      end = format::level_page_count(image, number_of_image) > 1 ? raw.size() : record.offset + record.bytes;
      if (image.codec == format::ImageCodec::kBlocks) {
        count_image(image, number_of_image);
      } else {
        check_indexed(number, place, raw.subspan(record.offset, record.bytes), image, number_of_image);
      }
    }
    if (level_starts_[number] != level_starts_[number + 1] && end != raw.size()) {
      fail(file_.pages()[number].offset,
           {ErrorCode::kTrailing, page_place(number) + ": " + std::to_string(raw.size()) +
                                      " bytes, but its mip levels end at byte " + std::to_string(end)});
    }
  }

  void check_meshes() {
    const auto meshes = file_.meshes();
    for (uint64_t i = 0; i < meshes.size(); ++i) {
      const format::MeshRecord& mesh = meshes[i];
      if (undecoded_[i] || mesh.chunk_count == 0) continue;
      const std::string place = "mesh " + std::to_string(i);
      ++report_.meshes;
      for (size_t axis = 0; axis < 3; ++axis) {
        if (mesh.bounds_min[axis] != boxes_[i].lo[axis] || mesh.bounds_max[axis] != boxes_[i].hi[axis]) {
          char text[160];
          std::snprintf(text, sizeof text, ": bounds [%.9g, %.9g] on axis %zu, but its positions span [%.9g, %.9g]",
                        static_cast<double>(mesh.bounds_min[axis]), static_cast<double>(mesh.bounds_max[axis]), axis,
                        static_cast<double>(boxes_[i].lo[axis]), static_cast<double>(boxes_[i].hi[axis]));
          fail(mesh_offset(i), {ErrorCode::kRange, place + text});
          break;
        }
      }
      if (mesh.vertex_count != vertices_[i]) {
        fail(mesh_offset(i), {ErrorCode::kRange, place + ": vertex count " + std::to_string(mesh.vertex_count) +
                                                     ", but its chunks have " + std::to_string(vertices_[i])});
      }
    }
  }

  /// Offset of a mesh's record in the file.
  uint64_t mesh_offset(uint64_t mesh) const {
    return static_cast<uint64_t>(reinterpret_cast<const std::byte*>(&file_.meshes()[mesh]) - bytes_.data());
  }

  const format::Container& file_;
  std::span<const std::byte> bytes_;
  const VerifyHooks& hooks_;
  std::vector<uint64_t> chunk_starts_, chunk_list_, image_starts_, image_list_, level_starts_, level_list_;

  std::mutex mutex_;  // for all members below
  VerifyReport report_;
  std::vector<Failure> failures_;
  std::vector<std::pair<uint64_t, std::string>> warnings_;
  std::vector<convert::Box> boxes_;
  std::vector<uint64_t> vertices_;
  std::vector<bool> undecoded_;
};

}  // namespace

VerifyReport verify(const format::Container& file, std::span<const std::byte> bytes, uint32_t threads,
                    const VerifyHooks& hooks) {
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  return Verifier(file, bytes, hooks).run(threads);
}

}  // namespace scree::inspect
