#include <algorithm>

#include "tools/bench/end_to_end.h"
#include "tools/common/human.h"
#include "tools/inspect/text_table.h"

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

std::string describe(const EndToEndRow::Streamed& streamed) {
  std::string text = ms(streamed.first_ms) + " the first";
  if (streamed.first_bytes) text += ", " + format_bytes(*streamed.first_bytes) + " loaded";
  text += "; then " + frames(streamed.then, streamed.frames);
  if (streamed.then_bytes) text += ", " + format_bytes(*streamed.then_bytes) + " loaded";
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
                 {"bits_per_triangle", csv_number(row.bits_per_triangle())},
                 {"position_error", csv_number(row.position_error)},
                 {"position_bound", csv_number(row.position_bound)},
                 {"load_s", csv_number(row.load.resident.median * 1e-3)},
                 {"first_frame_s", csv_number(row.load.first_frame.median * 1e-3)},
                 {"load_gb_per_s", csv_number(row.load.gb_per_s())},
                 {"raw_gb_per_s", row.load.raw_gb_per_s > 0 ? csv_number(row.load.raw_gb_per_s) : ""},
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
  const auto known = [](const std::optional<uint64_t>& bytes) { return bytes ? csv_number(*bytes) : std::string(); };
  using Streamed = EndToEndRow::Streamed;
  add("budget_bytes", [](const Streamed& s) { return csv_number(s.budget_bytes); });
  add("streamed_first_ms", [](const Streamed& s) { return csv_number(s.first_ms); });
  add("streamed_first_bytes", [&](const Streamed& s) { return known(s.first_bytes); });
  add("streamed_frames", [](const Streamed& s) { return csv_number(uint64_t{s.frames}); });
  add("streamed_ms", [](const Streamed& s) { return csv_number(s.then.median); });
  add("streamed_min_ms", [](const Streamed& s) { return csv_number(s.then.minimum); });
  add("streamed_spread_ms", [](const Streamed& s) { return csv_number(s.then.spread); });
  add("streamed_bytes", [&](const Streamed& s) { return known(s.then_bytes); });
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
  table.row({"convert", short_number(row.convert_s) + " s to " + row.encoding + ": " + row.convert_rates});
  table.row({"peak memory", format_bytes(row.peak_bytes) + " of " + format_bytes(row.memory)});
  table.row({".scree", format_bytes(row.scree_bytes) + ", " + fixed(row.bits_per_triangle(), 2) + " bits a triangle"});
  table.row({"load, cold", describe(row.load)});
  table.row({"resident bytes", format_bytes(row.load.last.device_bytes)});
  table.row({"frame", row.view + ", " + std::to_string(row.size.width) + "x" + std::to_string(row.size.height) + ": " +
                          frames(row.resident, row.resident_frames)});
  table.row({"frame at 25%", row.streamed ? describe(*row.streamed) : "- (" + row.not_streamed + ")"});
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
  const Result<tools::BackendChoice> backend = tools::parse_backend(words.backend);
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
