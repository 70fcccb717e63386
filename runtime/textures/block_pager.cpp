#include "runtime/textures/block_pager.h"

#include <algorithm>
#include <new>
#include <string>
#include <utility>

#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

Error no_memory() {
  return {ErrorCode::kMemory, "no memory left for pages of its textures"};
}

}  // namespace

void BlockPager::add(uint32_t page) {
  slots_.push_back({page, 0, nullptr});
  blocks_.push_back(nullptr);
  wanted_.push_back(0);
  all_bytes_ += container_.pages()[page].raw_bytes;
}

/// The last round may have found all pages, so that bring() did not see what it wanted.
void BlockPager::begin_round() {
  for (size_t number = 0; number < slots_.size(); ++number)
    if (std::exchange(wanted_[number], uint8_t{0}) != 0) slots_[number].round = round_;
  ++round_;
}

Result<bool> BlockPager::bring(bool must) {
  try {
    std::vector<uint32_t> missing;
    uint64_t wanted_bytes = 0, missing_bytes = 0;
    for (uint32_t number = 0; number < slots_.size(); ++number) {
      if (wanted_[number] == 0) continue;
      slots_[number].round = round_;
      wanted_bytes += raw_bytes(number);
      if (blocks_[number] != nullptr) continue;
      missing.push_back(number);
      missing_bytes += raw_bytes(number);
    }
    if (wanted_bytes > budget_bytes_) {
      if (!must) return false;
      return Error{ErrorCode::kMemory, "a pixel shows pages of textures of " + std::to_string(wanted_bytes) +
                                           " bytes together, but " + std::to_string(budget_bytes_) +
                                           " are allowed for them"};
    }
    make_room(missing_bytes);
    if (Result<void> done = read(missing); !done) return done.error();
    return true;
  } catch (const std::bad_alloc&) {
    return no_memory();
  }
}

/// Drops pages that the last round did not want until `bytes` more fit.
void BlockPager::make_room(uint64_t bytes) {
  if (resident_bytes_ + bytes <= budget_bytes_) return;
  std::vector<uint32_t> unwanted;
  for (uint32_t number = 0; number < slots_.size(); ++number)
    if (blocks_[number] != nullptr && slots_[number].round != round_) unwanted.push_back(number);
  std::sort(unwanted.begin(), unwanted.end(), [&](uint32_t a, uint32_t b) {
    return slots_[a].round != slots_[b].round ? slots_[a].round < slots_[b].round : a < b;
  });
  for (auto next = unwanted.begin(); resident_bytes_ + bytes > budget_bytes_; ++next) {
    blocks_[*next] = nullptr;
    slots_[*next].raw.reset();
    resident_bytes_ -= raw_bytes(*next);
  }
}

Result<void> BlockPager::read(const std::vector<uint32_t>& missing) {
  const auto ask_for = [&](uint64_t i) {
    if (i >= missing.size()) return;
    const format::PageRecord& record = container_.pages()[slots_[missing[i]].page];
    map_.will_need(record.offset, record.stored_bytes);
  };
  for (uint64_t i = 0; i < 2 * uint64_t{threads_}; ++i) ask_for(i);
  FirstError failure;
  parallel_for(missing.size(), threads_, [&](uint64_t i) {
    if (failure.is_superseded(i)) return;
    ask_for(i + 2 * uint64_t{threads_});
    try {
      Result<std::unique_ptr<std::byte[]>> raw = read(slots_[missing[i]].page);
      if (!raw) return failure.report(i, raw.error());
      slots_[missing[i]].raw = std::move(*raw);
    } catch (const std::bad_alloc&) {
      failure.report(i, no_memory());
    }
  });
  // Pages that were read before an error are of use later.
  for (const uint32_t number : missing) {
    const Slot& slot = slots_[number];
    if (slot.raw == nullptr) continue;
    blocks_[number] = reinterpret_cast<const uint8_t*>(slot.raw.get());
    resident_bytes_ += raw_bytes(number);
    ++stats_.read_pages;
    stats_.read_bytes += raw_bytes(number);
    stats_.stored_bytes += container_.pages()[slot.page].stored_bytes;
  }
  if (failure.any()) return failure.error();
  return {};
}

/// By read() and not from the map: that takes no page faults, and a file that has become shorter is an error.
Result<std::unique_ptr<std::byte[]>> BlockPager::read(uint32_t page) const {
  const format::PageRecord& record = container_.pages()[page];
  const uint64_t padded_bytes = container_.padded_page(page).size();
  auto padded = std::make_unique_for_overwrite<std::byte[]>(padded_bytes);
  if (Result<void> done = map_.read(record.offset, {padded.get(), padded_bytes}); !done) return done.error();
  if (Result<void> done = container_.check_page(page, {padded.get(), padded_bytes}); !done) return done.error();
  if (record.codec == format::PageCodec::kRaw) return padded;
  auto raw = std::make_unique_for_overwrite<std::byte[]>(record.raw_bytes);
  const Result<void> done =
      container_.unpack_page(page, {padded.get(), record.stored_bytes}, {raw.get(), record.raw_bytes});
  if (!done) return done.error();
  return raw;
}

}  // namespace scree::runtime
