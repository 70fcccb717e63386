// scree_convert().
#include "tools/convert/convert.h"

#include <atomic>
#include <string>

#include "library/status.h"
#include "library/structs.h"

namespace scree::library {
namespace {

constexpr uint32_t kAllFlags = 4095;

scree_status translate(const scree_convert_options& in, convert::ConvertOptions& out) {
  const auto has = [&](uint32_t flag) { return (in.flags & flag) != 0; };
  if ((in.flags & ~kAllFlags) != 0)
    return fail(SCREE_ERROR_ARGUMENT, "scree_convert_options::flags has unknown flags: " + std::to_string(in.flags));
  SCREE_CHECK(check_value(in.textures, SCREE_TEXTURES_JPEG, "scree_convert_options::textures"));
  if (in.zstd_level < -1 || in.zstd_level > 22)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_convert_options::zstd_level is " + std::to_string(in.zstd_level) + ", expected -1 to 22");
  if (in.jpeg_quality < 0 || in.jpeg_quality > 100)
    return fail(SCREE_ERROR_ARGUMENT, "scree_convert_options::jpeg_quality is " + std::to_string(in.jpeg_quality) +
                                          ", expected 1 to 100, or 0 for 90");
  out.existing = has(SCREE_CONVERT_REPLACE) ? format::Existing::kReplace : format::Existing::kRefuse;
  out.float32 = has(SCREE_CONVERT_FLOAT32);
  if (in.position_bits != 0) out.position_bits = in.position_bits;
  out.max_error = in.max_error;
  out.grid = has(SCREE_CONVERT_GRID_SCENE) ? convert::Grid::kScene : convert::Grid::kMesh;
  out.encoding = has(SCREE_CONVERT_INDEXED) ? convert::Encoding::kIndexed : convert::Encoding::kClustered;
  out.clusters = has(SCREE_CONVERT_BEST) ? tools::ClusterEffort::kBest : tools::ClusterEffort::kFast;
  if (in.zstd_level != 0) out.zstd_level = out.images.block_zstd_level = in.zstd_level == -1 ? 0 : in.zstd_level;
  out.normals = has(SCREE_CONVERT_NORMALS) ? convert::Normals::kAlways : convert::Normals::kAuto;
  out.source_ids = has(SCREE_CONVERT_SOURCE_IDS);
  out.drop_nonfinite = has(SCREE_CONVERT_DROP_NONFINITE);
  out.weld = !has(SCREE_CONVERT_NO_WELD);
  out.share = !has(SCREE_CONVERT_NO_SHARE);
  out.allow_outside = has(SCREE_CONVERT_ALLOW_OUTSIDE);
  if (in.exclude != nullptr) out.exclude = in.exclude;
  out.images.textures = in.textures == SCREE_TEXTURES_JPEG  ? convert::Textures::kJpeg
                        : in.textures == SCREE_TEXTURES_RAW ? convert::Textures::kRaw
                                                            : convert::Textures::kKeep;
  if (in.jpeg_quality != 0) out.images.quality = in.jpeg_quality;
  out.images.keep_going = has(SCREE_CONVERT_KEEP_GOING);
  out.threads = in.threads;
  if (in.memory != 0) out.memory = in.memory;
  return SCREE_OK;
}

}  // namespace
}  // namespace scree::library

using namespace scree::library;
namespace convert = scree::convert;

extern "C" scree_status scree_convert(const char* input, const char* output, const scree_convert_options* options,
                                      scree_convert_report* report) {
  return guarded([&] {
    SCREE_CHECK(check_path(input, "scree_convert: input"));
    scree_convert_options taken;
    SCREE_CHECK(take(options, taken, "scree_convert_options"));
    if (report != nullptr) SCREE_CHECK(check_output(report, "scree_convert_report"));
    convert::ConvertOptions convert_options;
    SCREE_CHECK(translate(taken, convert_options));
    convert_options.input = input;
    if (output != nullptr) {
      SCREE_CHECK(check_path(output, "scree_convert: output"));
      convert_options.output = output;
    }
    std::atomic<bool> stop{false};
    convert_options.stop = &stop;
    if (taken.progress != nullptr)
      convert_options.on_progress = [&](const std::string& stage, uint64_t done, uint64_t total) {
        if (!stop && taken.progress(taken.user, stage.c_str(), done, total) != 0) stop = true;
      };
    const scree::Result<convert::ConvertReport> done = convert::convert(convert_options);
    if (!done && stop) return fail(SCREE_ERROR_CANCELLED, done.error().message);
    if (!done) return fail(done.error(), Subject::kData);
    if (taken.warning != nullptr)
      for (const std::string& line : done->warnings) taken.warning(taken.user, line.c_str());
    if (report != nullptr) {
      scree_convert_report out{};
      out.input_bytes = done->input_bytes;
      out.output_bytes = done->output_bytes;
      out.triangles = done->triangles;
      out.meshes = done->meshes;
      out.position_error = done->position_error;
      out.seconds = done->seconds;
      out.warnings = done->warnings.size();
      give(report, out);
    }
    return SCREE_OK;
  });
}
