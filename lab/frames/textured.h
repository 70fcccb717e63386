// Measures the time that textures take if they stay JPEGs on the GPU.
#pragma once

#include "format/result.h"
#include "lab/options.h"
#include "lab/report/case_result.h"

namespace scree::lab {

/// Makes the scene "textured" (tools/synth/textured.h) in a temporary folder, packs it, uploads it to the GPU, and
/// removes the folder. Prints the sizes, the frame times (without textures, from a warm and from a cold cache, on a
/// path), and the GPU's decoding speed. Errors of write_textured, convert, Scene::load, CudaScene::upload; kFile.
Result<void> run_textured(const LabOptions& options, const Machine& machine);

}  // namespace scree::lab
