#include "tools/convert/passes/merge_pass.h"

#include <iterator>
#include <string>
#include <utility>

#include "format/container/check.h"
#include "format/container/checksum.h"
#include "format/fail.h"
#include "runtime/scene/pages.h"

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

/// Appends the pages of a shard's images. Renumbers images, levels and pages for the file, which already has
/// `first_image` images.
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

}  // namespace

Result<std::vector<StoredImageRecord>> append_images(ShardSet& shards, uint64_t count,
                                                     format::ContainerWriter& writer) {
  std::vector<StoredImageRecord> images;
  for (ShardFile& shard : shards.files) {
    SCREE_TRY(append_images(shard, images.size(), writer));
    std::move(shard.share.images.begin(), shard.share.images.end(), std::back_inserter(images));
  }
  if (images.size() == count) return images;
  return fail(ErrorCode::kFormat, shards.files.front().map.path(), ": its shards have ", images.size(), " of ", count,
              " images");
}

Result<void> MergePass::begin(const ShardFile& shard) {
  SCREE_TRY(leave_page());
  shard_ = &shard;
  page_ = last_page_ = format::kNone;
  for (const WindowOutcome& window : shard.share.windows)
    if (!window.chunks.empty()) last_page_ = window.chunks.back().page;
  return {};
}

/// Continues with the page of `chunk`: copies it as a whole if possible, otherwise loads it.
Result<void> MergePass::turn_to(const format::ChunkRecord& chunk) {
  if (page_ != format::kNone && chunk.page < page_) return no_page(*shard_, chunk.page);
  SCREE_TRY(leave_page());
  page_ = chunk.page;
  const format::PageRecord& record = shard_->container.pages()[page_];
  std::vector<std::byte> stored = SCREE_TRY(read_page(*shard_, page_));
  if (page_ != last_page_ && !geometry_.fits(chunk.bytes)) {
    bytes_ = std::make_shared<std::vector<std::byte>>(stored);
    copy_ = SCREE_TRY(geometry_.add_page({record, std::move(stored)}));
    return {};
  }
  copy_ = format::kNone;
  if (record.codec != format::PageCodec::kRaw) {
    std::vector<std::byte> raw(record.raw_bytes);
    SCREE_TRY_AT(shard_->map.path(), shard_->container.unpack_page(page_, stored, raw));
    stored = std::move(raw);
  }
  bytes_ = std::make_shared<std::vector<std::byte>>(std::move(stored));
  return {};
}

/// Checks the page of the previous chunk, whose chunks are all known now: their content on the pool.
Result<void> MergePass::leave_page() {
  if (page_ == format::kNone) return {};
  const format::PageRecord& record = shard_->container.pages()[page_];
  if (page_end_ != record.raw_bytes)
    return fail(ErrorCode::kTrailing, shard_->map.path(), ": page ", page_, ": ", record.raw_bytes,
                " bytes, but its chunks end at byte ", page_end_);
  page_end_ = 0;
  const bool is_packed = copy_ != format::kNone && record.codec != format::PageCodec::kRaw;
  const uint64_t cost = bytes_->size() + (is_packed ? record.raw_bytes : 0) + chunks_.size() * sizeof(PlacedChunk);
  auto check = [shard = shard_, page = page_, is_packed, bytes = std::move(bytes_),
                chunks = std::exchange(chunks_, {})](uint32_t) -> Result<bool> {
    std::vector<std::byte> raw;
    if (is_packed) {
      raw.resize(shard->container.pages()[page].raw_bytes);
      SCREE_TRY_AT(shard->map.path(), shard->container.unpack_page(page, *bytes, raw));
    }
    for (const PlacedChunk& chunk : chunks)
      SCREE_TRY_AT(shard->map.path() + ": chunk " + std::to_string(chunk.number) + " in page " + std::to_string(page),
                   runtime::check_chunk(*chunk.mesh, chunk.record, is_packed ? raw : *bytes));
    return true;
  };
  checks_.submit(std::move(check), cost);
  while (checks_.ready() || (checks_.size() > 1 && checks_.cost() > most_bytes_)) SCREE_TRY(checks_.take());
  return {};
}

Result<void> MergePass::add(WindowOutcome& window, const format::MeshRecord& mesh) {
  if (mesh_ != &mesh) mesh_triangles_ = 0;
  mesh_ = &mesh;
  for (format::ChunkRecord& chunk : window.chunks) {
    const uint64_t number = chunk_count_++;
    if (const auto error =
            format::check_chunk_record(number, chunk, shard_->container.pages(), mesh, chunk.mesh, mesh_triangles_))
      return at(shard_->map.path(), *error);
    mesh_triangles_ += chunk.triangle_count;
    if (chunk.page != page_) SCREE_TRY(turn_to(chunk));
    if (chunk.offset != page_end_)
      return fail(ErrorCode::kRange, shard_->map.path(), ": chunk ", number, ": at byte ", chunk.offset, " of page ",
                  page_, ", expected ", page_end_);
    page_end_ += chunk.bytes;
    chunks_.push_back({number, &mesh, chunk});
    if (copy_ != format::kNone) {
      chunk.page = copy_;
      continue;
    }
    EncodedChunk again;
    again.record = chunk;
    const auto first = bytes_->begin() + static_cast<ptrdiff_t>(chunk.offset);
    again.payload.assign(first, first + static_cast<ptrdiff_t>(chunk.bytes));
    SCREE_TRY(geometry_.add(again));
    chunk.page = again.record.page;
    chunk.offset = again.record.offset;
  }
  return {};
}

Result<void> MergePass::finish() {
  SCREE_TRY(leave_page());
  while (checks_.size() > 0) SCREE_TRY(checks_.take());
  return geometry_.finish();
}

Result<void> merge_windows(ShardSet& shards, std::span<const WindowPlan> windows, std::span<const uint32_t> mesh_of,
                           std::span<const format::MeshRecord> meshes, MergePass& pass,
                           const std::function<Result<void>(const WindowPlan&, const WindowOutcome&)>& note) {
  uint64_t number = 0;
  for (ShardFile& shard : shards.files) {
    SCREE_TRY(pass.begin(shard));
    for (WindowOutcome& window : shard.share.windows) {
      const uint32_t mesh = number < windows.size() ? mesh_of[windows[number].primitive] : format::kNone;
      if (mesh == format::kNone || window.made_from != window_id(windows[number], mesh, meshes[mesh]) ||
          !is_outcome_of(window, windows[number], mesh))
        return fail(ErrorCode::kFormat, shard.map.path(), ": window ", number, " differs from the source");
      SCREE_TRY(pass.add(window, meshes[mesh]));
      SCREE_TRY(note(windows[number++], window));
      window = {};
    }
  }
  if (number != windows.size())
    return fail(ErrorCode::kFormat, shards.files.back().map.path(), ": its shards have ", number, " of ",
                windows.size(), " windows");
  return pass.finish();
}

}  // namespace scree::convert
