#include "runtime/textures/block_pager.h"

#include <algorithm>
#include <new>
#include <string>
#include <utility>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "runtime/files/read_ahead.h"
#include "runtime/threads/first_error.h"

namespace scree::runtime {
namespace {

/// Compressed pages of blocks take no more.
constexpr uint64_t kUsualPackedBytes = format::kBlockPageBytes;

}  // namespace

Error BlockPager::no_memory() {
  return {ErrorCode::kMemory, "no memory left for pages of its textures"};
}

void BlockPager::add(uint32_t file_page, const JpegLevels& jpeg) {
  file_pages_.push_back(file_page);
  jpegs_.push_back(jpeg);
  was_read_.push_back(0);
  in_room_.push_back(0);
  blocks_.push_back(nullptr);
  all_bytes_ += container_.pages()[file_page].raw_bytes;
}

void BlockPager::add_all_of(const BlockPager& other) {
  for (uint64_t number = 0; number < other.size(); ++number) add(other.file_pages_[number], other.jpegs_[number]);
}

uint64_t BlockPager::page_bytes(uint64_t number) const {
  const uint64_t raw_bytes = record(number).raw_bytes;
  const JpegLevels& jpeg = jpegs_[number];
  return jpeg.count == 0 ? raw_bytes : jpeg_head_place(raw_bytes, container_.images()[jpeg.image].channels, jpeg.count);
}

Result<bool> BlockPager::bring(bool must) try {
  const std::span<const uint64_t> last = SCREE_TRY(wanted());
  std::vector<uint32_t> shown;
  std::vector<uint32_t> missing;
  uint64_t shown_bytes = 0;
  uint64_t present_bytes = 0;
  for (uint32_t number = 0; number < size(); ++number) {
    if (last[number] != pages_.round) continue;
    shown.push_back(number);
    shown_bytes += bytes_of(number);
    if (blocks_[number] == nullptr) {
      missing.push_back(number);
    } else if (is_in_room(number)) {
      present_bytes += bytes_of(number);
    } else {
      shown_bytes -= bytes_of(number);  // it needs no room
    }
  }
  bool fits = shown_bytes <= room_bytes_;
  std::vector<uint32_t> kept;
  if (!fits && present_bytes <= room_bytes_) {
    std::vector<uint32_t> rest = missing;
    kept = split_missing(rest, room_bytes_ - present_bytes);
    fits = !kept.empty() && keep(kept, last);
    if (fits) {
      missing = std::move(rest);
    } else {
      kept.clear();
    }
  }
  refused_bytes_ = !fits && must ? shown_bytes : 0;
  if (!fits && must)
    return Error{ErrorCode::kMemory, "a pixel shows pages of textures of " + std::to_string(shown_bytes) +
                                         " bytes together, but " + std::to_string(room_bytes_) +
                                         " are allowed for them"};
  if (!fits && !has_patience()) return false;
  if (!fits) {
    // The picture will not wait for all of them, so as many are read as the room holds.
    size_t count = 0;
    for (uint64_t left = room_bytes_ - present_bytes; count < missing.size(); left -= bytes_of(missing[count++]))
      if (bytes_of(missing[count]) > left) break;
    missing.resize(count);
  }
  if (!take_all(missing, last)) {
    if (!fits) return false;
    // The free room lies in pieces between pages that are wanted.
    std::vector<uint8_t> is_kept(size());
    for (const uint32_t number : kept) is_kept[number] = 1;
    for (uint32_t number = 0; number < size(); ++number)
      if (is_in_room(number)) drop(number);
    missing.clear();
    for (const uint32_t number : shown)
      if (blocks_[number] == nullptr && is_kept[number] == 0) missing.push_back(number);
    for (const uint32_t number : missing) (void)take_next(number);
  }
  const auto try_to = [](const auto& load_pages) -> Result<void> {
    try {
      return load_pages();
    } catch (const std::bad_alloc&) {
      return no_memory();
    }
  };
  Result<void> done = try_to([&] { return load(missing); });
  if (!kept.empty()) {  // also after an error, because it gives memory back
    Result<void> kept_done = try_to([&] { return load_kept(kept); });
    if (done) done = std::move(kept_done);
  }
  // Pages that were read before an error, or before the patience ended, are kept for later.
  for (const uint32_t number : missing) {
    if (blocks_[number] == nullptr) {
      drop(number);
      continue;
    }
    count_read(number);
  }
  for (const uint32_t number : kept)
    if (blocks_[number] != nullptr) count_read(number);
  if (!done) return done.error();
  return fits;
} catch (const std::bad_alloc&) {
  return no_memory();
}

Result<uint64_t> BlockPager::wanted_bytes(uint64_t first) {
  const std::span<const uint64_t> last = SCREE_TRY(wanted());
  uint64_t bytes = 0;
  for (uint64_t number = 0; number < size(); ++number)
    if (last[number] >= first) bytes += bytes_of(number);
  return bytes;
}

void BlockPager::drop_if(const std::function<bool(uint32_t number)>& is_dropped) {
  for (uint32_t number = 0; number < size(); ++number)
    if (is_in_room(number) && is_dropped(number)) drop(number);
}

Result<uint64_t> BlockPager::missing_since(uint64_t first) {
  const std::span<const uint64_t> last = SCREE_TRY(wanted());
  uint64_t bytes = 0;
  for (uint64_t number = 0; number < size(); ++number)
    if (last[number] >= first && blocks_[number] == nullptr) bytes += record(number).raw_bytes;
  return bytes;
}

bool BlockPager::take_next(uint64_t number) {
  if (resident_bytes_ + bytes_of(number) > room_bytes_ || !take(number)) return false;
  resident_bytes_ += bytes_of(number);
  in_room_[number] = 1;
  return true;
}

void BlockPager::drop(uint64_t number) {
  blocks_[number] = kept_address(number);
  in_room_[number] = 0;
  give_back(number);
  resident_bytes_ -= bytes_of(number);
}

/// Divides `missing`: pages that fit `left` bytes of the room stay in it, the others are returned. JPEG pages stay, so
/// none is returned if these alone exceed `left`.
std::vector<uint32_t> BlockPager::split_missing(std::vector<uint32_t>& missing, uint64_t left) const {
  uint64_t jpeg_bytes = 0;
  for (const uint32_t number : missing)
    if (has_jpeg(number)) jpeg_bytes += bytes_of(number);
  if (jpeg_bytes > left) return {};
  left -= jpeg_bytes;
  std::vector<uint32_t> rest;
  std::erase_if(missing, [&](uint32_t number) {
    if (has_jpeg(number)) return false;
    if (bytes_of(number) > left) {
      rest.push_back(number);
      return true;
    }
    left -= bytes_of(number);
    return false;
  });
  return rest;
}

void BlockPager::count_read(uint64_t number) {
  ++stats_.read_pages;
  stats_.read_bytes += record(number).raw_bytes;
  stats_.stored_bytes += record(number).stored_bytes;
}

std::vector<uint32_t> BlockPager::unwanted_since(uint64_t first, std::span<const uint64_t> wanted) const {
  std::vector<uint32_t> unwanted;
  for (uint32_t number = 0; number < size(); ++number)
    if (is_in_room(number) && wanted[number] < first) unwanted.push_back(number);
  std::sort(unwanted.begin(), unwanted.end(),
            [&](uint32_t a, uint32_t b) { return wanted[a] != wanted[b] ? wanted[a] < wanted[b] : a < b; });
  return unwanted;
}

/// Drops pages that the round did not mark until memory for all is taken. Takes none if that is not enough.
bool BlockPager::take_all(std::span<const uint32_t> numbers, std::span<const uint64_t> wanted) {
  size_t taken = 0;
  const auto take_more = [&] {
    while (taken < numbers.size() && take_next(numbers[taken])) ++taken;
    return taken == numbers.size();
  };
  if (take_more()) return true;
  for (const uint32_t number : unwanted_since(pages_.round, wanted)) {
    // `numbers` that were taken are not unwanted: the round wanted them.
    drop(number);
    if (take_more()) return true;
  }
  while (taken > 0) drop(numbers[--taken]);
  return false;
}

uint64_t BlockPager::read_bytes(uint64_t number) const {
  const bool is_raw = record(number).codec == format::PageCodec::kRaw;
  const uint64_t padded = is_raw ? container_.padded_page(file_pages_[number]).size() : 0;
  return std::max(format::align_up(padded, DirectFile::kAlignment), page_bytes(number));
}

/// Resolves Reading::kAuto, and opens the file for reads past the page cache if pages are read so.
Result<void> BlockPager::open_direct() {
  if (reading_ == Reading::kAuto) {
    uint64_t bytes = 0;
    for (uint64_t number = 0; number < size(); ++number) bytes += record(number).stored_bytes;
    reading_ = bytes >= kDirectBytes && map_.cached_share() < 0.5 ? Reading::kDirect : Reading::kBuffered;
  }
  if (reading_ != Reading::kDirect || direct_) return {};
  Result<DirectFile> file = DirectFile::open(map_);
  if (!file && file.error().code != ErrorCode::kUnsupported) return file.error();
  is_direct_ = static_cast<bool>(file);
  if (file)
    direct_.emplace(std::move(*file));
  else
    reading_ = Reading::kBuffered;
  return {};
}

Result<void> BlockPager::read_all(std::span<const uint32_t> numbers, const std::function<Target(uint64_t i)>& to,
                                  const std::function<void(uint64_t i)>& was_read) {
  SCREE_TRY(open_direct());
  ReadAhead ahead(map_);
  for (const uint32_t number : numbers) {
    if (!is_direct_ || was_read_[number] != 0) ahead.add(record(number).offset, record(number).stored_bytes);
    ahead.end_item();
  }
  FirstError failure;
  // Threads that were started for every batch would take longer than a small batch.
  if (!workers_) workers_.emplace(is_direct_ ? std::max(threads_, kDirectThreads) : threads_);
  workers_->for_each(numbers.size(), [&](uint64_t i) {
    if (failure.is_superseded(i)) return;
    ahead.begin(i);
    try {
      const Result<void> done = read(numbers[i], to(i));
      if (!done) return failure.report(i, done.error());
      was_read_[numbers[i]] = 1;
      was_read(i);
    } catch (const std::bad_alloc&) {
      failure.report(i, no_memory());
    }
  });
  stats_.direct_pages = direct_pages_;
  if (failure.any()) return failure.error();
  return {};
}

/// Reads, checks and unpacks a page, and writes its heads.
Result<void> BlockPager::read(uint64_t number, const Target& to) {
  const uint32_t page = file_pages_[number];
  const format::PageRecord& stored = record(number);
  const uint64_t padded_bytes = container_.padded_page(page).size();
  const uint64_t room = format::align_up(padded_bytes, DirectFile::kAlignment);
  const bool is_raw = stored.codec == format::PageCodec::kRaw;
  // Memory for packed bytes of usual pages is kept per thread. Otherwise most pages would map and fault in memory.
  thread_local DirectMemory usual;
  DirectMemory large;
  const bool is_usual = room <= kUsualPackedBytes;
  if (!is_raw && is_usual && !usual) usual = direct_memory(kUsualPackedBytes);
  if (!is_raw && !is_usual) large = direct_memory(room);
  std::byte* const padded = is_raw ? to.memory : is_usual ? usual.get() : large.get();
  SCREE_TRY(read_stored(number, {padded, room}));
  SCREE_TRY(container_.check_page(page, {padded, padded_bytes}));
  if (!is_raw) SCREE_TRY(container_.unpack_page(page, {padded, stored.stored_bytes}, {to.memory, stored.raw_bytes}));
  return write_jpeg_heads(container_, jpegs_[number], to.memory, stored.raw_bytes, to.address);
}

/// Reads a page with its padding, and not from the map. That causes no page faults, and a file that has become shorter
/// is an error. `padded`: the padded page, rounded up to DirectFile::kAlignment.
Result<void> BlockPager::read_stored(uint64_t number, std::span<std::byte> padded) {
  if (is_direct_ && was_read_[number] == 0) {
    const Result<void> done = direct_->read(record(number).offset, padded);
    if (done) ++direct_pages_;
    if (done || done.error().code != ErrorCode::kUnsupported) return done;
    is_direct_ = false;  // the memory or the file system does not support it
  }
  return map_.read(record(number).offset, padded.first(container_.padded_page(file_pages_[number]).size()));
}

void HostBlockPager::add(uint32_t file_page, const JpegLevels& jpeg) {
  BlockPager::add(file_page, jpeg);
  wanted_.push_back(0);
  raw_.emplace_back();
  pages_.blocks = blocks_.data();
  pages_.wanted = wanted_.data();
}

Result<void> HostBlockPager::load(std::span<const uint32_t> numbers) {
  // So many pages of 256 KiB take a few milliseconds.
  const size_t most = has_patience() ? 8 * size_t{threads()} : numbers.size();
  Result<void> done;
  while (done && !numbers.empty()) {
    done = load_part(numbers.first(std::min(numbers.size(), most)));
    numbers = numbers.subspan(std::min(numbers.size(), most));
    if (is_over()) break;
  }
  return done;
}

Result<void> HostBlockPager::load_part(std::span<const uint32_t> numbers) {
  std::vector<DirectMemory> read(numbers.size());
  return read_all(
      numbers,
      [&](uint64_t i) {
        read[i] = direct_memory(read_bytes(numbers[i]));
        return Target{read[i].get(), read[i].get()};
      },
      [&](uint64_t i) {
        raw_[numbers[i]] = std::move(read[i]);
        blocks_[numbers[i]] = reinterpret_cast<const uint8_t*>(raw_[numbers[i]].get());
      });
}

}  // namespace scree::runtime
