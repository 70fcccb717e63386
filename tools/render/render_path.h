// scree render --path: the frames of a moving camera. The scene is opened once.
#pragma once

#include "format/result.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Draws the frames of options.path. The outputs of a frame are written while the next frames are drawn, and equal the
/// files that `scree render` writes for its camera. All cameras and names are checked before the first frame is drawn.
/// A file gets its name only when it is complete. Errors those of CameraPath::read, runtime::LoadedScene::load,
/// make_view and of writing; kFile: an output exists already, or a signal has requested a stop.
Result<void> render_path(const RenderOptions& options);

}  // namespace scree::tools
