// The views in which a .scree file is measured.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "tools/common/options/options.h"

namespace scree::bench {

struct FileView {
  std::string name;  // the camera's name or number, with its node if names are equal; or "default"
  kernels::View view;
};

/// The cameras of `names`. If `names` is empty: all cameras of the scene, or its default view if it has none. Each view
/// is of `size`. Loads the scene's pages if the default view depends on vertices. Errors of make_view and
/// Scene::load_pages, with `file`.
Result<std::vector<FileView>> file_views(runtime::Scene& scene, const std::string& file,
                                         const std::vector<std::string>& names, tools::ImageSize size,
                                         uint32_t threads);

}  // namespace scree::bench
