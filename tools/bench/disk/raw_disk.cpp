#include "tools/bench/disk/raw_disk.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <new>
#include <random>

#include <fcntl.h>
#include <unistd.h>

#include "format/bytes.h"
#include "runtime/files/direct_file.h"
#include "runtime/files/mapped_file.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"
#include "runtime/threads/stopwatch.h"
#include "tools/bench/disk/file_cache.h"
#include "tools/bench/report/case_result.h"

namespace scree::bench {
namespace {

using runtime::DirectFile;
using runtime::DirectMemory;
using runtime::MappedFile;

constexpr uint32_t kWritesInFlight = 4;
constexpr uint64_t kRoundBytes = uint64_t{256} << 20;  // written between two looks at the rate
constexpr size_t kSteadyRounds = 3;
constexpr double kSteadyChange = 0.02;

/// Calls `move(memory, offset, bytes)` for every block of [begin, end), as many at a time as there are memories; the
/// first error by place.
template <class Move>
Result<void> move_blocks(uint64_t begin, uint64_t end, const std::vector<DirectMemory>& memory, const Move& move) {
  const uint64_t blocks = (end - begin + kRawBlockBytes - 1) / kRawBlockBytes;
  const auto movers = static_cast<uint32_t>(std::min<uint64_t>(blocks, memory.size()));
  runtime::FirstError failure;
  std::atomic<uint64_t> next{0};
  runtime::parallel_for(movers, movers, [&](uint64_t mover) {
    for (uint64_t i = next++; i < blocks; i = next++) {
      const uint64_t offset = begin + i * kRawBlockBytes;
      const uint64_t bytes = format::align_up(std::min(kRawBlockBytes, end - offset), DirectFile::kAlignment);
      if (const Result<void> moved = move(memory[mover].get(), offset, bytes); !moved)
        return failure.report(i, moved.error());
    }
  });
  if (failure.any()) return failure.error();
  return {};
}

std::vector<DirectMemory> block_memory(uint32_t count) {
  std::vector<DirectMemory> memory;
  for (uint32_t i = 0; i < count; ++i) memory.push_back(runtime::direct_memory(kRawBlockBytes));
  return memory;
}

/// A new file that is written past the page cache, gone with this.
class WrittenFile {
 public:
  explicit WrittenFile(const std::string& path)
      : path_(path), descriptor_(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_DIRECT, 0600)) {
    if (descriptor_ < 0) error_ = errno;
  }
  WrittenFile(const WrittenFile&) = delete;
  WrittenFile& operator=(const WrittenFile&) = delete;
  ~WrittenFile() {
    if (descriptor_ < 0) return;
    ::close(descriptor_);
    ::unlink(path_.c_str());
  }

  Result<void> opened() const { return descriptor_ < 0 ? error("cannot write", error_) : Result<void>(); }

  /// Its blocks have their places before the clock starts, where the file system can: writes that lengthen a file wait
  /// for each other.
  Result<void> reserve(uint64_t bytes) const {
    if (::fallocate(descriptor_, 0, 0, static_cast<off_t>(bytes)) == 0 || errno == EOPNOTSUPP) return {};
    return error("cannot reserve", errno);
  }

  Result<void> write(const std::byte* from, uint64_t offset, uint64_t bytes) const {
    for (uint64_t done = 0; done < bytes;) {
      const ssize_t written = ::pwrite(descriptor_, from + done, bytes - done, static_cast<off_t>(offset + done));
      if (written < 0 && errno == EINTR) continue;
      if (written <= 0) return error("cannot write", written < 0 ? errno : ENOSPC);
      done += static_cast<uint64_t>(written);
    }
    return {};
  }

  Result<void> sync() const {
    while (::fsync(descriptor_) != 0)
      if (errno != EINTR) return error("cannot sync", errno);
    return {};
  }

 private:
  Result<void> error(const char* doing, int number) const {
    // EINVAL is what file systems say that have no such writes; they are well formed.
    return Error{number == EINVAL ? ErrorCode::kUnsupported : ErrorCode::kFile,
                 path_ + ": " + doing + " past the page cache: " + std::strerror(number)};
  }

  std::string path_;
  int descriptor_;
  int error_ = 0;
};

}  // namespace

Result<RawRate> read_raw(const std::string& path, uint32_t in_flight) {
  const Result<MappedFile> map = MappedFile::open(path);
  if (!map) return map.error();
  if (map->size() == 0) return RawRate{};
  const Result<DirectFile> file = DirectFile::open(*map);
  if (!file) return at(path, file.error());
  RawRate raw;
  raw.bytes = std::min(map->size(), kMostRawBytes);
  try {
    const std::vector<DirectMemory> memory = block_memory(in_flight);
    const runtime::Stopwatch watch;
    const Result<void> read =
        move_blocks(0, raw.bytes, memory, [&](std::byte* to, uint64_t offset, uint64_t bytes) -> Result<void> {
          return file->read(offset, {to, bytes});
        });
    raw.seconds = watch.elapsed().wall_ms * 1e-3;
    if (!read) return at(path, read.error());
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to read it"};
  }
  return raw;
}

Result<RawRate> write_raw(const std::string& path, uint64_t most_bytes) {
  const uint64_t most = format::align_up(std::min(most_bytes, kMostRawWriteBytes), DirectFile::kAlignment);
  try {
    const std::vector<DirectMemory> memory = block_memory(kWritesInFlight);
    std::mt19937_64 random(1);
    for (const DirectMemory& block : memory) {
      for (uint64_t i = 0; i < kRawBlockBytes; i += sizeof(uint64_t)) {
        const uint64_t noise = random();
        std::memcpy(block.get() + i, &noise, sizeof noise);
      }
    }
    const WrittenFile file(path);
    if (const Result<void> opened = file.opened(); !opened) return opened.error();
    if (const Result<void> reserved = file.reserve(most); !reserved) return reserved.error();
    RawRate raw;
    std::vector<double> rates;
    const runtime::Stopwatch watch;
    while (raw.bytes < most && !is_steady(rates)) {
      const uint64_t end = std::min(raw.bytes + kRoundBytes, most);
      const Result<void> written = move_blocks(
          raw.bytes, end, memory,
          [&](const std::byte* from, uint64_t offset, uint64_t bytes) { return file.write(from, offset, bytes); });
      if (!written) return written.error();
      raw.bytes = end;
      raw.seconds = watch.elapsed().wall_ms * 1e-3;
      rates.push_back(raw.gb_per_s());
    }
    if (const Result<void> synced = file.sync(); !synced) return synced.error();
    raw.seconds = watch.elapsed().wall_ms * 1e-3;
    return raw;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to write it"};
  }
}

bool is_steady(std::span<const double> rates) {
  if (rates.size() < kSteadyRounds) return false;
  for (size_t i = rates.size() - kSteadyRounds + 1; i < rates.size(); ++i)
    if (std::abs(rates[i] - rates[i - 1]) >= kSteadyChange * rates[i - 1]) return false;
  return true;
}

Result<void> RawReads::read(const std::string& path, std::vector<std::string>& notes) {
  if (is_missing_) return {};
  if (const auto dropped = drop_from_cache(path); !dropped) return dropped.error();
  if (in_flight_ != 0) {
    const Result<RawRate> raw = read_raw(path, in_flight_);
    if (!raw) return raw.error();
    rates_.push_back(static_cast<float>(raw->gb_per_s()));
    return {};
  }
  float most = 0;
  for (const uint32_t in_flight : {1u, 4u, 16u}) {
    const Result<RawRate> raw = read_raw(path, in_flight);
    if (!raw && raw.error().code != ErrorCode::kUnsupported) return raw.error();
    if (!raw) {
      notes.push_back(raw.error().message);
      is_missing_ = true;
      return {};
    }
    bytes_ = raw->bytes;
    const auto rate = static_cast<float>(raw->gb_per_s());
    if (in_flight_ == 0 || rate > most) in_flight_ = in_flight;
    most = std::max(most, rate);
  }
  rates_.push_back(most);
  return {};
}

double RawReads::gb_per_s() const {
  return rates_.empty() ? 0 : summarize(rates_).median;
}

}  // namespace scree::bench
