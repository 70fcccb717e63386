#include "tools/convert/passes/merge_pass.h"

#include <algorithm>
#include <string>
#include <utility>

#include "format/bytes.h"

namespace scree::convert {
namespace {

Error no_page(const ShardFile& shard, uint32_t page) {
  return {ErrorCode::kRange, shard.map.path() + ": page " + std::to_string(page) + " is none of its pages for that"};
}

bool has_page(const ShardFile& shard, uint32_t page, format::PageKind kind) {
  return page < shard.container.pages().size() && shard.container.pages()[page].kind == kind;
}

/// Of a page's stored bytes: read and not mapped, so that few pages of the file's map are resident.
format::ContainerWriter::Read reader_of(const ShardFile& shard, const format::PageRecord& record) {
  return [&shard, first = record.offset](uint64_t offset, std::span<std::byte> out) -> Result<void> {
    const Result<void> read = shard.map.read(first + offset, out);
    if (!read) return at(shard.map.path(), read.error());
    return {};
  };
}

}  // namespace

Result<void> append_images(ShardFile& shard, uint64_t first_image, format::ContainerWriter& writer) {
  uint32_t next = 0;  // page of the shard
  for (StoredImageRecord& image : shard.share.images) {
    const uint32_t first = next, moved = writer.page_count();
    for (uint32_t i = 0; i < image.page_count; ++i, ++next) {
      if (!has_page(shard, next, format::PageKind::kImage)) return no_page(shard, next);
      const format::PageRecord& record = shard.container.pages()[next];
      const Result<uint32_t> page = writer.append_stored(record, reader_of(shard, record));
      if (!page) return page.error().code == ErrorCode::kChecksum ? at(shard.map.path(), page.error()) : page.error();
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

/// The page of a chunk that lies in another one than the chunk before.
Result<void> MergePass::turn_to(const format::ChunkRecord& chunk) {
  if (!has_page(*shard_, chunk.page, format::PageKind::kGeometry) || (page_ != format::kNone && chunk.page < page_))
    return no_page(*shard_, chunk.page);
  page_ = chunk.page;
  if (page_ != last_page_ && !geometry_.fits(chunk.bytes)) {
    const format::PageRecord& record = shard_->container.pages()[page_];
    const Result<uint32_t> number = geometry_.add_page(record, reader_of(*shard_, record));
    if (!number && number.error().code == ErrorCode::kChecksum) return at(shard_->map.path(), number.error());
    if (!number) return number.error();
    copy_ = *number;
    return {};
  }
  copy_ = format::kNone;
  Result<std::vector<std::byte>> stored = read_page(*shard_, page_);
  if (!stored) return stored.error();
  const format::PageRecord& record = shard_->container.pages()[page_];
  if (record.codec == format::PageCodec::kRaw) {
    raw_ = std::move(*stored);
    return {};
  }
  raw_.resize(record.raw_bytes);
  const Result<void> unpacked = shard_->container.unpack_page(page_, *stored, raw_);
  return unpacked ? unpacked : at(shard_->map.path(), unpacked.error());
}

Result<void> MergePass::add(WindowOutcome& window) {
  for (format::ChunkRecord& chunk : window.chunks) {
    if (chunk.page != page_)
      if (const Result<void> turned = turn_to(chunk); !turned) return turned;
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
    if (const Result<void> added = geometry_.add(again); !added) return added;
    chunk.page = again.record.page;
    chunk.offset = again.record.offset;
  }
  return {};
}

}  // namespace scree::convert
