#include "tools/convert/passes/resume.h"

#include <sys/stat.h>

#include <algorithm>
#include <span>

#include "tools/common/content_hash.h"

namespace scree::convert {
namespace {

// Change this number whenever log entries change, or the cutting or packing of a scene.
constexpr uint64_t kLogFormat = 6;

enum EntryKind : uint32_t { kImageEntry = 16, kWindowsEntry = 17 };

template <class Stream, class Outcome>
void visit_numbers(Stream&& stream, Outcome& window) {
  stream(window.made_from);
  stream(window.position_error);
  stream(window.uv_error);
  stream(window.welded.vertices);
  stream(window.welded.source_bytes);
  stream(window.welded.cost_bits);
  stream(window.repaired_uvs);
  stream(window.repaired_colors);
  stream(window.repaired_normals);
  stream(window.repaired_tangents);
}

}  // namespace

format::PartId part_id(const std::string& options, const std::set<std::string>& files, const ImagePlan& images) {
  ContentHasher hasher;
  const auto add = [&](const auto& value) { hasher.add(std::as_bytes(std::span(&value, 1))); };
  const auto add_text = [&](const std::string& text) {
    add(uint64_t{text.size()});
    hasher.add(std::as_bytes(std::span(text)));
  };
  add(kLogFormat);
  add_text("scree " SCREE_VERSION);
  add_text(options);
  for (const std::string& file : files) {
    struct stat status {};
    add_text(file);
    if (::stat(file.c_str(), &status) != 0) continue;  // the file has vanished; reading it reports that
    add(uint64_t{static_cast<uint64_t>(status.st_size)});
    add(int64_t{status.st_mtim.tv_sec});
    add(int64_t{status.st_mtim.tv_nsec});
  }
  hasher.add(std::as_bytes(std::span(images.hashes)));
  return hasher.value();
}

ContentHash window_id(const WindowPlan& window, uint32_t mesh, const format::MeshRecord& record) {
  ContentHasher hasher;
  const auto add = [&](const auto& value) { hasher.add(std::as_bytes(std::span(&value, 1))); };
  add(window.primitive);
  add(window.vertices);
  add(window.first);
  add(window.count);
  add(window.kept);
  add(window.box.lo);
  add(window.box.hi);
  add(mesh);
  add(record.triangle_count);
  add(record.position_encoding);
  add(record.attributes);
  add(record.bounds_min);
  add(record.bounds_max);
  add(record.lattice_min);
  add(record.lattice_bits);
  add(record.lattice_exponent);
  return hasher.value();
}

void add_image(EntryWriter& entry, const StoredImageRecord& image) {
  entry.add(image.record);
  entry.add(image.page_count);
  entry.add_list(image.levels);
  entry.add_text(image.warning);
}

bool take_image(EntryReader& entry, StoredImageRecord& image) {
  entry.take(image.record);
  entry.take(image.page_count);
  entry.take_list(image.levels);
  entry.take_text(image.warning);
  return !entry.failed();
}

void add_window(EntryWriter& entry, const WindowOutcome& window) {
  visit_numbers([&](const auto& value) { entry.add(value); }, window);
  entry.add_list(window.chunks);
  entry.add_list(window.saved);
}

bool take_window(EntryReader& entry, WindowOutcome& window) {
  visit_numbers([&](auto& value) { entry.take(value); }, window);
  entry.take_list(window.chunks);
  entry.take_list(window.saved);
  // `saved` has one entry per chunk; other lengths were not written by add_window().
  return !entry.failed() && window.saved.size() == window.chunks.size();
}

void log_image(format::ContainerWriter& writer, uint64_t number, const StoredImageRecord& image) {
  EntryWriter entry;
  entry.add(number);
  add_image(entry, image);
  writer.log(kImageEntry, entry.bytes());
}

void log_windows(format::ContainerWriter& writer, uint64_t number, const std::vector<WindowOutcome>& windows) {
  EntryWriter entry;
  entry.add(number);
  for (const WindowOutcome& window : windows) add_window(entry, window);
  writer.log(kWindowsEntry, entry.bytes());
}

void read_entry(uint32_t kind, std::span<const std::byte> entry, Resumed& resumed) {
  EntryReader reader(entry);
  uint64_t number = 0;
  reader.take(number);
  if (kind == kImageEntry && number <= resumed.images.size()) {
    resumed.images.resize(number);
    StoredImageRecord image;
    if (take_image(reader, image)) resumed.images.push_back(std::move(image));
  }
  if (kind != kWindowsEntry || number > resumed.windows.size()) return;
  resumed.windows.resize(number);
  while (reader.more()) {
    WindowOutcome window;
    if (!take_window(reader, window)) return;
    resumed.windows.push_back(std::move(window));
  }
}

void drop_incomplete_tail(Resumed& resumed, uint32_t pages, size_t image_count, size_t window_count) {
  resumed.pages = 0;
  resumed.whole_windows = resumed.chunks_of_next = 0;
  size_t images = 0;
  while (images < std::min(resumed.images.size(), image_count) &&
         pages - resumed.pages >= resumed.images[images].page_count)
    resumed.pages += resumed.images[images++].page_count;
  resumed.images.resize(images);
  if (images < image_count) resumed.windows.clear();
  if (resumed.windows.size() > window_count) resumed.windows.resize(window_count);
  if (resumed.windows.empty() || resumed.windows.back().chunks.empty()) {
    resumed.windows.clear();
    return;
  }
  // The page of the last chunk is dropped, because it may also hold chunks of windows that were not logged.
  resumed.pages = std::max(resumed.pages, std::min(pages, resumed.windows.back().chunks.back().page));
  const auto is_kept = [&](const format::ChunkRecord& chunk) { return chunk.page < resumed.pages; };
  while (resumed.whole_windows < resumed.windows.size()) {
    const std::vector<format::ChunkRecord>& chunks = resumed.windows[resumed.whole_windows].chunks;
    if (!std::all_of(chunks.begin(), chunks.end(), is_kept)) {
      resumed.chunks_of_next = static_cast<size_t>(std::count_if(chunks.begin(), chunks.end(), is_kept));
      break;
    }
    ++resumed.whole_windows;
  }
  resumed.windows.resize(std::min(resumed.windows.size(), resumed.whole_windows + 1));
}

}  // namespace scree::convert
