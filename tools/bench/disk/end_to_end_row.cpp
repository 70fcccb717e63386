#include <optional>
#include <string>

#include "tools/bench/disk/end_to_end.h"
#include "tools/common/human.h"
#include "tools/common/text_table.h"

namespace scree::bench {
namespace {

using tools::fixed;
using tools::format_bytes;
using tools::format_count;
using tools::short_number;

Error usage(std::string message) {
  return {ErrorCode::kUsage, std::move(message)};
}

std::string ms(double value) {
  return short_number(value) + " ms";
}

std::string frames(const Times& times, uint32_t count) {
  return ms(times.median) + ", the median of " + std::to_string(count) + " (least " + short_number(times.minimum) + ")";
}

/// Such as ", 3.01 GiB loaded at 47.10 GB/s, 0.86 of the link, 17.44 of the raw disk".
std::string loaded(const std::optional<uint64_t>& bytes, const std::optional<double>& gb_per_s, double link_gb_per_s,
                   double raw_gb_per_s) {
  if (!bytes) return "";
  std::string text = ", " + format_bytes(*bytes) + " loaded";
  if (!gb_per_s) return text;
  text += " at " + fixed(*gb_per_s, 2) + " GB/s, " + fixed(*gb_per_s / link_gb_per_s, 2) + " of the link";
  if (raw_gb_per_s > 0) text += ", " + fixed(*gb_per_s / raw_gb_per_s, 2) + " of the raw disk";
  return text;
}

std::string describe(const EndToEndRow::Streamed& streamed, double raw_gb_per_s) {
  const double link = streamed.link_gb_per_s;
  std::string text = ms(streamed.first_ms) + " the first";
  text += loaded(streamed.first_bytes, streamed.first_gb_per_s(), link, raw_gb_per_s);
  text += "; then " + frames(streamed.then, streamed.frames);
  text += loaded(streamed.then_bytes, streamed.then_gb_per_s(), link, raw_gb_per_s);
  if (link > 0) text += "; the link gives " + fixed(link, 2) + " GB/s";
  text += "; from " + format_bytes(streamed.budget_bytes);
  return text + (streamed.wrong_samples == 0
                     ? ", the same picture"
                     : ", " + std::to_string(streamed.wrong_samples) + " samples differ from the resident picture");
}

std::string describe(const LoadRow& load) {
  std::string text = short_number(load.resident.median * 1e-3) + " s to all resident, " +
                     short_number(load.first_frame.median * 1e-3) + " s to the first picture, " +
                     fixed(load.gb_per_s(), 2) + " GB/s";
  if (load.raw_gb_per_s > 0)
    text += ", " + fixed(load.gb_per_s() / load.raw_gb_per_s, 2) + " of the raw disk's " + fixed(load.raw_gb_per_s, 2);
  if (load.cached_share > 0) text += "; " + fixed(100 * load.cached_share, 0) + "% of it was in the page cache";
  return text;
}

/// What the disk alone needs for convert, and convert beside it.
std::string describe_disk(const EndToEndRow& row) {
  const std::optional<double> seconds = row.disk_s();
  if (!seconds) return "- (no raw reads or writes)";
  return short_number(*seconds) + " s to read the glTF once at " + fixed(row.gltf_raw_gb_per_s, 2) +
         " GB/s and write the .scree once at " + fixed(row.raw_write.gb_per_s(), 2) + "; convert took " +
         fixed(row.convert_s / *seconds, 2) + " times that";
}

/// A cell for what may be missing.
std::string known(const std::optional<uint64_t>& value) {
  return value ? csv_number(*value) : std::string();
}
std::string known(const std::optional<double>& value) {
  return value ? csv_number(*value) : std::string();
}
std::string positive(double value) {
  return value > 0 ? csv_number(value) : std::string();
}

/// A rate's share of `whole`, where both are known.
std::string share(const std::optional<double>& rate, double whole) {
  return rate && whole > 0 ? csv_number(*rate / whole) : std::string();
}

}  // namespace

CsvCells end_to_end_cells(const Machine& machine, const EndToEndRow& row) {
  CsvCells cells{{"commit", machine.commit},
                 {"device", machine.gpu},
                 {"driver", machine.driver},
                 {"backend", row.backend},
                 {"threads", csv_number(uint64_t{row.threads})},
                 {"scene", row.scene},
                 {"scale", csv_number(row.scale)},
                 {"encoding", row.encoding},
                 {"gltf_bytes", csv_number(row.gltf_bytes)},
                 {"gltf_cached_share", csv_number(row.gltf_cached_share)},
                 {"unique_triangles", csv_number(row.unique_triangles)},
                 {"drawn_triangles", csv_number(row.drawn_triangles)},
                 {"instances", csv_number(row.instances)},
                 {"convert_s", csv_number(row.convert_s)},
                 {"memory", csv_number(row.memory)},
                 {"peak_bytes", csv_number(row.peak_bytes)},
                 {"scree_bytes", csv_number(row.scree_bytes)},
                 {"gltf_raw_gb_per_s", positive(row.gltf_raw_gb_per_s)},
                 {"raw_write_gb_per_s", positive(row.raw_write.gb_per_s())},
                 {"raw_write_bytes", row.raw_write.bytes > 0 ? csv_number(row.raw_write.bytes) : ""},
                 {"disk_s", known(row.disk_s())},
                 {"convert_s_over_disk_s", share(row.convert_s, row.disk_s().value_or(0))},
                 {"bits_per_triangle", csv_number(row.bits_per_triangle())},
                 {"position_error", csv_number(row.position_error)},
                 {"position_bound", csv_number(row.position_bound)},
                 {"load_s", csv_number(row.load.resident.median * 1e-3)},
                 {"first_frame_s", csv_number(row.load.first_frame.median * 1e-3)},
                 {"load_gb_per_s", csv_number(row.load.gb_per_s())},
                 {"raw_gb_per_s", positive(row.load.raw_gb_per_s)},
                 {"cached_share", csv_number(row.load.cached_share)},
                 {"device_bytes", csv_number(row.load.last.device_bytes)},
                 {"view", row.view},
                 {"width", csv_number(uint64_t{row.size.width})},
                 {"height", csv_number(uint64_t{row.size.height})},
                 {"frames", csv_number(uint64_t{row.resident_frames})},
                 {"frame_ms", csv_number(row.resident.median)},
                 {"frame_min_ms", csv_number(row.resident.minimum)},
                 {"frame_spread_ms", csv_number(row.resident.spread)}};
  const auto add = [&](const char* name, auto value) {
    cells.emplace_back(name, row.streamed ? value(*row.streamed) : std::string());
  };
  const double disk = row.load.raw_gb_per_s;
  using Streamed = EndToEndRow::Streamed;
  add("budget_bytes", [](const Streamed& s) { return csv_number(s.budget_bytes); });
  add("streamed_first_ms", [](const Streamed& s) { return csv_number(s.first_ms); });
  add("streamed_first_bytes", [](const Streamed& s) { return known(s.first_bytes); });
  add("streamed_first_gb_per_s", [](const Streamed& s) { return known(s.first_gb_per_s()); });
  add("streamed_first_link_share", [](const Streamed& s) { return share(s.first_gb_per_s(), s.link_gb_per_s); });
  add("streamed_first_disk_share", [&](const Streamed& s) { return share(s.first_gb_per_s(), disk); });
  add("streamed_frames", [](const Streamed& s) { return csv_number(uint64_t{s.frames}); });
  add("streamed_ms", [](const Streamed& s) { return csv_number(s.then.median); });
  add("streamed_min_ms", [](const Streamed& s) { return csv_number(s.then.minimum); });
  add("streamed_spread_ms", [](const Streamed& s) { return csv_number(s.then.spread); });
  add("streamed_bytes", [](const Streamed& s) { return known(s.then_bytes); });
  add("streamed_gb_per_s", [](const Streamed& s) { return known(s.then_gb_per_s()); });
  add("streamed_link_share", [](const Streamed& s) { return share(s.then_gb_per_s(), s.link_gb_per_s); });
  add("streamed_disk_share", [&](const Streamed& s) { return share(s.then_gb_per_s(), disk); });
  add("link_gb_per_s", [](const Streamed& s) { return positive(s.link_gb_per_s); });
  add("wrong_samples", [](const Streamed& s) { return csv_number(s.wrong_samples); });
  return cells;
}

std::string end_to_end_table(const EndToEndRow& row) {
  inspect::TextTable table(2);
  const auto triangles = [](uint64_t count) { return format_count(static_cast<double>(count)); };
  const std::string scale = row.scale == 1 ? "" : " x" + short_number(row.scale);
  table.row({"scene", inspect::printable(row.scene) + scale + ": " + triangles(row.unique_triangles) +
                          " triangles, drawn " + triangles(row.drawn_triangles) + " in " +
                          tools::grouped(row.instances) + " instances"});
  table.row({"glTF", format_bytes(row.gltf_bytes) +
                         (row.gltf_cached_share > 0
                              ? ", up to " + fixed(100 * row.gltf_cached_share, 0) + "% of a file in the page cache"
                              : "")});
  table.row({"convert", short_number(row.convert_s) + " s to " + row.encoding + ": " + row.convert_work});
  table.row({"disk alone", describe_disk(row)});
  table.row({"peak memory", format_bytes(row.peak_bytes) + " of " + format_bytes(row.memory)});
  table.row({".scree", format_bytes(row.scree_bytes) + ", " + fixed(row.bits_per_triangle(), 2) + " bits a triangle"});
  table.row({"load, cold", describe(row.load)});
  table.row({"resident bytes", format_bytes(row.load.last.device_bytes)});
  table.row({"frame", row.view + ", " + std::to_string(row.size.width) + "x" + std::to_string(row.size.height) + ": " +
                          frames(row.resident, row.resident_frames)});
  table.row(
      {"frame at 25%", row.streamed ? describe(*row.streamed, row.load.raw_gb_per_s) : "- (" + row.not_streamed + ")"});
  table.row({"position error",
             short_number(row.position_error) + " units at most, stated " + short_number(row.position_bound)});
  return table.text();
}

Result<EndToEndOptions> parse_end_to_end(const BenchWords& words) {
  if (words.files.size() + (words.scenes.empty() ? 0 : 1) != 1 || words.scenes.find(',') != std::string::npos ||
      words.scenes == "textured")
    return usage("--end-to-end takes one --scene (A, B, C, D, lantern or A60) or one glTF");
  if (words.repeats == 0) return usage("--repeats is at least 1");
  BenchWords named = words;
  if (named.positions == BenchWords{}.positions) named.positions = "16";
  if (named.indices == BenchWords{}.indices) named.indices = "packed";
  named.reference = true;  // the same sources, packed by convert
  Result<BenchOptions> bench = parse_options(named);
  if (!bench) return bench.error();
  if (bench->encodings.size() != 1) return usage("--end-to-end takes one of --positions and one of --indices");
  if (bench->views.size() > 1) return usage("--end-to-end draws one --view");
  EndToEndOptions options;
  options.bench = std::move(*bench);
  options.repeats = words.repeats;
  options.work = words.work;
  const Result<tools::BackendOptions> backend = tools::parse_backend(words.backend, words.device);
  if (!backend) return backend.error();
  options.backend = *backend;
  const Result<uint32_t> threads = tools::parse_threads(words.threads);
  if (!threads) return threads.error();
  options.threads = *threads;
  if (words.memory.empty()) return options;
  const Result<uint64_t> memory = tools::parse_size(words.memory);
  if (!memory) return at("--memory", memory.error());
  options.memory = *memory;
  return options;
}

}  // namespace scree::bench
