// .scree files that a measurement makes and opens.
#pragma once

#include <cstdint>
#include <string>

#include "format/result.h"
#include "runtime/scene.h"
#include "tools/bench/scene_tables.h"
#include "tools/convert/convert.h"

namespace scree::bench {

/// How convert packs `source` as `encoding` into `path`; all else is its default.
convert::ConvertOptions packing(const std::string& source, const std::string& path, const Encoding& encoding,
                                uint32_t threads);

/// The scene that `path` shows where none is named. Errors as SceneFile::open, find_scene and Scene::load.
Result<runtime::Scene> open_default_scene(const std::string& path, const runtime::SceneOptions& options);

}  // namespace scree::bench
