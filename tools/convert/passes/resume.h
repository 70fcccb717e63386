// The log of a conversion in its .part (format/container/part_log.h). After a crash it shows which images and windows
// are already done.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/container/part_log.h"
#include "tools/common/content_hash.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/images/images.h"
#include "tools/convert/passes/log_entry.h"
#include "tools/convert/windows/measure.h"

namespace scree::convert {

/// A window's additions to the tables.
struct WindowOutcome : EncodedFacts {
  ContentHash made_from{};                  // window_id()
  std::vector<format::ChunkRecord> chunks;  // with page and offset
  std::vector<int64_t> saved;               // by chunk: EncodedChunk::saved
};

/// The state of an earlier run's .part. All lists are in the order of writing.
struct Resumed {
  std::vector<StoredImageRecord> images;
  std::vector<WindowOutcome> windows;  // the last one may be incomplete
  size_t whole_windows = 0;            // number of windows that need not be encoded again
  size_t chunks_of_next = 0;           // chunks of the next window that are in finished pages
  uint32_t pages = 0;                  // number of finished pages to be kept
};

/// A hash of everything that affects the pages and is known before the geometry is measured: program, options, the
/// files with their sizes and modification times, and the images. `options`: as text.
format::PartId part_id(const std::string& options, const std::set<std::string>& files, const ImagePlan& images);

/// A hash of the measured values that affect the chunks of a window: `window`, and the record of its mesh, number
/// `mesh`, as it is before the first chunk.
ContentHash window_id(const WindowPlan& window, uint32_t mesh, const format::MeshRecord& record);

/// Entries of an image and of a window. The take functions return false if the entry is damaged.
void add_image(EntryWriter& entry, const StoredImageRecord& image);
bool take_image(EntryReader& entry, StoredImageRecord& image);
void add_window(EntryWriter& entry, const WindowOutcome& window);
bool take_window(EntryReader& entry, WindowOutcome& window);

/// `number`: the number of the image, or of the first window.
void log_image(format::ContainerWriter& writer, uint64_t number, const StoredImageRecord& image);
void log_windows(format::ContainerWriter& writer, uint64_t number, const std::vector<WindowOutcome>& windows);

/// Adds an entry of the log to `resumed`. It replaces an earlier entry for the same images or windows and all after
/// them. Entries of other kinds are skipped.
void read_entry(uint32_t kind, std::span<const std::byte> entry, Resumed& resumed);

/// Removes everything from `resumed` that is not in the first `pages` pages, which are intact, of a scene of
/// `image_count` images and `window_count` windows. Sets the point from which to continue.
void drop_incomplete_tail(Resumed& resumed, uint32_t pages, size_t image_count, size_t window_count);

}  // namespace scree::convert
