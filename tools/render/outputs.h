// The last steps of `scree render`: the files of a drawn frame, and the objects under its pixels.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "format/result.h"
#include "runtime/draw/renderer.h"
#include "runtime/files/mapped_file.h"
#include "runtime/threads/stopwatch.h"
#include "tools/render/layers.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Pictures of a frame for the files; empty if not requested.
struct FrameOutputs {
  std::optional<runtime::Picture> picture;
  FrameLayers layers;
};

/// Writes all files that `options` request. `map`: the mapped scene; if its file was cut short, nothing is written.
/// `samples`: of the frame. Returns the time of writing the picture. Errors kFile, also "interrupted" if a signal
/// requests a stop.
Result<runtime::Duration> write_outputs(const RenderOptions& options, const runtime::MappedFile& map,
                                        const FrameOutputs& outputs, std::span<const uint64_t> samples);

/// Prints a line for each of options.picks. `view`: in samples. Errors as pick_sample().
Result<void> print_picks(const RenderOptions& options, const runtime::Scene& scene, const kernels::View& view,
                         std::span<const uint64_t> samples);

/// "12 (Rock)".
std::string number_and_name(uint64_t number, std::string_view name);

}  // namespace scree::tools
