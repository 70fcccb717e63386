// One scene from glTF to picture: `scree bench --end-to-end`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "format/result.h"
#include "tools/bench/disk/load_report.h"
#include "tools/bench/disk/raw_disk.h"
#include "tools/bench/setup/options.h"
#include "tools/common/backend.h"
#include "tools/convert/convert.h"

namespace scree::bench {

struct EndToEndOptions {
  BenchOptions bench;  // one of `scenes`, or one of `files`: a glTF; one encoding; at most one of `views`
  tools::BackendOptions backend;
  uint32_t threads = 1;
  uint32_t repeats = 5;  // of loads
  uint64_t memory = convert::ConvertOptions{}.memory;
  std::string work;  // an existing folder for files on the way; empty: that for temporary files
};

/// All of one scene.
struct EndToEndRow {
  std::string scene;
  double scale = 1;
  std::string encoding;
  std::string backend;  // "cpu" or "cuda"
  uint32_t threads = 0;

  uint64_t gltf_bytes = 0;
  double gltf_cached_share = 0;  // of the glTF's files when convert began, the most of them
  uint64_t unique_triangles = 0;
  uint64_t drawn_triangles = 0;
  uint64_t instances = 0;
  double convert_s = 0;
  std::string convert_work;  // what limited
  uint64_t memory = 0;       // that convert was allowed
  uint64_t peak_bytes = 0;   // that it took at once
  uint64_t scree_bytes = 0;
  double gltf_raw_gb_per_s = 0;  // of the glTF's largest file past the page cache; 0: not to be had
  RawRate raw_write;             // of a file beside it past the page cache; no bytes: not to be had
  double position_error = 0;     // largest that convert found, of a coordinate, model units
  double position_bound = 0;     // largest that a mesh states

  LoadRow load;  // from the disk, as the program loads it

  std::string view;
  ImageSize size{0, 0};
  Times resident;  // ms a frame; of a GPU culling and all stages by its clock, of a processor by the wall's
  uint32_t resident_frames = 0;

  /// Drawn from memory for a part of its geometry, a GPU's of a part of all that it takes there.
  struct Streamed {
    uint64_t budget_bytes = 0;
    double first_ms = 0;  // with nothing there yet; the file in the page cache
    Times then;           // the camera standing still
    uint32_t frames = 0;
    std::optional<uint64_t> first_bytes;  // loaded in that frame; missing where the backend does not say
    std::optional<uint64_t> then_bytes;   // in the last
    double link_gb_per_s = 0;             // from host memory to a GPU's, by copies alone; 0: there is no link
    uint64_t wrong_samples = 0;           // that differ from those of the whole scene in memory

    /// What went over the link while a frame was drawn; nothing without a link.
    std::optional<double> first_gb_per_s() const { return over_link(first_bytes, first_ms); }
    std::optional<double> then_gb_per_s() const { return over_link(then_bytes, then.median); }

   private:
    std::optional<double> over_link(const std::optional<uint64_t>& bytes, double ms) const {
      if (!bytes || link_gb_per_s <= 0) return std::nullopt;
      return static_cast<double>(*bytes) * 1e-6 / ms;
    }
  };
  std::optional<Streamed> streamed;
  std::string not_streamed;  // why there is none

  double bits_per_triangle() const {
    return 8 * static_cast<double>(scree_bytes) / static_cast<double>(unique_triangles);
  }
  /// Seconds that the disk alone needs to read the glTF once and write the .scree file once; nothing where one of its
  /// rates is not known.
  std::optional<double> disk_s() const {
    if (gltf_raw_gb_per_s <= 0 || raw_write.gb_per_s() <= 0) return std::nullopt;
    return static_cast<double>(gltf_bytes) * 1e-9 / gltf_raw_gb_per_s +
           static_cast<double>(scree_bytes) * 1e-9 / raw_write.gb_per_s();
  }
};

CsvCells end_to_end_cells(const Machine& machine, const EndToEndRow& row);

/// A line for each figure.
std::string end_to_end_table(const EndToEndRow& row);

/// Errors kUsage: what cannot be, with what can.
Result<EndToEndOptions> parse_end_to_end(const BenchWords& words);

/// The most that a scene's glTF and its .scree file take on the disk together.
uint64_t room_for(const synth::Scene& scene);

/// Writes the glTF of a scene (or takes one that is there), packs it from a cold page cache, reads and writes past the
/// page cache what the disk alone is measured by, removes the glTF, loads and draws the .scree file, resident and from
/// a quarter of that, removes it; prints the table on stdout and appends the row to the CSV file. Errors: kFile (too
/// little room in the folder: what there is, what is needed), kRange (a streamed picture
/// that is not the resident one), those of what is called.
Result<void> run_end_to_end(const EndToEndOptions& options);

}  // namespace scree::bench
