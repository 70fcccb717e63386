// What a conversion notes in its .part beside the pages (format/container/part_log.h), and what another one makes of
// that after a crash: which images and windows need not be done again.
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

/// What a window added to the tables.
struct WindowOutcome {
  ContentHash made_from{};  // window_id()
  double position_error = 0;
  float uv_error = 0;
  Welded welded;
  uint64_t repaired_uvs = 0;
  uint64_t repaired_colors = 0;
  uint64_t repaired_normals = 0;
  std::vector<format::ChunkRecord> chunks;  // with page and place
  std::vector<int64_t> saved;               // EncodedChunk::saved of each
};

/// How far the .part of an earlier run goes. Everything comes in the order in which it was written.
struct Resumed {
  std::vector<StoredImageRecord> images;
  std::vector<WindowOutcome> windows;  // the last one may be in part
  size_t whole_windows = 0;            // that need not be encoded again
  size_t chunks_of_next = 0;           // chunks of the window after them that are in finished pages
  uint32_t pages = 0;                  // finished, and to be kept
};

/// Of everything that shapes the pages and is known before the geometry is measured: program, options, the files with
/// their sizes and times of change, and the images. `options`: as text.
format::PartId part_id(const std::string& options, const std::set<std::string>& files, const ImagePlan& images);

/// Of what measuring found that shapes the chunks of a window: `window`, and the record of its mesh, number `mesh`, as
/// it is before the first chunk.
ContentHash window_id(const WindowPlan& window, uint32_t mesh, const format::MeshRecord& record);

/// What is noted of an image and of a window; the take functions return whether it was there.
void add_image(EntryWriter& entry, const StoredImageRecord& image);
bool take_image(EntryReader& entry, StoredImageRecord& image);
void add_window(EntryWriter& entry, const WindowOutcome& window);
bool take_window(EntryReader& entry, WindowOutcome& window);

/// `number`: of the image, and of the first of the windows.
void log_image(format::ContainerWriter& writer, uint64_t number, const StoredImageRecord& image);
void log_windows(format::ContainerWriter& writer, uint64_t number, const std::vector<WindowOutcome>& windows);

/// Adds an entry of the log to `resumed`, in place of what an earlier one said of the same images or windows and those
/// after them; entries of other kinds are skipped.
void read_entry(uint32_t kind, std::span<const std::byte> entry, Resumed& resumed);

/// Leaves in `resumed` what lies in the first `pages` pages, which are good, of a scene of `image_count` images and
/// `window_count` windows, and says from where on it goes.
void settle(Resumed& resumed, uint32_t pages, size_t image_count, size_t window_count);

}  // namespace scree::convert
