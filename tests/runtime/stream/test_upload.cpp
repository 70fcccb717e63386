// Uploads to a simulated device with threads: everything arrives, nothing is overwritten too early, and bad pages give
// the same errors as loading them for the CPU.
#include "runtime/stream/upload.h"

#include <zstd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <filesystem>
#include <limits>
#include <mutex>
#include <new>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "format/bytes.h"
#include "format/container/checksum.h"
#include "format/geometry/split_streams.h"
#include "runtime/files/direct_file.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/join_plan.h"
#include "runtime/stream/join_target.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"
#include "tools/bench/file_cache.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::format::SealedPage;

namespace {

constexpr uint64_t kNever = std::numeric_limits<uint64_t>::max();

/// A device that copies late and in order, on its own thread, and overwrites a slot with garbage when it has copied it.
class SlowDevice final : public scree::runtime::UploadTarget {
 public:
  SlowDevice(uint64_t arena_bytes, const StagingSizes& sizes, uint64_t failing_copy = kNever)
      : sizes_(sizes),
        failing_copy_(failing_copy),
        arena_(arena_bytes, std::byte{0xee}),
        writes_(arena_bytes),
        pending_(sizes.slots),
        ring_(static_cast<std::byte*>(::operator new(sizes.bytes(), kAlignment))),
        worker_([this] { work(); }) {}
  ~SlowDevice() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
    worker_.join();
    ::operator delete(ring_, kAlignment);
  }

  std::byte* slot(uint32_t slot) override {
    if (slot >= sizes_.slots) complain("a slot there is not");
    return ring_ + slot * sizes_.slot_bytes;
  }

  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) override {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (copies_++ == failing_copy_) return Error{ErrorCode::kDevice, "the device is gone"};
    if (pending_[slot]) complain("a second copy out of a slot");
    if (bytes > sizes_.slot_bytes || to > arena_.size() || bytes > arena_.size() - to) complain("out of bounds");
    pending_[slot] = true;
    queue_.push_back({slot, to, bytes});
    changed_.notify_all();
    return {};
  }

  /// If the device joins pages, it reports them as bad.
  JoinTarget* joins() override { return joins_pages_ ? &joins_ : nullptr; }
  Result<bool> finish_joins() override { return false; }
  void join_pages() { joins_pages_ = true; }

  Result<void> wait(uint32_t slot) override {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [&] { return !pending_[slot]; });
    return {};
  }

  uint64_t join_count() const { return joins_.count; }

  /// The first misuse of the device; empty if there was none.
  std::string first_error() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!queue_.empty()) return "copies are still under way";
    return first_error_;
  }
  const std::vector<std::byte>& arena() const { return arena_; }
  /// The largest number of writes to a byte of [from, from + bytes).
  int writes(uint64_t from, uint64_t bytes) const {
    const auto first = writes_.begin() + static_cast<ptrdiff_t>(from);
    return *std::max_element(first, first + static_cast<ptrdiff_t>(bytes));
  }

 private:
  static constexpr std::align_val_t kAlignment{4096};
  struct Copy {
    uint32_t slot;
    uint64_t to, bytes;
  };
  /// Slots for pages that are joined nowhere.
  struct Joins final : JoinTarget {
    explicit Joins(SlowDevice& of)
        : device(of),
          stride(scree::format::align_up(slot_bytes(), 4096)),
          memory(direct_memory(8 * stride)),
          taken(8) {}

    static constexpr size_t kMostTasks = 12;
    uint32_t slot_count() const override { return 8; }
    uint64_t slot_bytes() const override { return device.sizes_.join_slot_bytes(); }
    Result<Slot> take() override {
      const std::lock_guard<std::mutex> lock(device.mutex_);
      const auto slot = std::find(taken.begin(), taken.end(), false);
      if (slot == taken.end()) {
        device.complain("more slots than there are");
        return Error{ErrorCode::kDevice, "no slot"};
      }
      *slot = true;
      const auto number = static_cast<uint32_t>(slot - taken.begin());
      return Slot{number, {memory.get() + number * stride, slot_bytes()}};
    }
    void give_back(const Slot& slot) override {
      const std::lock_guard<std::mutex> lock(device.mutex_);
      if (!taken[slot.number]) device.complain("a slot given back twice");
      taken[slot.number] = false;
    }
    Result<bool> join(const Slot& slot, uint64_t bytes, const JoinPlan& plan) override {
      if (plan.tasks().size() > kMostTasks) return false;  // so that they are joined here
      give_back(slot);
      const std::lock_guard<std::mutex> lock(device.mutex_);
      if (plan.tasks().empty() || bytes > slot.memory.size()) device.complain("nothing to join, or too much");
      ++count;
      return true;
    }

    SlowDevice& device;
    uint64_t stride;
    DirectMemory memory;
    std::vector<bool> taken;
    uint64_t count = 0;
  };

  void complain(const char* text) {
    if (first_error_.empty()) first_error_ = text;
  }

  void work() {
    std::mt19937 random(7);
    std::unique_lock<std::mutex> lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return stopping_ || !queue_.empty(); });
      if (queue_.empty()) return;
      const Copy copy = queue_.front();
      lock.unlock();
      if (random() % 4 == 0) std::this_thread::sleep_for(std::chrono::microseconds(random() % 300));
      std::byte* const from = ring_ + copy.slot * sizes_.slot_bytes;
      std::memcpy(arena_.data() + copy.to, from, copy.bytes);
      for (uint64_t i = 0; i < copy.bytes; ++i) ++writes_[copy.to + i];
      std::memset(from, 0xcc, copy.bytes);
      lock.lock();
      queue_.pop_front();
      pending_[copy.slot] = false;
      changed_.notify_all();
    }
  }

  StagingSizes sizes_;
  uint64_t failing_copy_;
  std::vector<std::byte> arena_;
  std::vector<uint8_t> writes_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<bool> pending_;
  std::deque<Copy> queue_;
  std::string first_error_;
  uint64_t copies_ = 0;
  bool stopping_ = false;
  std::byte* ring_;
  bool joins_pages_ = false;
  Joins joins_{*this};
  std::thread worker_;
};

/// Two meshes on a lattice and one of floats, in small chunks.
std::vector<std::pair<Soup, Encoding>> some_meshes() {
  Encoding floats{.float32 = true};
  return {{scree::tests::grid(60, 0.2), {}}, {scree::tests::sphere(30, 0.1), floats}, {scree::tests::grid(25, 0), {}}};
}

/// Loads a scene without its pages.
Scene open_scene(const std::string& path) {
  return must_load(path, {.textures = false, .pages = false});
}

struct Attempt {
  Result<UploadCounts> result;
  std::string first_error;
  uint64_t joins = 0;
};

/// Uploads the pages of `scene` and `table`, and compares the uploaded bytes with the file.
Attempt upload(const Scene& scene, const StagingSizes& sizes, Reading reading, uint32_t threads,
               uint64_t failing_copy = kNever, bool joins = false) {
  std::vector<std::byte> table(50000);
  std::mt19937 random(1);
  for (std::byte& byte : table) byte = static_cast<std::byte>(random());
  UploadPlan plan;
  const uint64_t first = plan.add(table.data(), 100), second = plan.add(table.data(), table.size());
  CHECK(plan.add(nullptr, 0) % 256 == 0);
  plan.add_pages(scene.drawn_pages());
  SlowDevice device(plan.bytes(), sizes, failing_copy);
  if (joins) device.join_pages();
  Result<UploadCounts> done = run_upload(plan, scene.file().map(), device, sizes, reading, threads);
  const std::string first_error = device.first_error();
  if (!done) return {done, first_error, device.join_count()};
  // Pages are written again if the device refuses any.
  const int most_writes = joins ? 2 : 1;
  const auto arrived = [&](uint64_t offset, const std::byte* from, uint64_t bytes) {
    const int writes = device.writes(offset, bytes);
    return std::memcmp(device.arena().data() + offset, from, bytes) == 0 && writes >= 1 && writes <= most_writes;
  };
  CHECK(arrived(first, table.data(), 100));
  CHECK(arrived(second, table.data(), table.size()));
  for (uint64_t i = 0; i < scene.drawn_pages().size(); ++i) {
    std::vector<std::byte> scratch;
    const auto raw = must(scene.container().load_page(scene.drawn_pages().page(i), scratch));
    INFO("page " << scene.drawn_pages().page(i));
    CHECK(plan.page_offset(i) % 4096 == 0);
    CHECK(arrived(plan.page_offset(i), raw.data(), raw.size()));
  }
  return {done, first_error, device.join_count()};
}

/// All ways to divide the work: pages that are larger and smaller than a slot, more and fewer slots than threads.
template <class Body>
void for_all_ways(const Body& body) {
  for (const uint64_t slot_bytes : {uint64_t{4096}, uint64_t{16384}, uint64_t{65536}, uint64_t{1} << 20}) {
    for (const uint32_t slots : {1u, 2u, 7u}) {
      for (const uint32_t threads : {1u, 2u, 8u}) {
        for (const Reading reading : {Reading::kMapped, Reading::kBuffered, Reading::kDirect}) {
          INFO("slots of " << slot_bytes << ": " << slots << ", threads " << threads
                           << (reading == Reading::kDirect     ? ", direct"
                               : reading == Reading::kBuffered ? ", buffered"
                                                               : ", mapped"));
          body(StagingSizes{slot_bytes, slots}, reading, threads);
        }
      }
    }
  }
}

/// Checks that an upload fails as loading the pages for the CPU does, with `expected` in the message, also if the
/// device joins split pages.
void check_error(const std::string& path, const std::string& expected) {
  Scene scene = open_scene(path);
  const auto loaded = refusal(scene.load_pages(2));
  INFO(loaded.message);
  CHECK(loaded.message.find(expected) != std::string::npos);
  CHECK_FALSE(scene.has_pages());
  for_all_ways([&](const StagingSizes& sizes, Reading reading, uint32_t threads) {
    for (const bool joins : {false, true}) {
      const Attempt attempt = upload(scene, sizes, reading, threads, kNever, joins);
      REQUIRE_FALSE(attempt.result);
      CHECK(attempt.result.error().code == loaded.code);
      CHECK(path + ": " + attempt.result.error().message == loaded.message);
      CHECK(attempt.first_error == "");
    }
  });
}

void flip_byte(SealedPage& page, size_t at) {
  page.stored[at] ^= std::byte{0x10};
}

}  // namespace

TEST_CASE("an upload copies every page and table to its place", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("paged.scree");
  PagedScene{}.write(path, some_meshes());
  const Scene scene = open_scene(path);
  const auto& pages = scene.drawn_pages();
  REQUIRE(pages.size() > 8);
  UploadCounts expected;
  uint64_t raw_pages = 0;
  for (uint64_t i = 0; i < pages.size(); ++i) {
    CHECK(scene.view().pages[pages.page(i)] == nullptr);
    expected.stored_bytes += pages.record(i).stored_bytes;
    if (pages.record(i).codec == scree::format::PageCodec::kRaw) {
      ++raw_pages;
    } else {
      expected.unpacked_bytes += pages.record(i).raw_bytes;
    }
  }
  REQUIRE(raw_pages > 3);
  const bool has_direct = static_cast<bool>(DirectFile::open(scene.file().map()));
  if (!has_direct) WARN("the folder for temporary files has no direct reads");
  REQUIRE(expected.unpacked_bytes > 0);
  for_all_ways([&](const StagingSizes& sizes, Reading reading, uint32_t threads) {
    const Attempt attempt = upload(scene, sizes, reading, threads);
    REQUIRE(attempt.result);
    CHECK(attempt.first_error == "");
    CHECK(attempt.result->pages == pages.size());
    CHECK(attempt.result->stored_bytes == expected.stored_bytes);
    CHECK(attempt.result->unpacked_bytes == expected.unpacked_bytes);
    const bool is_direct = reading == Reading::kDirect && has_direct && sizes.slot_bytes > 16384;
    CHECK(attempt.result->direct_bytes >= (is_direct ? expected.stored_bytes : 0));
    if (reading != Reading::kDirect) CHECK(attempt.result->direct_bytes == 0);
  });
}

TEST_CASE("a chunk larger than a megabyte is uploaded in parts", "[upload]") {
  const TempFolder folder;
  for (const uint32_t zstd_every : {1u, 1000u}) {
    const std::string path = folder.file("large.scree");
    const PagedScene large{.zstd_every = zstd_every, .chunk_triangles = 1u << 20};
    const Encoding floats{.float32 = true, .chunk_triangles = 1u << 20};
    // The first page of both files is compressed.
    large.write(path, {{scree::tests::grid(2, 0), {}}, {scree::tests::grid(300, 0.2), floats}});
    const Scene scene = open_scene(path);
    REQUIRE(scene.drawn_pages().size() == 2);
    REQUIRE(scene.drawn_pages().record(1).raw_bytes > 1u << 20);
    CHECK((scene.drawn_pages().record(1).codec == scree::format::PageCodec::kZstd) == (zstd_every == 1));
    UploadPlan plan;
    plan.add_pages(scene.drawn_pages());
    const uint64_t room = scree::format::align_up(scene.drawn_pages().record(1).raw_bytes, 4096);
    CHECK(staging_for(plan, Reading::kBuffered, 1).slot_bytes == room);
    CHECK(staging_for(plan, Reading::kBuffered, 1, {room - 4096, 32}).slot_bytes == uint64_t{1} << 20);
    CHECK(staging_for(plan, Reading::kDirect, 1).slot_bytes == StagingSizes{}.slot_bytes);
    for (const uint64_t slot_bytes : {uint64_t{65536}, uint64_t{1} << 20, uint64_t{4} << 20}) {
      for (const uint32_t threads : {1u, 4u}) {
        for (const Reading reading : {Reading::kMapped, Reading::kBuffered, Reading::kDirect}) {
          const Attempt attempt = upload(scene, {slot_bytes, 3}, reading, threads);
          REQUIRE(attempt.result);
          CHECK(attempt.first_error == "");
        }
      }
    }
  }
}

TEST_CASE("an upload reports the first bad page, as loading for the CPU does", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("bad.scree");
  PagedScene scene;
  const auto check_written = [&](const std::string& words) {
    scene.write(path, some_meshes());
    check_error(path, words);
  };
  SECTION("a checksum") {
    scene.change = [](uint32_t number, SealedPage& page) {
      if (number == 5 || number == 9) flip_byte(page, page.stored.size() / 2);
    };
    check_written("page 5: the checksum differs");
  }
  SECTION("a checksum of a compressed page") {
    scene.change = [](uint32_t number, SealedPage& page) {
      if (number == 6) REQUIRE(page.record.codec == scree::format::PageCodec::kZstd);
      if (number == 6 || number == 9) flip_byte(page, page.stored.size() - 1);
    };
    check_written("page 6: the checksum differs");
  }
  SECTION("a zstd frame whose stated and real content is too short") {
    scene.change = [](uint32_t number, SealedPage& page) {
      if (number != 6) return;
      const std::vector<std::byte> text(page.record.raw_bytes - 1);
      page.stored.resize(ZSTD_compressBound(text.size()));
      page.stored.resize(ZSTD_compress(page.stored.data(), page.stored.size(), text.data(), text.size(), 1));
      page.record.stored_bytes = page.stored.size();
      page.record.checksum = scree::format::checksum(page.stored);
    };
    check_written("page 6: the zstd frame holds");
  }
  SECTION("a zstd frame whose blocks are damaged") {
    scene.change = [](uint32_t number, SealedPage& page) {
      if (number != 6) return;
      std::memset(page.stored.data() + 16, 0xff, page.stored.size() - 16);
      page.record.checksum = scree::format::checksum(page.stored);
    };
    check_written("page 6: zstd: ");
  }
  SECTION("padding that is not zero") {
    scene.write(path, some_meshes());
    std::string bytes = scree::tests::read_whole(path);
    const Scene good = open_scene(path);
    const auto pages = good.container().pages();
    uint32_t page = 3;
    while (pages[page].offset + pages[page].stored_bytes == pages[page + 1].offset) ++page;
    const uint64_t at = pages[page].offset + pages[page].stored_bytes;
    bytes[at] = 1;
    folder.write("bad.scree", bytes);
    check_error(path, "byte " + std::to_string(at) + " is padding, but not zero");
  }
  SECTION("an index past the vertices, with a matching checksum") {
    scene.zstd_every = 1000;
    scene.change = [](uint32_t number, SealedPage& page) {
      if (number != 5) return;
      std::memset(page.stored.data(), 0xff, 4000);
      page.record.checksum = scree::format::checksum(page.stored);
    };
    check_written("(page 5, byte 0): indices:");
  }
  SECTION("a page larger than a slot, raw or compressed") {
    for (const uint32_t zstd_every : {1u, 1000u}) {
      scene.page_bytes = 200000;
      scene.chunk_triangles = 20000;
      scene.zstd_every = zstd_every;
      scene.change = [](uint32_t number, SealedPage& page) {
        if (number == 1) flip_byte(page, page.stored.size() - 1);
      };
      scene.write(path, std::vector<std::pair<Soup, Encoding>>(3, {scree::tests::grid(90, 0.2), {}}));
      check_error(path, "page 1: the checksum differs");
    }
  }
}

TEST_CASE("pages that a device does not join are joined before they are copied", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("split.scree");
  PagedScene scene{.zstd_every = 2};
  scree::tests::Encoding clustered{.clusters = scree::tests::Clusters::kClustered};
  std::vector<std::pair<Soup, Encoding>> meshes = some_meshes();
  meshes[0].second = clustered;
  meshes[2].second = clustered;
  uint32_t split_pages = 0;
  scene.change = [&](uint32_t, SealedPage& page) {
    split_pages += page.record.codec == scree::format::PageCodec::kSplit;
  };
  scene.write(path, meshes);
  REQUIRE(split_pages > 2);
  const Scene file = open_scene(path);
  for_all_ways([&](const StagingSizes& sizes, Reading reading, uint32_t threads) {
    const Attempt attempt = upload(file, sizes, reading, threads, kNever, true);
    REQUIRE(attempt.result);
    CHECK(attempt.first_error == "");
    CHECK((attempt.joins != 0) == (sizes.slot_bytes <= 65536));
    // Pages have up to 9,000 bytes, and the tasks of larger slots exceed kMostTasks.
    if (sizes.slot_bytes == 16384) CHECK(attempt.result->joined_pages == split_pages);
  });
  // An error of a page that only the device would have found.
  scene.change = [&](uint32_t number, SealedPage& page) {
    if (page.record.codec != scree::format::PageCodec::kSplit || number < 3) return;
    std::vector<std::byte> split(ZSTD_getFrameContentSize(page.stored.data(), page.stored.size()));
    REQUIRE(ZSTD_decompress(split.data(), split.size(), page.stored.data(), page.stored.size()) == split.size());
    const auto streams = must(scree::format::split_streams::open_streams(split));
    const auto& gates = streams.bytes[scree::format::split_streams::kGates];
    split[static_cast<size_t>(gates.data() - split.data())] = std::byte{127};  // past the first triangle
    page.stored.resize(ZSTD_compressBound(split.size()));
    page.stored.resize(ZSTD_compress(page.stored.data(), page.stored.size(), split.data(), split.size(), 1));
    page.record.stored_bytes = page.stored.size();
    page.record.checksum = scree::format::checksum(page.stored);
  };
  scene.write(path, meshes);
  check_error(path, ": split page: a triangle with vertices that its cluster lacks");
}

TEST_CASE("a failing device ends an upload with its error and no copy under way", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("paged.scree");
  PagedScene{}.write(path, some_meshes());
  const Scene scene = open_scene(path);
  for (const uint64_t copy : {0u, 1u, 6u}) {
    for (const uint32_t threads : {1u, 2u, 8u}) {
      const Attempt attempt = upload(scene, {16384, 4}, Reading::kMapped, threads, copy);
      REQUIRE_FALSE(attempt.result);
      CHECK(attempt.result.error().code == ErrorCode::kDevice);
      CHECK(attempt.result.error().message == "the device is gone");
      CHECK(attempt.first_error == "");
    }
  }
}

TEST_CASE("staging memory is as large as the work needs, within its limit", "[upload]") {
  std::vector<std::byte> table(10 << 20);
  UploadPlan plan;
  plan.add(table.data(), table.size());
  CHECK(staging_for(plan, Reading::kMapped, 1).slots == 2);
  CHECK(staging_for(plan, Reading::kMapped, 16).slots == 10);  // 1 MiB per slot
  CHECK(staging_for(plan, Reading::kBuffered, 16).bytes() == 10u << 20);
  CHECK(staging_for(plan, Reading::kDirect, 16).slots == 3);  // 4 MiB per slot
  CHECK(staging_for(plan, Reading::kMapped, 16, {1 << 16, 32}).slots == 32);
  CHECK(staging_for(plan, Reading::kDirect, 1, {1 << 16, 32}).slots == 16);
  CHECK(staging_for(UploadPlan{}, Reading::kMapped, 0).slots == 1);
  CHECK(StagingSizes{}.bytes() == 128u << 20);
}

TEST_CASE("direct reads return the file's bytes, even after a rename", "[upload]") {
  const TempFolder folder;
  std::string text(3 * 4096 + 100, 'a');
  for (size_t i = 0; i < text.size(); ++i) text[i] = static_cast<char>(i * 7 + i / 4096);
  const std::string path = folder.write("bytes", text);
  const auto map = must(scree::runtime::MappedFile::open(path));
  CHECK(map.descriptor() >= 0);
  CHECK(map.cached_share() >= 0);
  CHECK(map.cached_share() <= 1);
  std::filesystem::rename(path, folder.file("elsewhere"));
  folder.write("bytes", "another file");
  const auto file = DirectFile::open(map);
  if (!file) {
    CHECK(file.error().code == ErrorCode::kUnsupported);
    WARN("the folder for temporary files has no direct reads");
    return;
  }
  struct alignas(4096) Block {
    char bytes[4096];
  };
  for (uint64_t first = 0; first < 4; ++first) {
    for (uint64_t count = 1; first + count <= 4; ++count) {
      std::vector<Block> blocks(count);
      for (Block& block : blocks) std::memset(block.bytes, '#', sizeof block.bytes);
      REQUIRE(file->read(4096 * first, std::as_writable_bytes(std::span(blocks))));
      const std::string expected = text.substr(4096 * first, 4096 * count);
      CHECK(std::memcmp(blocks.data(), expected.data(), expected.size()) == 0);
    }
  }
  std::filesystem::resize_file(folder.file("elsewhere"), 5000);
  std::vector<Block> blocks(4);
  REQUIRE(file->read(0, std::as_writable_bytes(std::span(blocks).first(1))));
  for (uint64_t first = 0; first < 4; ++first) {
    check_refusal(file->read(4096 * first, std::as_writable_bytes(std::span(blocks).first(4 - first))),
                  ErrorCode::kFile, ", but had 12388 when it was opened");
  }
}

TEST_CASE("large files that are not cached are read past the page cache", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("paged.scree");
  PagedScene{}.write(path, some_meshes());
  const Scene scene = open_scene(path);
  UploadPlan plan;
  plan.add_pages(scene.drawn_pages());
  // A small file is not read directly, whether cached or not. An explicit choice is followed.
  CHECK(choose_reading(plan, scene.file().map(), Reading::kAuto) == Reading::kBuffered);
  CHECK(choose_reading(plan, scene.file().map(), Reading::kDirect) == Reading::kDirect);
  CHECK(choose_reading(plan, scene.file().map(), Reading::kMapped) == Reading::kMapped);
  CHECK(choose_reading(UploadPlan{}, scene.file().map(), Reading::kAuto) == Reading::kBuffered);
}

TEST_CASE("the cached share of a file decides how it is read", "[upload]") {
  // The file has some megabytes: reading the tables of a small file would cache all of it, because the system reads
  // ahead.
  Soup soup;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  for (uint32_t i = 0; i < 3 * 200'000; ++i) soup.add(unit(random), unit(random), unit(random));
  for (uint32_t i = 0; i < 200'000; ++i) soup.triangle(3 * i, 3 * i + 1, 3 * i + 2);
  const TempFolder folder;
  const std::string path = folder.file("large.scree");
  const PagedScene paged{.page_bytes = 1 << 20, .chunk_triangles = 8192};
  paged.write(path, {{soup, scree::tests::float32()}});
  REQUIRE(std::filesystem::file_size(path) > 6 << 20);

  const Scene scene = open_scene(path);
  UploadPlan plan;
  plan.add_pages(scene.drawn_pages());
  uint64_t stored = 0;
  for (uint64_t i = 0; i < plan.pages()->size(); ++i) stored += plan.pages()->record(i).stored_bytes;
  const scree::runtime::MappedFile& map = scene.file().map();
  // Pages that opening has read stay, since they are mapped.
  const double left = must(scree::bench::drop_from_cache(path));
  if (left > 0.4) {
    WARN("skipped: this file system keeps " << 100 * left << "% of a file that is dropped from its cache");
  } else {
    CAPTURE(map.cached_share());
    CHECK(choose_reading(plan, map, Reading::kAuto, stored) == Reading::kDirect);
    CHECK(choose_reading(plan, map, Reading::kAuto, stored + 1) == Reading::kBuffered);
    CHECK(choose_reading(plan, map, Reading::kBuffered, stored) == Reading::kBuffered);
  }
  REQUIRE(must(scree::bench::bring_to_cache(path)) > 0.9);
  CHECK(choose_reading(plan, map, Reading::kAuto, stored) == Reading::kBuffered);
  CHECK(choose_reading(plan, map, Reading::kDirect, stored) == Reading::kDirect);
}

TEST_CASE("a scene opened without its pages loads them on request", "[upload]") {
  const TempFolder folder;
  const std::string path = folder.file("paged.scree");
  PagedScene{}.write(path, some_meshes());
  Scene scene = open_scene(path);
  CHECK_FALSE(scene.has_pages());
  const uint32_t page = scene.drawn_pages().page(3);  // compressed
  std::vector<std::byte> scratch;
  const auto read = must(scene.page(page, scratch));
  REQUIRE(scene.load_pages(2));
  CHECK(scene.has_pages());
  std::vector<std::byte> unused;
  const auto kept = must(scene.page(page, unused));
  CHECK(kept.data() == scene.view().pages[page]);
  CHECK(std::ranges::equal(kept, read));
}
