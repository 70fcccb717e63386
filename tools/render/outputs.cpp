#include "tools/render/outputs.h"

#include <cstdio>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tools/common/output/text_table.h"
#include "tools/common/process/sigbus.h"
#include "tools/common/process/stop_signal.h"

namespace scree::tools {

namespace {

std::string describe_pick(const format::Container& container, PixelPlace place,
                          const std::optional<runtime::Pick>& pick) {
  std::string line = "pick " + std::to_string(place.x) + "," + std::to_string(place.y) + ": ";
  if (!pick) return line + "nothing\n";
  const format::MeshRecord& mesh = container.meshes()[pick->mesh];
  const std::string node = number_and_name(pick->node, container.string(container.nodes()[pick->node].name));
  const std::string mesh_name = number_and_name(pick->mesh, container.string(container.groups()[mesh.group].name));
  line += "node " + node;
  if (container.nodes()[pick->node].node_instance_count > 0)
    line += ", instance " + std::to_string(pick->node_instance);
  line += ", mesh " + mesh_name + ", triangle " + std::to_string(pick->mesh_triangle);
  if (pick->source_triangle) line += ", source triangle " + std::to_string(*pick->source_triangle);
  char depth[48];
  std::snprintf(depth, sizeof depth, ", depth %.9g\n", pick->depth);
  return line + depth;
}

/// Records that an output was written. Error kFile "interrupted" if a signal has requested a stop.
Result<void> is_written(const Result<void>& written, const std::string& path) {
  if (!written) return written;
  note_written(path);
  if (StopOnSignal::flag()->load()) return Error{ErrorCode::kFile, "interrupted"};
  return {};
}

}  // namespace

std::string number_and_name(uint64_t number, std::string_view name) {
  return std::to_string(number) + (name.empty() ? "" : " (" + inspect::printable(name, 400) + ")");
}

Result<void> write_picture(const RenderOptions& options, const std::string& path, std::span<const std::byte> rgba,
                           runtime::Workers* workers, format::Existing existing) {
  const std::span<const uint8_t> bytes(reinterpret_cast<const uint8_t*>(rgba.data()), rgba.size());
  return runtime::write_png(path, {options.camera.width, options.camera.height, 4, bytes},
                            {.has_alpha = options.shade.background[3] < 1.0f, .workers = workers}, existing);
}

Result<runtime::Duration> write_outputs(const RenderOptions& options, const runtime::MappedFile& map,
                                        const FrameOutputs& outputs) {
  SCREE_TRY(check_unchanged(map));
  const StopOnSignal handlers;
  const runtime::Stopwatch watch;
  runtime::Workers workers(options.threads);
  if (!outputs.rgba.empty())
    SCREE_TRY(
        is_written(write_picture(options, options.output, outputs.rgba, &workers, options.existing), options.output));
  if (options.writes_exr()) SCREE_TRY(is_written(write_exr_layers(options, outputs.layers), options.output));
  const runtime::Duration taken = watch.elapsed();
  const auto write_floats = [&](const std::string& path, const std::vector<float>& values) {
    return is_written(runtime::write_pfm(path, options.camera.width, options.camera.height, values, options.existing),
                      path);
  };
  if (!options.depth.empty()) SCREE_TRY(write_floats(options.depth, outputs.layers.depth));
  if (!options.normals.empty()) SCREE_TRY(write_floats(options.normals, outputs.layers.normals));
  if (!options.uvs.empty()) SCREE_TRY(write_floats(options.uvs, three_channels(outputs.layers.uvs)));
  if (!options.visbuffer.empty())
    SCREE_TRY(
        is_written(runtime::write_visibility(options.visbuffer, outputs.samples, options.existing), options.visbuffer));
  return taken;
}

Result<std::vector<FoundPick>> find_picks(const RenderOptions& options, const runtime::Scene& scene,
                                          const kernels::View& view, std::span<const uint64_t> samples) {
  std::vector<FoundPick> picks;
  for (const PixelPlace& place : options.picks) {
    const uint64_t index = runtime::sample_index(view, options.samples_per_side, place.x, place.y);
    picks.push_back({place, SCREE_TRY(runtime::pick_sample(scene, view, samples[index]))});
  }
  SCREE_TRY(check_unchanged(scene.file().map()));
  return picks;
}

void print_picks(const format::Container& container, std::span<const FoundPick> picks) {
  for (const FoundPick& found : picks) std::fputs(describe_pick(container, found.place, found.pick).c_str(), stdout);
}

void write_picks(JsonWriter& json, const format::Container& container, std::span<const FoundPick> picks) {
  if (picks.empty()) return;
  json.objects("picks", picks, [&](const FoundPick& found) {
    json.member("x", found.place.x);
    json.member("y", found.place.y);
    json.member("hit", found.pick.has_value());
    if (!found.pick) return;
    const runtime::Pick& pick = *found.pick;
    json.member("node", pick.node);
    json.member("node_name", container.string(container.nodes()[pick.node].name));
    json.member("node_instance", pick.node_instance);
    json.member("mesh", pick.mesh);
    json.member("mesh_name", container.string(container.groups()[container.meshes()[pick.mesh].group].name));
    json.member("mesh_triangle", pick.mesh_triangle);
    if (pick.source_triangle) json.member("source_triangle", *pick.source_triangle);
    json.member("depth", pick.depth);
  });
}

}  // namespace scree::tools
