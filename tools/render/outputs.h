// The last steps of `scree render`: the files of a drawn frame, and the objects under its pixels.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"
#include "runtime/draw/pick.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"
#include "runtime/threads/workers.h"
#include "tools/common/output/json_writer.h"
#include "tools/render/layers.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Pictures of a frame for the files; empty if not requested.
struct FrameOutputs {
  std::span<const std::byte> rgba;  // runtime::Layer::kColor
  FrameLayers layers;
  std::span<const uint64_t> samples;
};

/// Writes a picture of RGBA8 pixels, a .png with alpha only if the background is not opaque. `workers`: null, or
/// threads that encode it together. Errors as runtime::write_png().
Result<void> write_picture(const RenderOptions& options, const std::string& path, std::span<const std::byte> rgba,
                           runtime::Workers* workers, format::Existing existing);

/// Writes all files that `options` request. `map`: the mapped scene; if its file was cut short, no output is written.
/// Returns the time of writing the picture. Errors kFile, also "interrupted" if a signal requests a stop.
Result<runtime::Duration> write_outputs(const RenderOptions& options, const runtime::MappedFile& map,
                                        const FrameOutputs& outputs);

/// The surface at a pixel; nullopt on the background.
struct FoundPick {
  PixelPlace place;
  std::optional<runtime::Pick> pick;
};

/// Finds options.picks. `view`: in samples. Errors as pick_sample().
Result<std::vector<FoundPick>> find_picks(const RenderOptions& options, const runtime::Scene& scene,
                                          const kernels::View& view, std::span<const uint64_t> samples);

/// Prints a line for each pick.
void print_picks(const format::Container& container, std::span<const FoundPick> picks);

/// Writes the member "picks", if there are any.
void write_picks(JsonWriter& json, const format::Container& container, std::span<const FoundPick> picks);

/// "12 (Rock)".
std::string number_and_name(uint64_t number, std::string_view name);

}  // namespace scree::tools
