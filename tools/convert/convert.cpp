#include "tools/convert/convert.h"

#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <set>
#include <thread>

#include "format/container.h"
#include "format/quantize.h"
#include "tools/common/memory_use.h"
#include "tools/common/options.h"
#include "tools/common/progress.h"
#include "tools/convert/duplicates.h"
#include "tools/convert/geometry_writer.h"
#include "tools/convert/gltf_source.h"
#include "tools/convert/images.h"
#include "tools/convert/lattices.h"
#include "tools/convert/left_out.h"
#include "tools/convert/measure.h"
#include "tools/convert/memory_plan.h"
#include "tools/convert/scene_tables.h"

namespace scree::convert {
namespace {

using format::kNone;

constexpr uint64_t kJobsPerThread = 3;

/// Whether the error is chosen, and not the bits.
bool bounds_error(const ConvertOptions& options) {
  return options.max_error > 0 || options.pixel_bound.pixels > 0;
}

Result<void> check_pixel_bound(const PixelBound& bound) {
  const auto usage = [](std::string message) { return Error{ErrorCode::kUsage, std::move(message)}; };
  const auto is_positive = [](double value) { return value > 0 && std::isfinite(value); };
  if (!is_positive(bound.pixels)) return usage("--max-error-pixels: not a number of pixels above 0");
  if (!is_positive(bound.distance)) return usage("--at-distance: not a length above 0");
  if (bound.width < 1 || bound.height < 1) return usage("--at-size: a picture without pixels");
  if (!(bound.fov_degrees > 0 && bound.fov_degrees < 180)) return usage("--at-fov: not above 0 and below 180 degrees");
  return {};
}

Result<void> check_options(const ConvertOptions& options) {
  const auto usage = [](std::string message) { return Error{ErrorCode::kUsage, std::move(message)}; };
  if (options.position_bits < 8 || options.position_bits > format::kMaxPositionBits)
    return usage("--positions: " + std::to_string(options.position_bits) + " bits, but 8 to " +
                 std::to_string(format::kMaxPositionBits) + " are possible");
  if (!(options.max_error >= 0) || !std::isfinite(options.max_error)) return usage("--max-error: not a length above 0");
  if (options.float32 && options.max_error > 0) return usage("--max-error and --positions float32 exclude each other");
  if (options.pixel_bound.pixels != 0) {
    if (options.max_error > 0 || options.float32)
      return usage("--max-error-pixels, --max-error and --positions float32 exclude each other");
    if (Result<void> checked = check_pixel_bound(options.pixel_bound); !checked) return checked;
  }
  if (options.float32 && options.grid == Grid::kScene)
    return usage("--grid scene and --positions float32 exclude each other");
  if (options.zstd_level < 0 || options.zstd_level > 22)
    return usage("--zstd: level " + std::to_string(options.zstd_level) + ", but 0 to 22 are possible");
  if (options.images.quality < 1 || options.images.quality > 100)
    return usage("--textures: quality " + std::to_string(options.images.quality) + ", but 1 to 100 are possible");
  if (options.threads > 4096) return usage("--threads: more than 4096");
  return {};
}

/// Fails early where the end of a long run would: a folder, or a place where nothing can be made.
Result<void> check_output(const std::string& output) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (fs::is_directory(output, ignored)) return Error{ErrorCode::kFile, output + ": is a folder"};
  fs::path folder = fs::path(output).parent_path();
  if (folder.empty()) folder = ".";
  if (::access(folder.c_str(), W_OK | X_OK) != 0)
    return Error{ErrorCode::kFile, folder.string() + ": " + std::strerror(errno)};
  return {};
}

/// The output must not replace what it is made from.
Result<void> check_not_source(const std::set<std::string>& files, const std::string& output) {
  std::error_code ignored;
  for (const std::string& file : files)
    for (const std::string& written : {output, output + ".part"})
      if (std::filesystem::equivalent(file, written, ignored))
        return Error{ErrorCode::kUsage,
                     written + ": the output would replace " + (file == written ? "a file of the source" : file)};
  return {};
}

/// All files the scene is read from: the input and what it names.
std::set<std::string> source_files(const std::string& input, const SourceScene& scene) {
  std::set<std::string> files{input};
  const auto add = [&](const std::shared_ptr<const ByteSource>& source) {
    if (source != nullptr && !source->path().empty()) files.insert(source->path());
  };
  const auto add_accessor = [&](const Accessor& accessor) {
    add(accessor.source);
    if (!accessor.sparse) return;
    add(accessor.sparse->index_source);
    add(accessor.sparse->value_source);
  };
  for (const Primitive& primitive : scene.primitives) {
    add_accessor(primitive.positions);
    for (const std::optional<Accessor>* accessor :
         {&primitive.indices, &primitive.uv, &primitive.color, &primitive.normal})
      if (*accessor) add_accessor(**accessor);
  }
  for (const SourceImage& image : scene.images) add(image.source);
  return files;
}

std::string describe_textures(const ImageOptions& options) {
  if (options.textures == Textures::kRaw) return "raw";
  return options.textures == Textures::kKeep ? "keep" : "jpeg:" + std::to_string(options.quality);
}

/// The options that shape the bytes, as they are typed.
std::string describe_options(const ConvertOptions& options) {
  char error[64];
  std::snprintf(error, sizeof error, "--max-error %.17g", options.max_error);
  char pixels[192];
  const PixelBound& bound = options.pixel_bound;
  std::snprintf(pixels, sizeof pixels, "--max-error-pixels %.17g --at-distance %.17g --at-size %ux%u --at-fov %.17g",
                bound.pixels, bound.distance, bound.width, bound.height, bound.fov_degrees);
  std::string text = bound.pixels > 0        ? std::string(pixels)
                     : options.max_error > 0 ? std::string(error)
                     : options.float32       ? std::string("--positions float32")
                                             : "--positions " + std::to_string(options.position_bits);
  text += options.grid == Grid::kScene ? " --grid scene" : " --grid mesh";
  text += options.order == Order::kNone ? " --order none" : " --order fifo";
  text += options.encoding == Encoding::kClustered ? " --encoding clustered" : " --encoding indexed";
  if (options.encoding == Encoding::kClustered)
    text += options.clusters == tools::ClusterEffort::kBest ? " --clusters best" : " --clusters fast";
  text += " --chunk-triangles " + std::to_string(options.chunk_triangles);
  text += " --zstd " + std::to_string(options.zstd_level);
  text += " --textures " + describe_textures(options.images);
  if (options.normals) text += " --normals";
  if (options.source_ids) text += " --source-ids";
  if (options.drop_nonfinite) text += " --drop-nonfinite";
  if (!options.weld) text += " --no-weld";
  if (!options.share) text += " --no-share";
  if (options.images.keep_going) text += " --keep-going";
  if (!options.exclude.empty()) text += " --exclude " + options.exclude;
  return text;
}

class Converter {
 public:
  /// `scene` is changed: what it has more than once is referred to once.
  Converter(const ConvertOptions& options, SourceScene& scene, tools::Progress& progress, ConvertReport& report)
      : options_(options), scene_(scene), progress_(progress), report_(report) {}

  Result<void> run() {
    find_wanted();
    if (const Result<void> done = plan_memory(); !done) return done;
    if (const Result<void> done = measure_primitives(); !done) return done;
    if (const Result<void> done = plan_images(); !done) return done;
    merge_equal();
    add_meshes();
    plan_materials();
    Result<InstancePlan> instances = plan_scenes(scene_, tables_);
    if (!instances) return instances.error();
    instances_ = std::move(*instances);
    if (const Result<void> done = choose_lattices(options_, scene_, instances_, plans_, tables_); !done) return done;
    add_source_record();
    Result<format::ContainerWriter> writer = format::ContainerWriter::create(report_.output);
    if (!writer) return writer.error();
    // Images come first: what is wrong with one is said before the geometry is encoded.
    if (const Result<void> done = store_images(*writer); !done) return done;
    report_.warnings.insert(report_.warnings.end(), images_.warnings.begin(), images_.warnings.end());
    tables_.images = images_.records;
    tables_.mip_levels = images_.levels;
    if (const Result<void> done = encode(*writer); !done) return done;
    list_left_out();
    if (const Result<void> done = write_nodes(scene_, instances_, tables_, *writer); !done) return done;
    const Result<uint64_t> bytes = writer->finish(tables_);
    if (!bytes) return bytes.error();
    report_.output_bytes = *bytes;
    fill_report();
    return {};
  }

 private:
  void find_wanted() {
    std::vector<bool> drawn(scene_.groups.size());
    for (const SourceNode& node : scene_.nodes)
      if (node.group != kNone) drawn[node.group] = true;
    wanted_.resize(scene_.primitives.size());
    for (size_t i = 0; i < wanted_.size(); ++i) {
      wanted_[i] = drawn[scene_.primitives[i].group];
      if (!wanted_[i]) ++undrawn_;
    }
  }

  Result<void> plan_memory() {
    report_.threads_asked =
        options_.threads != 0 ? options_.threads : std::max(1u, std::thread::hardware_concurrency());
    Result<MemoryPlan> plan = MemoryPlan::make(options_, scene_, wanted_, largest_image_bytes(scene_, options_.images),
                                               report_.threads_asked);
    if (!plan) return plan.error();
    memory_ = *plan;
    return {};
  }

  Result<void> measure_primitives() {
    uint64_t triangles = 0;
    for (size_t i = 0; i < wanted_.size(); ++i)
      if (wanted_[i]) triangles += scene_.primitives[i].triangle_count();
    progress_.stage("measure", triangles);
    const MeasureOptions measure_options{options_.drop_nonfinite, options_.chunk_triangles == 0, options_.normals,
                                         options_.share ? may_repeat(scene_, wanted_) : std::vector<bool>()};
    const StageLimits limits = memory_.measure();
    Result<Measurement> measured = measure(scene_, wanted_, measure_options, limits.threads, options_.stop,
                                           [&](uint64_t done) { progress_.update(done, bytes_read(done, triangles)); });
    if (!measured) return measured.error();
    measurement_ = std::move(*measured);
    for (const Measured& primitive : measurement_.primitives) {
      report_.dropped_degenerate += primitive.dropped_degenerate;
      report_.dropped_nonfinite += primitive.dropped_nonfinite;
    }
    return {};
  }

  /// For the progress line: buffers are read evenly with the triangles, near enough.
  uint64_t bytes_read(uint64_t done, uint64_t total) const {
    const double share = total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 0;
    return static_cast<uint64_t>(share * static_cast<double>(scene_.buffer_bytes));
  }

  /// Groups and meshes: a mesh for every primitive that keeps a triangle.
  void add_meshes() {
    tables_.groups.resize(scene_.groups.size());
    mesh_of_.assign(scene_.primitives.size(), kNone);
    size_t primitive = 0;
    for (uint32_t g = 0; g < scene_.groups.size(); ++g) {
      format::GroupRecord& group = tables_.groups[g];
      group.name = tables_.strings.add(scene_.groups[g].name);
      group.first_mesh = static_cast<uint32_t>(tables_.meshes.size());
      for (; primitive < scene_.primitives.size() && scene_.primitives[primitive].group == g; ++primitive) {
        if (measurement_.primitives[primitive].triangles == 0 || is_repeat(primitive)) continue;
        add_mesh(static_cast<uint32_t>(primitive));
        ++group.mesh_count;
      }
    }
  }

  void add_mesh(uint32_t primitive) {
    const Primitive& source = scene_.primitives[primitive];
    const Measured& measured = measurement_.primitives[primitive];
    MeshPlan plan;
    plan.primitive = primitive;
    plan.float32 = options_.float32;
    plan.clustered = options_.encoding == Encoding::kClustered && !options_.float32;
    plan.box = measured.box;
    if (source.uv) plan.attributes |= format::kHasUv;
    if (source.color && !measured.white) plan.attributes |= format::kHasColor;
    if (source.normal && options_.normals) plan.attributes |= format::kHasNormal;
    if (options_.source_ids) plan.attributes |= format::kHasSourceIds;

    format::MeshRecord record{};
    record.triangle_count = measured.triangles;
    record.source_vertex_count = source.vertex_count();
    record.position_encoding =
        options_.float32 ? format::PositionEncoding::kFloat32 : format::PositionEncoding::kLattice;
    record.attributes = plan.attributes;
    record.material = source.material;  // numbered anew by plan_materials
    record.group = source.group;
    std::copy(plan.box.lo.begin(), plan.box.lo.end(), record.bounds_min);
    std::copy(plan.box.hi.begin(), plan.box.hi.end(), record.bounds_max);
    mesh_of_[primitive] = static_cast<uint32_t>(tables_.meshes.size());
    tables_.meshes.push_back(record);
    plans_.push_back(plan);
  }

  /// Flags for the materials of primitives that keep a triangle.
  std::vector<bool> materials_used() const {
    std::vector<bool> used(scene_.materials.size());
    for (size_t i = 0; i < scene_.primitives.size(); ++i)
      if (measurement_.primitives[i].triangles != 0 && scene_.primitives[i].material != kNone)
        used[scene_.primitives[i].material] = true;
    return used;
  }

  /// Images of the primitives that are kept.
  Result<void> plan_images() {
    const MaterialUse use = find_material_use(scene_, materials_used());
    std::vector<bool> wanted(scene_.images.size());
    for (size_t i = 0; i < wanted.size(); ++i) wanted[i] = use.images[i] != kNone;
    ImageOptions image_options = options_.images;
    const StageLimits limits = memory_.images(image_options.memory);
    image_options.memory = limits.flight_bytes;
    WorkerPool pool(limits.threads, options_.stop);
    Result<ImagePlan> images = check_images(scene_, wanted, image_options, pool);
    if (!images) return images.error();
    images_ = std::move(*images);
    for (size_t i = 0; i < images_.records.size(); ++i)
      images_.records[i].name = tables_.strings.add(scene_.images[images_.sources[i]].name);
    return {};
  }

  Result<void> store_images(format::ContainerWriter& writer) {
    ImageOptions image_options = options_.images;
    const StageLimits limits = memory_.images(image_options.memory);
    image_options.memory = limits.flight_bytes;
    WorkerPool pool(limits.threads, options_.stop);
    return write_images(scene_, image_options, images_, pool, writer);
  }

  void merge_equal() {
    if (options_.share) merged_ = merge_materials(scene_, materials_used(), images_.places);
    first_equal_ = find_equal_groups(scene_, measurement_);
    for (SourceNode& node : scene_.nodes)
      if (node.group != kNone) node.group = first_equal_[node.group];
    std::erase_if(measurement_.windows, [&](const WindowPlan& window) { return is_repeat(window.primitive); });
  }

  /// Whether a primitive is of a glTF mesh that is stored as another one.
  bool is_repeat(size_t primitive) const {
    const uint32_t group = scene_.primitives[primitive].group;
    return first_equal_[group] != group;
  }

  /// Materials and textures of the meshes that are kept.
  void plan_materials() {
    const MaterialUse use = find_material_use(scene_, materials_used());
    for (format::MeshRecord& mesh : tables_.meshes)
      if (mesh.material != kNone) mesh.material = use.materials[mesh.material];
    add_materials(scene_, use, images_.places, tables_);
  }

  Result<void> encode(format::ContainerWriter& writer) {
    const std::vector<WindowPlan>& windows = measurement_.windows;
    const std::vector<Batch> batches = make_batches(windows);
    const EncodeOptions encode_options{options_.order, options_.clusters, options_.chunk_triangles,
                                       options_.drop_nonfinite, options_.weld};
    const StageLimits limits = memory_.encode(windows);
    report_.threads = limits.threads;
    std::vector<EncodeScratch> scratch(limits.threads);
    uint64_t source_triangles = 0;
    for (const Batch& batch : batches) source_triangles += batch.triangles;
    progress_.stage("encode", source_triangles);

    const auto work = [&](uint64_t batch, uint32_t worker) -> Result<std::vector<EncodedWindow>> {
      std::vector<EncodedWindow> encoded;
      for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i) {
        const WindowPlan& window = windows[i];
        Result<EncodedWindow> result =
            encode_window(scene_.primitives[window.primitive], plans_[mesh_of_[window.primitive]], window,
                          encode_options, scratch[worker]);
        if (!result) return at(scene_.file_name, result.error());
        encoded.push_back(std::move(*result));
      }
      return encoded;
    };
    const auto cost = [&](uint64_t batch) {
      uint64_t bytes = 0;
      for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i)
        bytes += encoded_bytes_estimate(plans_[mesh_of_[windows[i].primitive]], windows[i]);
      return bytes;
    };
    WorkerPool pool(limits.threads, options_.stop);
    GeometryWriter geometry(pool, writer, images_.page_count, options_.zstd_level);
    uint64_t done = 0;
    const auto take = [&](uint64_t batch, std::vector<EncodedWindow> encoded) -> Result<void> {
      for (uint64_t i = 0; i < encoded.size(); ++i) {
        const uint32_t mesh = mesh_of_[windows[batches[batch].first + i].primitive];
        if (const Result<void> added = add_window(encoded[i], mesh, geometry); !added) return added;
      }
      done += batches[batch].triangles;
      progress_.update(done, writer.bytes());
      return {};
    };
    const InFlight limit{kJobsPerThread * pool.threads(), limits.flight_bytes};
    if (const Result<void> run = run_ordered<std::vector<EncodedWindow>>(pool, batches.size(), limit, work, cost, take);
        !run)
      return run;
    return geometry.finish();
  }

  Result<void> add_window(EncodedWindow& window, uint32_t mesh, GeometryWriter& geometry) {
    format::MeshRecord& record = tables_.meshes[mesh];
    if (record.chunk_count == 0) {
      record.first_chunk = tables_.chunks.size();
      next_triangle_ = 0;
    }
    if (window.position_error > record.max_position_error)
      return Error{ErrorCode::kRange, primitive_place(scene_, plans_[mesh].primitive) + ": a position error of " +
                                          std::to_string(window.position_error) + ", but at most " +
                                          std::to_string(record.max_position_error) + " is stated"};
    record.max_uv_error = std::max(record.max_uv_error, window.uv_error);
    for (EncodedChunk& chunk : window.chunks) {
      chunk.record.mesh = mesh;
      chunk.record.first_triangle = next_triangle_;
      next_triangle_ += chunk.record.triangle_count;
      if (bounds_error(options_)) report_.positions.add(record, record.chunk_count == 0, chunk.record, chunk.payload);
      if (const Result<void> added = geometry.add(chunk); !added) return added;
      record.vertex_count += chunk.record.vertex_count;
      ++record.chunk_count;
      tables_.chunks.push_back(chunk.record);
    }
    report_.position_error = std::max(report_.position_error, window.position_error);
    const double diagonal = box_diagonal(plans_[mesh].box);
    if (diagonal > 0)
      report_.relative_position_error = std::max(report_.relative_position_error, window.position_error / diagonal);
    welded_.add(window.welded);
    repaired_uvs_ += window.repaired_uvs;
    repaired_colors_ += window.repaired_colors;
    repaired_normals_ += window.repaired_normals;
    return {};
  }

  static double box_diagonal(const Box& box) {
    double sum = 0;
    for (size_t axis = 0; axis < 3; ++axis) {
      const double side = static_cast<double>(box.hi[axis]) - static_cast<double>(box.lo[axis]);
      sum += side * side;
    }
    return std::sqrt(sum);
  }

  void add_source_record() {
    AccessorBytes indices, positions, attributes;
    for (size_t i = 0; i < scene_.primitives.size(); ++i) {
      if (mesh_of_[i] == kNone) continue;
      const Primitive& primitive = scene_.primitives[i];
      if (primitive.indices) indices.add(*primitive.indices);
      positions.add(primitive.positions);
      for (const std::optional<Accessor>* attribute : {&primitive.uv, &primitive.color, &primitive.normal})
        if (*attribute) attributes.add(**attribute);
    }
    format::SourceRecord& source = tables_.source;
    source.json_bytes = scene_.json_bytes;
    source.buffer_bytes = scene_.buffer_bytes;
    source.file_bytes = report_.input_bytes;
    source.index_bytes = indices.bytes();
    source.position_bytes = positions.bytes();
    source.attribute_bytes = attributes.bytes();
    source.name = tables_.strings.add(scene_.file_name);
    source.options = tables_.strings.add(describe_options(options_));
    source.generator = tables_.strings.add("scree " SCREE_VERSION);
    source.copyright = tables_.strings.add(scene_.copyright);
  }

  void list_left_out() {
    convert::add_left_out(
        {scene_, plans_, mesh_of_, measurement_.primitives, first_equal_, images_, merged_, welded_, undrawn_,
         report_.dropped_degenerate, report_.dropped_nonfinite, repaired_uvs_, repaired_colors_, repaired_normals_},
        tables_);
    const auto warn = [&](uint64_t count, const char* text) {
      if (count > 0) report_.warnings.push_back(scene_.file_name + ": " + std::to_string(count) + " " + text);
    };
    warn(undrawn_, "primitives that no node draws are left out");
    warn(report_.dropped_nonfinite, "triangles with positions that are not finite are left out");
    warn(repaired_uvs_, "texture coordinates are not finite and became 0");
    warn(repaired_colors_, "vertex colours are not finite and became 0");
    warn(repaired_normals_, "normals are zero or not finite and became +z");
    if (tables_.meshes.empty()) report_.warnings.push_back(scene_.file_name + ": there is nothing to draw");
  }

  void fill_report() {
    report_.meshes = tables_.meshes.size();
    report_.chunks = tables_.chunks.size();
    for (const format::MeshRecord& mesh : tables_.meshes) {
      report_.triangles += mesh.triangle_count;
      report_.position_error_bound = std::max(report_.position_error_bound, mesh.max_position_error);
    }
    for (const format::SceneRecord& scene : tables_.scenes) report_.triangles_drawn += scene.triangle_count;
  }

  const ConvertOptions& options_;
  SourceScene& scene_;
  tools::Progress& progress_;
  ConvertReport& report_;
  std::vector<bool> wanted_;  // of the primitives: some node draws them
  MemoryPlan memory_;
  Measurement measurement_;
  MergedMaterials merged_;
  std::vector<uint32_t> first_equal_;  // of each group the one that is stored for it
  std::vector<MeshPlan> plans_;        // as tables_.meshes
  std::vector<uint32_t> mesh_of_;      // of each primitive, or kNone
  ImagePlan images_;
  InstancePlan instances_;
  format::TableSet tables_;
  uint64_t next_triangle_ = 0;  // of the mesh that is written
  uint64_t undrawn_ = 0;
  Welded welded_;
  uint64_t repaired_uvs_ = 0;
  uint64_t repaired_colors_ = 0;
  uint64_t repaired_normals_ = 0;
};

Result<ConvertReport> convert_or_throw(const ConvertOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const tools::MemoryUse before = tools::memory_use();
  if (const Result<void> checked = check_options(options); !checked) return checked.error();
  ConvertReport report;
  report.output = options.output.empty() ? std::filesystem::path(options.input).replace_extension(".scree").string()
                                         : options.output;
  if (const Result<void> checked = check_output(report.output); !checked) return checked.error();
  ImportOptions import_options;
  import_options.exclude = options.exclude;
  import_options.kept_view_bytes = kept_view_bytes(options.memory);
  Result<SourceScene> scene = import_gltf(options.input, import_options);
  if (!scene) return scene.error();
  report.warnings = scene->warnings;
  const std::set<std::string> files = source_files(options.input, *scene);
  if (const Result<void> checked = check_not_source(files, report.output); !checked) return checked.error();
  for (const std::string& file : files) {
    std::error_code ignored;
    const uint64_t bytes = std::filesystem::file_size(file, ignored);
    if (!ignored) report.input_bytes += bytes;
  }
  {
    tools::Progress progress(options.progress);
    if (const Result<void> done = Converter(options, *scene, progress, report).run(); !done) return done.error();
  }
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  report.peak_bytes = tools::peak_anonymous(before);
  return report;
}

}  // namespace

Result<ConvertReport> convert(const ConvertOptions& options) {
  try {
    return convert_or_throw(options);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, options.input + ": out of memory"};
  } catch (const std::exception& error) {  // no thread to be had
    return Error{ErrorCode::kMemory, options.input + ": " + error.what()};
  }
}

std::string describe(const ConvertOptions& options, const ConvertReport& report) {
  char numbers[256];
  const double in = static_cast<double>(report.input_bytes);
  const double out = static_cast<double>(report.output_bytes);
  const double triangles = static_cast<double>(report.triangles);
  std::snprintf(numbers, sizeof numbers,
                "ratio %.2f, %.2f bits/triangle, max position error %.3g (%.2g of the diagonal), %.2f s, "
                "%s triangles/s, peak memory %s",
                out > 0 ? in / out : 0.0, triangles > 0 ? 8 * out / triangles : 0.0, report.position_error,
                report.relative_position_error, report.seconds,
                tools::format_count(report.seconds > 0 ? triangles / report.seconds : 0).c_str(),
                tools::format_bytes(report.peak_bytes).c_str());
  std::string text = options.input + " -> " + report.output + ": " + tools::format_bytes(report.input_bytes) + " -> " +
                     tools::format_bytes(report.output_bytes) + ", " + numbers;
  if (report.threads < report.threads_asked)
    text +=
        ", " + std::to_string(report.threads) + " of " + std::to_string(report.threads_asked) + " threads (--memory)";
  return text;
}

}  // namespace scree::convert
