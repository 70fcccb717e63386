#include "tools/compare/report.h"

#include <cmath>
#include <cstdio>

#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"

namespace scree::compare {
namespace {

using inspect::TextTable;
using tools::grouped;
using tools::JsonWriter;
using tools::short_number;

std::string percent(uint64_t part, uint64_t whole) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4f%%",
                whole == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole));
  return text;
}

void depth_row(TextTable& table, const char* title, const DepthError& error) {
  if (error.count() != 0)
    table.row({title, grouped(error.count()), short_number(error.max()), short_number(error.rms())});
}

void depth_member(JsonWriter& json, const char* name, const DepthError& error) {
  if (error.count() == 0) return;
  json.object(name, [&] {
    json.member("pixels", error.count());
    json.member("max", error.max());
    json.member("rms", error.rms());
  });
}

void distance_row(TextTable& table, const char* title, const Distances& distances) {
  table.row({title, grouped(distances.count()), short_number(distances.max()), short_number(distances.rms()),
             short_number(distances.relative_max()), short_number(distances.relative_rms())});
}

void distance_member(JsonWriter& json, const char* name, const Distances& distances) {
  json.object(name, [&] {
    json.member("vertices", distances.count());
    json.member("max", distances.max());
    json.member("rms", distances.rms());
    json.member("max_over_diagonal", distances.relative_max());
    json.member("rms_over_diagonal", distances.relative_rms());
  });
}

}  // namespace

std::string text_pixels(const PixelReport& report) {
  const auto counts = report.counts();
  TextTable pixels;
  pixels.row({"pixels", "count", "share"});
  pixels.rule();
  for (size_t i = 0; i < kPixelKinds; ++i) {
    const auto kind = static_cast<PixelKind>(i);
    if (!report.tells(kind)) continue;
    pixels.row({kind_title(kind), grouped(counts[i]), percent(counts[i], report.kinds.size())});
  }
  pixels.rule();
  pixels.row({"wrong", grouped(report.wrong()), percent(report.wrong(), report.kinds.size())});
  std::string text = pixels.text();
  if (report.surface_depth.count() != 0) {
    TextTable depth;
    depth.row({"relative depth error", "pixels", "max", "rms"});
    depth.rule();
    depth_row(depth, "same triangle", report.same_depth);
    depth_row(depth, "surface in both", report.surface_depth);
    text += "\n" + depth.text();
  }
  return text;
}

void json_pixels(JsonWriter& json, const PixelReport& report) {
  const auto counts = report.counts();
  json.object("pixels", [&] {
    json.member("width", report.width);
    json.member("height", report.height);
    json.member("wrong", report.wrong());
    for (size_t i = 0; i < kPixelKinds; ++i)
      if (report.tells(static_cast<PixelKind>(i))) json.member(kind_key(static_cast<PixelKind>(i)), counts[i]);
    depth_member(json, "relative_depth_error_same_triangle", report.same_depth);
    depth_member(json, "relative_depth_error_surface", report.surface_depth);
  });
  json.line();
}

std::string text_geometry(const GeometryReport& report) {
  TextTable distances;
  distances.row({"vertices", "count", "max", "rms", "max/diagonal", "rms/diagonal"});
  distances.rule();
  distance_row(distances, "stored to source", report.stored);
  distance_row(distances, "source to stored", report.source);
  std::string text = distances.text();

  TextTable rest;
  rest.row({"largest error of a coordinate", short_number(report.axis_error)});
  rest.row({"stated bound", short_number(report.axis_bound)});
  rest.row({"meshes whose bound does not hold", grouped(report.broken.size())});
  rest.row({"triangles compared", grouped(report.triangles)});
  rest.row({"triangles missing", grouped(report.missing_triangles)});
  rest.row({"triangles not in the source", grouped(report.unknown_triangles)});
  if (report.normals != 0)
    rest.row({"largest angle of vertex normals", short_number(report.normal_degrees) + " degrees"});
  if (report.faces != 0) rest.row({"largest angle of faces", short_number(report.face_degrees) + " degrees"});
  return text + "\n" + rest.text();
}

void json_geometry(JsonWriter& json, const GeometryReport& report) {
  json.object("geometry", [&] {
    json.member("meshes", report.meshes);
    json.member("triangles", report.triangles);
    json.member("missing_triangles", report.missing_triangles);
    json.member("unknown_triangles", report.unknown_triangles);
    distance_member(json, "stored_to_source", report.stored);
    distance_member(json, "source_to_stored", report.source);
    json.member("max_axis_error", report.axis_error);
    json.member("max_axis_bound", report.axis_bound);
    json.member("broken_bounds", uint64_t{report.broken.size()});
    if (report.normals != 0) json.member("max_normal_degrees", report.normal_degrees);
    if (report.faces != 0) json.member("max_face_degrees", report.face_degrees);
  });
  json.line();
}

std::string text_pictures(const PictureReport& report, bool of_scene) {
  TextTable table;
  if (of_scene) {
    table.row({"lit pictures, both without textures", ""});
    table.rule();
  }
  table.row({"pixels", grouped(report.flip.size())});
  table.row({"pixels that differ", grouped(report.differing)});
  if (report.other_alpha != 0)
    table.row({"pixels of another alpha (compared over black)", grouped(report.other_alpha)});
  table.row({"largest difference of a byte", grouped(report.max_levels)});
  table.row({"PSNR", std::isfinite(report.psnr) ? short_number(report.psnr) + " dB" : "identical"});
  table.row({"FLIP, mean", short_number(report.flip_mean)});
  table.row({"FLIP, largest", short_number(report.flip_max)});
  return table.text();
}

void json_pictures(JsonWriter& json, const PictureReport& report, bool of_scene) {
  json.object("pictures", [&] {
    json.member("width", report.width);
    json.member("height", report.height);
    if (of_scene) json.member("textures_left_out", true);
    json.member("identical", report.differing == 0 && report.other_alpha == 0);
    json.member("differing", report.differing);
    json.member("other_alpha", report.other_alpha);
    json.member("max_levels", report.max_levels);
    if (std::isfinite(report.psnr)) json.member("psnr_db", report.psnr);
    json.member("flip_mean", report.flip_mean);
    json.member("flip_max", report.flip_max);
  });
  json.line();
}

}  // namespace scree::compare
