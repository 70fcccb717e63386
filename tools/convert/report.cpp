#include "tools/convert/report.h"

#include <algorithm>
#include <cstdio>

#include "tools/common/options/options.h"
#include "tools/common/output/json_writer.h"

namespace scree::convert {
namespace {

uint64_t left_out_bytes(const ConvertReport& report) {
  uint64_t bytes = 0;
  for (const LeftOut& entry : report.left_out) bytes += entry.source_bytes;
  return bytes;
}

/// "unused images (3, 1.10 MiB), NORMAL (170 KiB; --normals never)".
std::string list_left_out(const ConvertReport& report) {
  std::string text;
  for (const LeftOut& entry : report.left_out) {
    const bool is_attribute =
        entry.what.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789") == std::string::npos;
    std::string more = is_attribute ? "" : std::to_string(entry.count);
    if (entry.source_bytes > 0) more += (more.empty() ? "" : ", ") + tools::format_bytes(entry.source_bytes);
    if (entry.what == "NORMAL") more += "; --normals never";
    text += (text.empty() ? "" : ", ") + entry.what + (more.empty() ? "" : " (" + more + ")");
  }
  return text;
}

/// "read 2.30 GiB/s, measure 493 M triangles/s, ...: encoding limits, 15 of 16 threads (--memory), ...".
std::string describe_work(const ConvertReport& report) {
  std::string text = describe(report.rates);
  if (report.threads < report.threads_asked)
    text +=
        ", " + std::to_string(report.threads) + " of " + std::to_string(report.threads_asked) + " threads (--memory)";
  if (report.windows_ahead > 0)
    text += ", " + std::to_string(report.windows_ahead) + " of " + std::to_string(report.windows) +
            " windows encoded before all were measured";
  return text;
}

}  // namespace

void add_results(const format::TableSet& tables, const format::ContainerWriter& writer, ConvertReport& report) {
  report.meshes = tables.meshes.size();
  report.chunks = tables.chunks.size();
  for (const format::MeshRecord& mesh : tables.meshes) {
    report.triangles += mesh.triangle_count;
    report.position_error_bound = std::max(report.position_error_bound, mesh.max_position_error);
  }
  for (const format::SceneRecord& scene : tables.scenes) report.triangles_drawn += scene.triangle_count;
  report.geometry_bytes = writer.page_bytes(format::PageKind::kGeometry);
  report.mask_bytes = writer.page_bytes(format::PageKind::kMask);
  report.image_bytes = writer.page_bytes(format::PageKind::kImage) + report.mask_bytes;
  for (const format::MaterialRecord& material : tables.materials) {
    report.blended += (material.flags & format::kMaterialAlphaBlend) != 0 ? 1 : 0;
    report.opaque_masks += (material.flags & format::kMaterialCutOut) == format::kMaterialAlphaMask ? 1 : 0;
  }
  for (const format::MaskRecord& mask : tables.masks)
    report.masks += (tables.materials[mask.material].flags & format::kMaterialAlphaBlend) == 0 ? 1 : 0;
  report.opaque_masks -= report.masks;
}

std::string describe(const ConvertOptions& options, const ConvertReport& report, bool stats) {
  const uint64_t left_out = left_out_bytes(report);
  const double kept = static_cast<double>(report.input_bytes - std::min(left_out, report.input_bytes));
  const double out = static_cast<double>(report.output_bytes);
  const double triangles = static_cast<double>(report.triangles);
  std::string text = options.input + " -> " + report.output + ": " + tools::format_bytes(report.input_bytes) + " -> " +
                     tools::format_bytes(report.output_bytes);
  if (report.image_bytes > 0) {
    text += " (textures " + tools::format_bytes(report.image_bytes);
    if (report.mask_bytes > 0) text += ", alpha masks " + tools::format_bytes(report.mask_bytes) + " of that";
    text += ")";
  }
  char numbers[256];
  std::snprintf(numbers, sizeof numbers, ", ratio %.2f%s\n", out > 0 ? kept / out : 0.0,
                left_out > 0 ? " over the kept part" : "");
  text += numbers;
  std::snprintf(numbers, sizeof numbers,
                "%s triangles, %.2f bits/triangle without textures, position error up to %.3g (%.2g of the diagonal); "
                "%.2f s, peak memory %s",
                tools::format_count(triangles).c_str(),
                triangles > 0 ? 8 * (out - static_cast<double>(report.image_bytes)) / triangles : 0.0,
                report.position_error, report.relative_position_error, report.seconds,
                tools::format_bytes(report.peak_bytes).c_str());
  text += numbers;
  if (report.resumed_pages > 0) text += "; resumed after " + std::to_string(report.resumed_pages) + " pages";
  text += "\n";
  if (report.masks + report.opaque_masks > 0)
    text += "alpha masks: " + std::to_string(report.masks) + " drawn, " + std::to_string(report.opaque_masks) +
            " that hide nothing\n";
  if (report.blended > 0) text += "blended materials: " + std::to_string(report.blended) + "\n";
  if (!report.left_out.empty()) text += "left out: " + list_left_out(report) + "\n";
  if (!stats) return text;
  text += describe_work(report);
  if (report.sorted_triangles > 0)
    text += ", sorted " + tools::format_count(static_cast<double>(report.sorted_triangles)) +
            " triangles without locality (a temporary file of " + tools::format_bytes(report.sort_file_bytes) + ")";
  return text + "\n";
}

std::string json_report(const ConvertOptions& options, const ConvertReport& report) {
  const auto members = [&](tools::JsonWriter& json) {
    json.member("input", options.input);
    json.member("output", report.output);
    json.member("input_bytes", report.input_bytes);
    json.member("output_bytes", report.output_bytes);
    json.member("geometry_bytes", report.geometry_bytes);
    json.member("image_bytes", report.image_bytes);
    json.member("masks", report.masks);
    json.member("mask_bytes", report.mask_bytes);
    json.member("opaque_masks", report.opaque_masks);
    json.member("blended_materials", report.blended);
    json.member("meshes", report.meshes);
    json.member("chunks", report.chunks);
    json.member("triangles", report.triangles);
    json.member("drawn_triangles", report.triangles_drawn);
    json.member("position_error", report.position_error);
    json.member("position_error_bound", report.position_error_bound);
    json.member("relative_position_error", report.relative_position_error);
    json.member("seconds", report.seconds);
    json.member("peak_bytes", report.peak_bytes);
    json.member("threads", report.threads);
    json.member("work", describe_work(report));
    json.objects("left_out", report.left_out, [&](const LeftOut& entry) {
      json.member("what", entry.what);
      json.member("count", entry.count);
      json.member("source_bytes", entry.source_bytes);
    });
    json.array("warnings", report.warnings);
  };
  return tools::json_object(members) + "\n";
}

}  // namespace scree::convert
