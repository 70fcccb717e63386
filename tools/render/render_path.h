// scree render --path: the frames of a camera that moves, from one scene that is opened once.
#pragma once

#include "format/result.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Draws the frames of options.path and writes what is asked for of each, while the next are drawn; each frame has the
/// bytes that `scree render` writes of its camera. All cameras and names are checked before the first is drawn. A
/// file has its name only once it is whole. Errors those of CameraPath::read, runtime::LoadedScene::load, make_view and
/// of writing; kFile: an output is there already, or a signal asks to stop.
Result<void> render_path(const RenderOptions& options);

}  // namespace scree::tools
