// scree convert: the command line.
#include "tools/common/command.h"

#include <cstdio>
#include <memory>
#include <string>

#include "tools/common/options.h"
#include "tools/common/stop_signal.h"
#include "tools/convert/convert.h"

namespace scree::tools {
namespace {

struct Words {
  std::string input;
  std::string output;
  std::string positions = "16";
  std::string max_error;
  std::string grid = "mesh";
  std::string order = "fifo";
  std::string encoding = "indexed";
  std::string clusters = "fast";
  std::string chunk_triangles = std::to_string(format::kMaxChunkTriangles);
  std::string zstd = "0";
  std::string threads = "0";
  std::string exclude;
  std::string textures = "keep";
  bool keep_going = false;
  bool normals = false;
  bool source_ids = false;
  bool drop_nonfinite = false;
  bool no_weld = false;
  bool no_share = false;
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
  const Result<uint64_t> quality = parse_whole(text.substr(5), 1, 100, "--textures jpeg");
  if (!quality) return quality.error();
  options.quality = static_cast<int>(*quality);
  return options;
}

Result<convert::ConvertOptions> parse(const Words& words, bool positions_given) {
  convert::ConvertOptions options;
  options.input = words.input;
  options.output = words.output;
  options.float32 = words.positions == "float32";
  if (!options.float32) {
    const Result<uint64_t> bits = parse_whole(words.positions, 8, format::kMaxPositionBits, "--positions");
    if (!bits) return Error{bits.error().code, bits.error().message + ", nor 'float32'"};
    options.position_bits = static_cast<uint32_t>(*bits);
  }
  if (!words.max_error.empty()) {
    const Result<double> length = parse_length(words.max_error);
    if (!length) return at("--max-error", length.error());
    if (positions_given)
      return Error{ErrorCode::kUsage, "--max-error and --positions exclude each other: both pick the step"};
    options.max_error = *length;
  }
  if (words.grid != "mesh" && words.grid != "scene")
    return Error{ErrorCode::kUsage, "--grid: '" + words.grid + "' is neither 'mesh' nor 'scene'"};
  options.grid = words.grid == "scene" ? convert::Grid::kScene : convert::Grid::kMesh;
  if (words.order != "fifo" && words.order != "none")
    return Error{ErrorCode::kUsage, "--order: '" + words.order + "' is neither 'fifo' nor 'none'"};
  options.order = words.order == "none" ? convert::Order::kNone : convert::Order::kFifo;
  if (words.encoding != "indexed" && words.encoding != "clustered")
    return Error{ErrorCode::kUsage, "--encoding: '" + words.encoding + "' is neither 'indexed' nor 'clustered'"};
  options.encoding = words.encoding == "clustered" ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
  if (words.clusters != "fast" && words.clusters != "best")
    return Error{ErrorCode::kUsage, "--clusters: '" + words.clusters + "' is neither 'fast' nor 'best'"};
  options.clusters = words.clusters == "best" ? ClusterEffort::kBest : ClusterEffort::kFast;
  const Result<uint64_t> chunk = parse_whole(words.chunk_triangles, 0, format::kMaxChunkTriangles, "--chunk-triangles");
  if (!chunk) return chunk.error();
  options.chunk_triangles = *chunk;
  const Result<uint64_t> level = parse_whole(words.zstd, 0, 22, "--zstd");
  if (!level) return level.error();
  options.zstd_level = static_cast<int>(*level);
  const Result<uint64_t> threads = parse_whole(words.threads, 0, 4096, "--threads");
  if (!threads) return threads.error();
  options.threads = static_cast<uint32_t>(*threads);
  options.exclude = words.exclude;
  const Result<convert::ImageOptions> images = parse_textures(words.textures);
  if (!images) return images.error();
  options.images = *images;
  options.images.keep_going = words.keep_going;
  options.normals = words.normals;
  options.source_ids = words.source_ids;
  options.drop_nonfinite = words.drop_nonfinite;
  options.weld = !words.no_weld;
  options.share = !words.no_share;
  options.progress = !words.quiet;
  return options;
}

Result<void> run(const Words& words, bool positions_given) {
  Result<convert::ConvertOptions> options = parse(words, positions_given);
  if (!options) return options.error();
  Result<convert::ConvertReport> report = Error{ErrorCode::kFile, {}};
  {
    const StopOnSignal handlers;
    options->stop = StopOnSignal::flag();
    report = convert::convert(*options);
  }
  if (!report) {
    StopOnSignal::end_where_signalled();
    return report.error();
  }
  for (const std::string& warning : report->warnings)
    std::fprintf(stderr, "scree convert: warning: %s\n", warning.c_str());
  if (!words.quiet) std::printf("%s\n", convert::describe(*options, *report).c_str());
  if (std::fflush(stdout) != 0) return Error{ErrorCode::kFile, "standard output: cannot write"};
  return {};
}

}  // namespace

Command add_convert(CLI::App& parent) {
  const auto words = std::make_shared<Words>();
  CLI::App* app = parent.add_subcommand("convert", "Packs a glTF scene into a .scree file");
  app->add_option("input", words->input, "The scene: .gltf or .glb")->required();
  app->add_option("-o,--output", words->output, "The file to write (default: the input with the extension .scree)");
  CLI::Option* positions =
      app->add_option("--positions", words->positions,
                      "Bits an axis of a mesh's positions, 8 to 24, or float32: as they are (default: 16)");
  app->add_option("--max-error", words->max_error,
                  "Largest position error an axis in a mesh's own units (0.5mm, 1e-3; a unit is a metre); picks the "
                  "step instead of --positions");
  app->add_option("--grid", words->grid,
                  "mesh: each mesh has its own step (default); scene: meshes under one world matrix share the finest");
  app->add_option("--order", words->order,
                  "fifo: triangles in vertex-cache order, vertices by first use (default); none: as in the source");
  app->add_option("--encoding", words->encoding,
                  "indexed: chunks of vertices and indices (default); clustered: clusters of up to 128 triangles, half "
                  "the bytes; meshes of float32 positions are indexed");
  app->add_option("--clusters", words->clusters,
                  "fast: clusters of triangles as --order has them (default); best: smaller ones, in an order of their "
                  "own, many times slower");
  app->add_option("--chunk-triangles", words->chunk_triangles,
                  "Most triangles of a chunk, 1 to 65536 (default); 0: every mesh is one chunk, which takes memory for "
                  "the whole of the largest mesh");
  app->add_option("--zstd", words->zstd, "Compress pages with zstd at this level, 1 to 22; 0: not at all (default)");
  app->add_option("--textures", words->textures,
                  "keep (default): JPEGs are indexed without loss, other images stay as they are; jpeg:QUALITY (jpeg: "
                  "90): others become JPEGs, 4:4:4, without alpha; raw: all images stay as they are");
  app->add_flag("--keep-going", words->keep_going,
                "An image that is damaged or of an unsupported kind becomes grey instead of an error");
  app->add_flag("--normals", words->normals, "Store normals, 12 bits an axis of the octahedral map");
  app->add_flag("--source-ids", words->source_ids, "Store every triangle's number in the source");
  app->add_option("--exclude", words->exclude,
                  "Leave out nodes whose name has a match of this regular expression, and those below them");
  app->add_flag("--drop-nonfinite", words->drop_nonfinite,
                "Leave out triangles with a position that is NaN or infinite instead of failing");
  app->add_flag("--no-weld", words->no_weld,
                "Keep vertices apart that are equal, bit for bit, in all that is stored of them");
  app->add_flag("--no-share", words->no_share,
                "Store equal meshes, textures and materials as often as the source has them");
  app->add_option("--threads", words->threads, "Threads; 0: one per processor (default)");
  app->add_flag("-q,--quiet", words->quiet, "No progress and no closing line");
  return {app, [words, positions] { return run(*words, positions->count() > 0); }};
}

}  // namespace scree::tools
