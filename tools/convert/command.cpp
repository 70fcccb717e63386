// scree convert: the command line.
#include "tools/common/options/command.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

#include "format/text.h"
#include "tools/common/options/options.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/stop_signal.h"
#include "tools/convert/convert.h"
#include "tools/gltf/document/uri.h"

namespace scree::tools {
namespace {

struct ConvertArguments {
  std::string input;
  std::string output;
  std::string positions = "16";
  std::string max_error;
  std::string max_error_pixels;
  std::string at_distance;
  std::string at_size;
  std::string at_fov;
  std::string grid = "mesh";
  std::string order = "fifo";
  std::string encoding = "clustered";
  std::string clusters = "fast";
  std::string chunk_triangles = std::to_string(format::kMaxChunkTriangles);
  std::string zstd;
  std::string threads = "0";
  std::string memory = "2GiB";
  std::string exclude;
  std::string textures = "keep";
  std::string shard;
  bool keep_going = false;
  std::string normals = "auto";
  bool source_ids = false;
  bool drop_nonfinite = false;
  bool no_weld = false;
  bool no_share = false;
  bool allow_outside = false;
  bool resume = false;
  bool force = false;
  bool stats = false;
  bool json = false;
  bool quiet = false;
};

Result<convert::ImageOptions> parse_textures(const std::string& text) {
  convert::ImageOptions options;
  if (text == "keep") return options;
  if (text == "raw") {
    options.textures = convert::Textures::kRaw;
    return options;
  }
  if (text != "jpeg" && text.rfind("jpeg:", 0) != 0) {
    return Error{ErrorCode::kUsage,
                 "--textures: '" + text + "' is neither 'keep' nor 'raw' nor 'jpeg:' and a quality of 1 to 100"};
  }
  options.textures = convert::Textures::kJpeg;
  if (text == "jpeg") return options;
  SCREE_TRY(assign(options.quality, parse_whole(text.substr(5), 1, 100, "--textures jpeg")));
  return options;
}

/// A number above 0.
Result<double> parse_positive(const std::string& text, const char* option) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || end != text.c_str() + text.size() || !(value > 0) || !std::isfinite(value))
    return Error{ErrorCode::kUsage, std::string(option) + ": '" + text + "' is not a number above 0"};
  return value;
}

Result<convert::PixelBound> parse_pixel_bound(const ConvertArguments& words) {
  if (words.max_error_pixels.empty() || words.at_distance.empty())
    return Error{ErrorCode::kUsage, "--max-error-pixels and --at-distance need each other"};
  convert::PixelBound bound;
  bound.pixels = SCREE_TRY(parse_positive(words.max_error_pixels, "--max-error-pixels"));
  bound.distance = SCREE_TRY_AT("--at-distance", parse_length(words.at_distance));
  const ImageSize size = SCREE_TRY(parse_image_size(words.at_size.empty() ? "1920x1080" : words.at_size, "--at-size"));
  bound.width = size.width;
  bound.height = size.height;
  bound.fov_degrees = SCREE_TRY(parse_positive(words.at_fov.empty() ? "45" : words.at_fov, "--at-fov"));
  if (bound.fov_degrees >= 180)
    return Error{ErrorCode::kUsage, "--at-fov: '" + words.at_fov + "' is not below 180 degrees"};
  return bound;
}

/// Parses "3/8": share 3 of 8, counted from 1.
Result<void> parse_shard(const std::string& text, convert::ConvertOptions& options) {
  const size_t slash = text.find('/');
  const auto whole = [&](const std::string& part) { return parse_whole(part, 1, 4096, "--shard"); };
  const Result<uint64_t> shard = whole(text.substr(0, slash));
  const Result<uint64_t> shards = whole(slash == std::string::npos ? "" : text.substr(slash + 1));
  if (!shard || !shards || *shard > *shards)
    return Error{ErrorCode::kUsage, "--shard: '" + text + "' is not I/N, share I of N (1 <= I <= N <= 4096)"};
  options.shard = static_cast<uint32_t>(*shard - 1);
  options.shards = static_cast<uint32_t>(*shards);
  return {};
}

Result<void> parse_choices(const ConvertArguments& words, convert::ConvertOptions& options) {
  using namespace convert;
  SCREE_TRY(parse_choice(words.grid, "--grid", options.grid, {{"mesh", Grid::kMesh}, {"scene", Grid::kScene}}));
  SCREE_TRY(parse_choice(words.order, "--order", options.order, {{"fifo", Order::kFifo}, {"none", Order::kNone}}));
  SCREE_TRY(parse_choice(words.encoding, "--encoding", options.encoding,
                         {{"clustered", Encoding::kClustered}, {"indexed", Encoding::kIndexed}}));
  SCREE_TRY(parse_choice(words.clusters, "--clusters", options.clusters,
                         {{"fast", ClusterEffort::kFast}, {"best", ClusterEffort::kBest}}));
  return parse_choice(words.normals, "--normals", options.normals,
                      {{"auto", Normals::kAuto}, {"always", Normals::kAlways}, {"never", Normals::kNever}});
}

Result<convert::ConvertOptions> parse(const ConvertArguments& words, bool positions_given) {
  convert::ConvertOptions options;
  if (words.input == "-")
    return Error{ErrorCode::kUsage, "the input '-': scree reads files, not standard input (./- is a file called -)"};
  options.input = words.input;
  options.output = words.output;
  if (!is_same_file(words.output, words.input)) SCREE_TRY(check_no_gltf(words.output, "convert"));
  options.existing = existing_of(words.force);
  options.float32 = words.positions == "float32";
  if (!options.float32) {
    const Result<uint64_t> bits = parse_whole(words.positions, 8, format::kMaxPositionBits, "--positions");
    if (!bits) return Error{bits.error().code, bits.error().message + ", nor 'float32'"};
    options.position_bits = static_cast<uint32_t>(*bits);
  }
  if (!words.max_error.empty()) {
    const double length = SCREE_TRY_AT("--max-error", parse_length(words.max_error));
    if (positions_given)
      return Error{ErrorCode::kUsage, "--max-error and --positions exclude each other: both pick the step"};
    options.max_error = length;
  }
  if (words.max_error_pixels.empty() && (!words.at_size.empty() || !words.at_fov.empty()))
    return Error{ErrorCode::kUsage, "--at-size and --at-fov need --max-error-pixels"};
  if (!words.max_error_pixels.empty() || !words.at_distance.empty()) {
    if (positions_given || !words.max_error.empty())
      return Error{ErrorCode::kUsage, "--max-error-pixels, --max-error and --positions exclude each other"};
    options.pixel_bound = SCREE_TRY(parse_pixel_bound(words));
  }
  SCREE_TRY(parse_choices(words, options));
  options.chunk_triangles =
      SCREE_TRY(parse_whole(words.chunk_triangles, 0, format::kMaxChunkTriangles, "--chunk-triangles"));
  SCREE_TRY(assign(options.threads, parse_whole(words.threads, 0, kMostThreads, "--threads")));
  options.images = SCREE_TRY(parse_textures(words.textures));
  options.memory = SCREE_TRY_AT("--memory", parse_size(words.memory));
  options.exclude = words.exclude;
  if (!words.zstd.empty()) {
    const uint64_t level = SCREE_TRY(parse_whole(words.zstd, 0, 22, "--zstd"));
    options.zstd_level = options.images.block_zstd_level = static_cast<int>(level);
  }
  options.images.keep_going = words.keep_going;
  options.source_ids = words.source_ids;
  options.drop_nonfinite = words.drop_nonfinite;
  options.weld = !words.no_weld;
  options.share = !words.no_share;
  options.allow_outside = words.allow_outside;
  options.resume = words.resume;
  options.progress = !words.quiet;
  if (!words.shard.empty()) SCREE_TRY(parse_shard(words.shard, options));
  return options;
}

Result<void> run(const ConvertArguments& words, bool positions_given) {
  convert::ConvertOptions options = SCREE_TRY(parse(words, positions_given));
  Result<convert::ConvertReport> report = Error{ErrorCode::kFile, {}};
  {
    const StopOnSignal handlers;
    options.stop = StopOnSignal::flag();
    options.on_part = [] { StopOnSignal::advise("continue with --resume"); };
    report = convert::convert(options);
  }
  if (!report) return report.error();
  note_written(report->output);
  for (const std::string& warning : report->warnings)
    std::fprintf(stderr, "scree convert: warning: %s\n", warning.c_str());
  if (words.json) {
    std::fputs(convert::json_report(options, *report).c_str(), stdout);
  } else if (options.shards > 0) {
    if (!words.quiet)
      std::printf("%s: shard %u of %u -> %s: %llu %s, %s; %.2f s, peak memory %s (scree merge joins all shards)\n",
                  options.input.c_str(), options.shard + 1, options.shards, report->output.c_str(),
                  static_cast<unsigned long long>(report->windows), report->windows == 1 ? "window" : "windows",
                  format_bytes(report->output_bytes).c_str(), report->seconds,
                  format_bytes(report->peak_bytes).c_str());
  } else if (!words.quiet) {
    if (!report->positions.rows().empty()) std::printf("%s", report->positions.text().c_str());
    std::fputs(convert::describe(options, *report, words.stats).c_str(), stdout);
  }
  return finish_output();
}

}  // namespace

Command add_convert(CLI::App& parent) {
  const auto words = std::make_shared<ConvertArguments>();
  CLI::App* app = parent.add_subcommand("convert", "Packs a glTF scene into a .scree file");
  app->add_option("input", words->input, "The scene: .gltf or .glb")->required();
  add_value(*app, "-o,--output", "FILE", words->output,
            "The file to write (default: the input with the extension .scree)");
  CLI::Option* positions = add_value(*app, "--positions", "BITS", words->positions,
                                     "Bits per axis of positions, 8 to 24, or float32 (unchanged) (default: 16)");
  add_value(*app, "--max-error", "LENGTH", words->max_error,
            "Largest position error per axis, in model units (0.5mm, 1e-3; a unit is a metre). Chooses the step "
            "instead of --positions. Meshes for which 24 bits are not enough keep their floats");
  add_value(*app, "--max-error-pixels", "N", words->max_error_pixels,
            "Choose for each mesh the fewest bits that move no vertex by more than N pixels if it is --at-distance or "
            "farther from the eye's plane (formula: docs/format.md)");
  add_value(*app, "--at-distance", "D", words->at_distance,
            "Distance for --max-error-pixels in world units (2m, 1e3; a unit is a metre)");
  add_value(*app, "--at-size", "WxH", words->at_size,
            "Size of the picture for --max-error-pixels (default: 1920x1080)");
  add_value(*app, "--at-fov", "DEGREES", words->at_fov,
            "Vertical field of view of that picture in degrees (default: 45)");
  add_value(
      *app, "--grid", "NAME", words->grid,
      "mesh (default): each mesh has its own step; scene: meshes with the same world matrix share the finest step");
  add_value(*app, "--order", "NAME", words->order,
            "fifo (default): triangles in vertex-cache order, vertices by first use; none: as in the source");
  add_value(*app, "--encoding", "NAME", words->encoding,
            "clustered (default): clusters of up to 128 triangles, which take half the bytes and are drawn far faster "
            "on a GPU; indexed: vertices and indices. Meshes with float32 positions are always indexed. With an error "
            "bound, so are chunks whose clusters would take more bytes than float32 positions");
  add_value(*app, "--clusters", "NAME", words->clusters,
            "fast (default): clusters in the order of --order; best: smaller files, many times slower");
  add_value(*app, "--chunk-triangles", "N", words->chunk_triangles,
            "Largest number of triangles per chunk, 1 to 65536 (default: 65536); 0: one chunk per mesh, which "
            "needs memory for the whole largest mesh");
  add_value(*app, "--zstd", "N", words->zstd,
            "Compress pages with zstd at this level, 1 to 22; 0: no compression (default: only blocks of textures, at "
            "level 1)");
  add_value(*app, "--textures", "NAME", words->textures,
            "keep (default): JPEGs are indexed without loss, KTX2 and DDS keep their blocks and levels (UASTC and "
            "BasisLZ become RGBA8), PNGs stay unchanged, WebPs become PNGs; jpeg:QUALITY (jpeg: quality 90): other "
            "images become JPEGs too, 4:4:4, without alpha; raw: like keep, but JPEGs stay unchanged too");
  app->add_flag("--keep-going", words->keep_going,
                "Replace an image that is damaged or of an unsupported kind by grey instead of failing");
  add_value(*app, "--normals", "WHICH", words->normals,
            "Whether meshes keep their normals, with 12 bits per axis of the octahedral map: auto (default): if they "
            "differ from the normals of the mesh's faces; always (also --normals alone); never");
  app->add_flag("--source-ids", words->source_ids, "Store every triangle's number in the source");
  add_value(*app, "--exclude", "REGEX", words->exclude,
            "Leave out nodes whose name matches this regular expression, and their children");
  app->add_flag("--allow-outside", words->allow_outside, convert::kAllowOutsideHelp);
  app->add_flag("--drop-nonfinite", words->drop_nonfinite,
                "Leave out triangles with a position that is NaN or infinite instead of failing");
  app->add_flag("--no-weld", words->no_weld, "Do not merge vertices whose stored data are equal bit for bit");
  app->add_flag("--no-share", words->no_share,
                "Store equal meshes, textures and materials as often as the source has them");
  add_value(*app, "--threads", "N", words->threads, "Threads; 0: one per processor (default)");
  add_value(*app, "--memory", "SIZE", words->memory,
            "Limit of memory (default: 2GiB); a lower limit allows fewer threads, but the output stays the same");
  add_value(*app, "--shard", "I/N", words->shard,
            "Convert only shard I of N (counted from 1) to a file of its own (default: the input with the extension "
            ".I.part); scree merge joins the shards to the file of a single run (docs/scale.md)");
  app->add_flag("--resume", words->resume,
                "Continue a killed run from OUTPUT.part, with the same input and options, to the same bytes; keep "
                "OUTPUT.part if this run stops or fails");
  app->add_flag("-f,--force", words->force, kForceHelp);
  app->add_flag("--stats", words->stats, "Print the rate of every stage, and name the slowest stage");
  app->add_flag("--json", words->json, "Print one JSON object instead of the closing lines");
  app->add_flag("-q,--quiet", words->quiet, "No progress and no closing lines");
  return {app, [words, positions] { return run(*words, positions->count() > 0); }};
}

}  // namespace scree::tools
