// The output of compare: tables for people, or members of a JSON object.
#pragma once

#include <string>

#include "tools/common/output/json_writer.h"
#include "tools/compare/geometry.h"
#include "tools/compare/images.h"
#include "tools/compare/pixels.h"

namespace scree::compare {

std::string text_pixels(const PixelReport& report);
std::string text_geometry(const GeometryReport& report);
/// `of_scene`: the pictures show a scene and its source, both without textures; otherwise they are any two pictures.
std::string text_pictures(const PictureReport& report, bool of_scene);

/// A member "pixels", "geometry" or "pictures" of the object that is open. Names are stable, lengths are model units,
/// angles degrees; a member without a value is absent, such as the PSNR of identical pictures.
void json_pixels(tools::JsonWriter& json, const PixelReport& report);
void json_geometry(tools::JsonWriter& json, const GeometryReport& report);
void json_pictures(tools::JsonWriter& json, const PictureReport& report, bool of_scene);

}  // namespace scree::compare
