// What textures cost a frame that stay JPEGs on the GPU.
#pragma once

#include "format/result.h"
#include "lab/options.h"
#include "lab/report/case_result.h"

namespace scree::lab {

/// Makes the scene "textured" (tools/synth/textured.h) in a folder of its own, which it removes, packs it, brings it to
/// the GPU, and prints what it takes, what its frames take (without textures, from a warm and from a cold cache, on a
/// path), and how fast the GPU decodes. Errors those of write_textured, convert, Scene::load, CudaScene::upload; kFile.
Result<void> run_textured(const LabOptions& options, const Machine& machine);

}  // namespace scree::lab
