// From where a .scree file is measured.
#pragma once

#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/scene/scene.h"
#include "tools/bench/setup/options.h"
#include "tools/bench/setup/views.h"

namespace scree::bench {

/// The cameras of `names`, or all that the scene has where there are none, or its default view where it has no camera;
/// each of `size`. Loads the scene's pages where the default view looks at vertices. Errors: those of make_view and
/// Scene::load_pages, `file` named.
Result<std::vector<NamedView>> file_views(runtime::Scene& scene, const std::string& file,
                                          const std::vector<std::string>& names, ImageSize size);

}  // namespace scree::bench
