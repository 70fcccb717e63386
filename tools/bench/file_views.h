// From where a .scree file is measured.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "tools/common/options.h"

namespace scree::bench {

struct FileView {
  std::string name;  // of the camera, or its number; "default"
  kernels::View view;
};

/// The cameras of `names`, or all that the scene has where there are none, or its default view where it has no camera;
/// each of `size`. Loads the scene's pages where the default view depends on vertices. Errors: those of make_view and
/// Scene::load_pages, `file` named.
Result<std::vector<FileView>> file_views(runtime::Scene& scene, const std::string& file,
                                         const std::vector<std::string>& names, tools::ImageSize size,
                                         uint32_t threads);

}  // namespace scree::bench
