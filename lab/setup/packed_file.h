// The .scree files that a measurement makes.
#pragma once

#include <cstdint>
#include <string>

#include "lab/scenes/scene_tables.h"
#include "tools/convert/convert.h"

namespace scree::lab {

/// Options with which convert packs `source` as `encoding` into `path`. All others are the defaults.
convert::ConvertOptions packing(const std::string& source, const std::string& path, const Encoding& encoding,
                                uint32_t threads);

}  // namespace scree::lab
