#include "tools/convert/encode/geometry_writer.h"

#include <memory>
#include <utility>

namespace scree::convert {

Result<void> GeometryWriter::add(EncodedChunk& chunk) {
  if (open_.is_open && !fits(chunk.payload.size())) SCREE_TRY(seal());
  chunk.record.page = number_;
  chunk.record.offset = open_.bytes.size();
  if (chunk.record.encoding == format::ChunkEncoding::kClustered)
    open_.clusters.push_back({chunk.record.offset, chunk.record.cluster_count});
  if (open_.bytes.empty() && chunk.payload.size() >= format::kPageTargetBytes / 2) {
    open_.bytes = std::move(chunk.payload);
  } else {
    if (open_.bytes.empty()) open_.bytes.reserve(format::kPageTargetBytes);
    open_.bytes.insert(open_.bytes.end(), chunk.payload.begin(), chunk.payload.end());
  }
  open_.is_open = true;
  return {};
}

Result<void> GeometryWriter::finish() {
  if (open_.is_open) SCREE_TRY(seal());
  return write_all();
}

Result<GeometryWriter::OpenPage> GeometryWriter::release() {
  SCREE_TRY(write_all());
  return std::exchange(open_, {});
}

Result<void> GeometryWriter::write_all() {
  while (pages_.size() > 0) SCREE_TRY(write_one());
  return {};
}

Result<void> GeometryWriter::seal() {
  const auto raw = std::make_shared<std::vector<std::byte>>(std::move(open_.bytes));
  std::vector<format::PageClusters> clusters = std::move(open_.clusters);
  open_ = {};
  ++number_;
  const uint64_t cost = raw->size();
  pages_.submit(
      [raw, clusters = std::move(clusters), level = zstd_level_,
       &time = times_.encoding](uint32_t) -> Result<format::SealedPage> {
        const Timed timed(time);
        return format::seal_page(format::PageKind::kGeometry, std::move(*raw), level, clusters);
      },
      cost);
  while (pages_.size() > limit_ || pages_.ready()) SCREE_TRY(write_one());
  return {};
}

Result<uint32_t> GeometryWriter::add_page(const format::SealedPage& page) {
  SCREE_TRY(finish());
  const Timed timed(times_.writing);
  const Result<uint32_t> number = writer_.append(page);
  if (number) number_ = written_ = *number + 1;
  return number;
}

Result<void> GeometryWriter::write_one() {
  const format::SealedPage page = SCREE_TRY(pages_.take());
  const Timed timed(times_.writing);
  const uint32_t number = SCREE_TRY(writer_.append(page));
  if (number != written_)
    return Error{ErrorCode::kFormat, "page " + std::to_string(written_) + " became page " + std::to_string(number)};
  ++written_;
  return {};
}

}  // namespace scree::convert
