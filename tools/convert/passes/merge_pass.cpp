#include "tools/convert/passes/merge_pass.h"

#include <string>
#include <utility>

#include "format/bytes.h"
#include "format/container/checksum.h"

namespace scree::convert {
namespace {

Error no_page(const ShardFile& shard, uint32_t page) {
  return {ErrorCode::kRange,
          shard.map.path() + ": page " + std::to_string(page) + " is not one of its pages of that kind"};
}

bool has_page(const ShardFile& shard, uint32_t page, format::PageKind kind) {
  return page < shard.container.pages().size() && shard.container.pages()[page].kind == kind;
}

/// Copies a page of the shard. A raw page, such as the file of an image, may be large, so it is copied in parts.
Result<uint32_t> append_page(const ShardFile& shard, uint32_t page, format::ContainerWriter& writer) {
  const format::PageRecord& record = shard.container.pages()[page];
  if (record.codec != format::PageCodec::kRaw) {
    std::vector<std::byte> stored = SCREE_TRY(read_page(shard, page));
    return writer.append({record, std::move(stored)});
  }
  format::Checksum checksum;
  const Result<uint32_t> number = writer.append_raw(
      record.kind, record.stored_bytes, [&](uint64_t offset, std::span<std::byte> out) -> Result<void> {
        SCREE_TRY_AT(shard.map.path(), shard.map.read(record.offset + offset, out));
        checksum.add(out);
        return {};
      });
  if (number && checksum.value() != record.checksum)
    return Error{ErrorCode::kChecksum, shard.map.path() + ": page " + std::to_string(page) + ": damaged"};
  return number;
}

}  // namespace

Result<void> append_images(ShardFile& shard, uint64_t first_image, format::ContainerWriter& writer) {
  uint32_t next = 0;  // page of the shard
  for (StoredImageRecord& image : shard.share.images) {
    const uint32_t first = next, moved = writer.page_count();
    for (uint32_t i = 0; i < image.page_count; ++i, ++next) {
      if (!has_page(shard, next, format::PageKind::kImage)) return no_page(shard, next);
      SCREE_TRY(append_page(shard, next, writer));
    }
    const auto move = [&](uint32_t& page) {
      if (page < first || page >= next) return false;
      page += moved - first;
      return true;
    };
    if (!move(image.record.page)) return no_page(shard, image.record.page);
    for (format::MipLevelRecord& level : image.levels) {
      if (!move(level.page)) return no_page(shard, level.page);
      level.image += static_cast<uint32_t>(first_image);
    }
  }
  return {};
}

void MergePass::begin(const ShardFile& shard) {
  shard_ = &shard;
  page_ = last_page_ = format::kNone;
  for (const WindowOutcome& window : shard.share.windows)
    if (!window.chunks.empty()) last_page_ = window.chunks.back().page;
}

/// Continues with the page of `chunk`: copies it as a whole if possible, otherwise loads it.
Result<void> MergePass::turn_to(const format::ChunkRecord& chunk) {
  if (!has_page(*shard_, chunk.page, format::PageKind::kGeometry) || (page_ != format::kNone && chunk.page < page_))
    return no_page(*shard_, chunk.page);
  page_ = chunk.page;
  if (page_ != last_page_ && !geometry_.fits(chunk.bytes)) {
    std::vector<std::byte> stored = SCREE_TRY(read_page(*shard_, page_));
    copy_ = SCREE_TRY(geometry_.add_page({shard_->container.pages()[page_], std::move(stored)}));
    return {};
  }
  copy_ = format::kNone;
  std::vector<std::byte> stored = SCREE_TRY(read_page(*shard_, page_));
  const format::PageRecord& record = shard_->container.pages()[page_];
  if (record.codec == format::PageCodec::kRaw) {
    raw_ = std::move(stored);
    return {};
  }
  raw_.resize(record.raw_bytes);
  const Result<void> unpacked = shard_->container.unpack_page(page_, stored, raw_);
  return unpacked ? unpacked : at(shard_->map.path(), unpacked.error());
}

Result<void> MergePass::add(WindowOutcome& window) {
  for (format::ChunkRecord& chunk : window.chunks) {
    if (chunk.page != page_) SCREE_TRY(turn_to(chunk));
    if (!format::range_within(chunk.offset, chunk.bytes, shard_->container.pages()[page_].raw_bytes))
      return Error{ErrorCode::kRange, shard_->map.path() + ": a chunk does not lie in page " + std::to_string(page_)};
    if (copy_ != format::kNone) {
      chunk.page = copy_;
      continue;
    }
    EncodedChunk again;
    again.record = chunk;
    const auto first = raw_.begin() + static_cast<ptrdiff_t>(chunk.offset);
    again.payload.assign(first, first + static_cast<ptrdiff_t>(chunk.bytes));
    SCREE_TRY(geometry_.add(again));
    chunk.page = again.record.page;
    chunk.offset = again.record.offset;
  }
  return {};
}

}  // namespace scree::convert
