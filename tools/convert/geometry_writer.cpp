#include "tools/convert/geometry_writer.h"

#include <memory>
#include <utility>

#include "tools/convert/stage_rates.h"

namespace scree::convert {

Result<void> GeometryWriter::add(EncodedChunk& chunk) {
  if (open_ && page_.size() + chunk.payload.size() > format::kPageTargetBytes)
    if (const Result<void> sealed = seal(); !sealed) return sealed;
  chunk.record.page = number_;
  chunk.record.offset = page_.size();
  if (chunk.record.encoding == format::ChunkEncoding::kClustered)
    clusters_.push_back({chunk.record.offset, chunk.record.cluster_count});
  if (page_.empty() && chunk.payload.size() >= format::kPageTargetBytes / 2) {
    page_ = std::move(chunk.payload);
  } else {
    if (page_.empty()) page_.reserve(format::kPageTargetBytes);
    page_.insert(page_.end(), chunk.payload.begin(), chunk.payload.end());
  }
  open_ = true;
  return {};
}

Result<void> GeometryWriter::finish() {
  if (open_)
    if (const Result<void> sealed = seal(); !sealed) return sealed;
  while (pages_.size() > 0)
    if (const Result<void> written = write_one(); !written) return written;
  return {};
}

Result<void> GeometryWriter::seal() {
  const auto raw = std::make_shared<std::vector<std::byte>>(std::move(page_));
  std::vector<format::PageClusters> clusters = std::move(clusters_);
  page_.clear();
  clusters_.clear();
  open_ = false;
  ++number_;
  const uint64_t cost = raw->size();
  pages_.submit(
      [raw, clusters = std::move(clusters), level = zstd_level_,
       &time = sealing_](uint32_t) -> Result<format::SealedPage> {
        const Timed timed(time);
        return format::seal_page(format::PageKind::kGeometry, std::move(*raw), level, clusters);
      },
      cost);
  while (pages_.size() > limit_ || pages_.ready())
    if (const Result<void> written = write_one(); !written) return written;
  return {};
}

Result<void> GeometryWriter::write_one() {
  const Result<format::SealedPage> page = pages_.take();
  if (!page) return page.error();
  const Timed timed(writing_);
  const Result<uint32_t> number = writer_.append(*page);
  if (!number) return number.error();
  if (*number != written_)
    return Error{ErrorCode::kFormat, "page " + std::to_string(written_) + " became page " + std::to_string(*number)};
  ++written_;
  return {};
}

}  // namespace scree::convert
