#include "tools/convert/sort/spill_buckets.h"

#include <algorithm>
#include <cassert>

namespace scree::convert {

void Grouping::start(std::span<const uint32_t> buckets, uint32_t bucket_count, uint32_t record_bytes, Grouped& out) {
  out.ends.assign(bucket_count, 0);
  for (const uint32_t bucket : buckets) ++out.ends[bucket];
  next_.resize(bucket_count);
  uint32_t sum = 0;
  for (size_t i = 0; i < bucket_count; ++i) {
    next_[i] = sum;
    sum += out.ends[i];
    out.ends[i] = sum;
  }
  out.records.resize(buckets.size() * record_bytes);
}

SpillBuckets::SpillBuckets(const format::PartFile& file, uint64_t offset, uint32_t buckets, uint32_t record_bytes)
    : file_(file), offset_(offset), record_bytes_(record_bytes), chains_(buckets) {}

Result<void> SpillBuckets::append(const Grouped& grouped) {
  uint64_t first = 0;
  for (size_t bucket = 0; bucket < grouped.ends.size(); ++bucket) {
    const uint64_t end = grouped.ends[bucket];
    if (end == first) continue;
    const auto records = std::span(grouped.records).subspan(first * record_bytes_, (end - first) * record_bytes_);
    SCREE_TRY(append(chains_[bucket], records));
    first = end;
  }
  return {};
}

Result<void> SpillBuckets::append(Chain& chain, std::span<const std::byte> records) {
  chain.records += records.size() / record_bytes_;
  chain.filling.reserve(block_bytes());
  while (!records.empty()) {
    const size_t part = std::min<size_t>(records.size(), block_bytes() - chain.filling.size());
    chain.filling.insert(chain.filling.end(), records.begin(), records.begin() + static_cast<std::ptrdiff_t>(part));
    records = records.subspan(part);
    if (chain.filling.size() < block_bytes()) break;
    SCREE_TRY(write_block(chain));
  }
  return {};
}

Result<void> SpillBuckets::write_block(Chain& chain) {
  SCREE_TRY(file_.write_at(offset_ + next_block_ * block_bytes(), chain.filling));
  chain.blocks.push_back(next_block_++);
  chain.filling.clear();
  return {};
}

Result<void> SpillBuckets::finish() {
  for (Chain& chain : chains_) {
    if (!chain.filling.empty()) SCREE_TRY(write_block(chain));
    chain.filling = {};
  }
  return {};
}

Result<void> SpillBuckets::read(uint32_t bucket, uint64_t first, std::span<std::byte> out) const {
  const Chain& chain = chains_[bucket];
  assert(out.size() % record_bytes_ == 0 && first + out.size() / record_bytes_ <= chain.records);
  uint64_t at = first * record_bytes_;
  while (!out.empty()) {
    const uint64_t inside = at % block_bytes();
    const size_t part = std::min<size_t>(out.size(), block_bytes() - inside);
    const uint64_t block = chain.blocks[at / block_bytes()];
    SCREE_TRY(file_.read_at(offset_ + block * block_bytes() + inside, out.first(part)));
    out = out.subspan(part);
    at += part;
  }
  return {};
}

uint64_t SpillBuckets::most_file_bytes(uint64_t records, uint32_t buckets, uint32_t record_bytes) {
  // The last block of each bucket may be partly filled.
  return records * record_bytes + buckets * kBlockBytes;
}

uint64_t SpillBuckets::most_memory(uint64_t records, uint32_t buckets, uint32_t record_bytes) {
  const uint64_t blocks = records / (kBlockBytes / record_bytes) + buckets;
  return buckets * (kBlockBytes + sizeof(Chain)) + 2 * sizeof(uint32_t) * blocks;
}

}  // namespace scree::convert
