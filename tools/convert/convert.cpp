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
#include <map>
#include <set>
#include <thread>

#include "format/container.h"
#include "format/quantize.h"
#include "tools/common/memory_use.h"
#include "tools/common/options.h"
#include "tools/common/progress.h"
#include "tools/convert/byte_source.h"
#include "tools/convert/convert_options.h"
#include "tools/convert/duplicates.h"
#include "tools/convert/geometry_writer.h"
#include "tools/convert/gltf_source.h"
#include "tools/convert/images.h"
#include "tools/convert/lattices.h"
#include "tools/convert/left_out.h"
#include "tools/convert/measure.h"
#include "tools/convert/memory_plan.h"
#include "tools/convert/resume.h"
#include "tools/convert/scene_tables.h"
#include "tools/convert/sort_scattered.h"

namespace scree::convert {
namespace {

using format::kNone;

constexpr uint64_t kJobsPerThread = 3;

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
    for (const std::string& written : {output, output + ".part", sort_file_name(output)})
      if (std::filesystem::equivalent(file, written, ignored))
        return Error{ErrorCode::kUsage,
                     written + ": the output would replace " + (file == written ? "a file of the source" : file)};
  return {};
}

}  // namespace

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

namespace {

class Converter {
 public:
  /// `scene` is changed: what it has more than once is referred to once.
  /// `files`: all that the scene is read from.
  Converter(const ConvertOptions& options, SourceScene& scene, const std::set<std::string>& files,
            tools::Progress& progress, ConvertReport& report)
      : options_(options), scene_(scene), files_(files), progress_(progress), report_(report) {}

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
    Result<format::ContainerWriter> writer = open_writer();
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
    const MeasureOptions measure_options{may_sort(options_), options_.drop_nonfinite, options_.chunk_triangles == 0,
                                         options_.normals,
                                         options_.share ? may_repeat(scene_, wanted_) : std::vector<bool>()};
    const StageLimits limits = memory_.measure();
    Result<Measurement> measured = measure(scene_, wanted_, measure_options, limits.threads, options_.stop,
                                           [&](uint64_t done) { progress_.update(done, bytes_read(done, triangles)); });
    if (!measured) return measured.error();
    measurement_ = std::move(*measured);
    Result<SortedPrimitives> sorted =
        sort_scattered(scene_, report_.output, memory_, measure_options, options_.stop, progress_, measurement_);
    if (!sorted) return sorted.error();
    report_.sorted_triangles = sorted->triangles;
    report_.sort_file_bytes = sorted->file_bytes;
    sorted_ = std::move(sorted->copies);
    for (const Measured& primitive : measurement_.primitives) {
      report_.dropped_degenerate += primitive.dropped_degenerate;
      report_.dropped_nonfinite += primitive.dropped_nonfinite;
    }
    return {};
  }

  /// That a window is of: a sorted copy where there is one.
  const Primitive& primitive_of(const WindowPlan& window) const {
    const auto sorted = sorted_.find(window.primitive);
    return sorted == sorted_.end() ? scene_.primitives[window.primitive] : sorted->second;
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
    if (sorted_.contains(primitive)) plan.sorted_triangles = source.triangle_count();
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
    return write_images(scene_, image_options, images_, pool, writer, resumed_.images,
                        [&](uint64_t number, const StoredImageRecord& stored) { log_image(writer, number, stored); });
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

  /// A writer that begins, or goes on where an earlier run ended.
  Result<format::ContainerWriter> open_writer() {
    const format::PartId id = part_id(describe_options(options_), files_, measurement_, images_, tables_);
    if (options_.resume) {
      const std::string part = report_.output + ".part";
      std::error_code ignored;
      const bool is_there = std::filesystem::exists(part, ignored);
      progress_.stage("check " + part, 0);
      Result<format::ContainerWriter> writer = format::ContainerWriter::resume(
          report_.output, id,
          [&](uint32_t kind, std::span<const std::byte> entry) { read_entry(kind, entry, resumed_); });
      if (!writer && writer.error().code != ErrorCode::kFormat) return writer;
      if (writer) {
        settle(resumed_, writer->page_count(), images_.records.size(), measurement_.windows.size());
        writer->drop_pages(resumed_.pages);
        report_.resumed_pages = resumed_.pages;
      }
      if (is_there && resumed_.pages == 0)
        report_.warnings.push_back(part +
                                   ": starts afresh: " + (writer ? "it has no whole page" : writer.error().message));
      if (writer) return writer;
      resumed_ = {};
    }
    Result<format::ContainerWriter> writer = format::ContainerWriter::create(report_.output);
    if (!writer) return writer;
    if (options_.resume) writer->keep_part();
    writer->keep_log(id, most_bytes());
    return writer;
  }

  /// More than the finished file will take.
  uint64_t most_bytes() const {
    uint64_t bytes = uint64_t{1} << 20;
    for (const WindowPlan& window : measurement_.windows) {
      const uint64_t chunks = options_.chunk_triangles == 0 ? 1 : window.kept / options_.chunk_triangles + 2;
      bytes += encoded_bytes_estimate(plans_[mesh_of_[window.primitive]], window) + 512 * chunks;
    }
    for (const uint64_t cost : images_.costs) bytes += 4 * cost;
    bytes += 512 * (scene_.nodes.size() + tables_.meshes.size()) + tables_.strings.bytes().size();
    for (const SourceNode& node : scene_.nodes)
      bytes += node.name.size() + (node.instances ? 256 * node.instances->count : 0);
    return bytes + bytes / 4;
  }

  Result<void> encode(format::ContainerWriter& writer) {
    const std::vector<WindowPlan>& windows = measurement_.windows;
    for (uint64_t i = 0; i < resumed_.whole_windows; ++i)
      note_window(resumed_.windows[i], mesh_of_[windows[i].primitive]);
    const std::vector<Batch> batches = make_batches(windows, resumed_.whole_windows);
    const EncodeOptions encode_options{options_.order, options_.clusters, options_.chunk_triangles,
                                       options_.drop_nonfinite, options_.weld};
    const StageLimits limits = memory_.encode(windows);
    report_.threads = limits.threads;
    std::vector<EncodeScratch> scratch(limits.threads);
    uint64_t source_triangles = 0;
    for (const Batch& batch : batches) source_triangles += batch.triangles;
    progress_.stage("encode", source_triangles);

    const ReadTotals before = read_totals();
    const uint64_t written_before = writer.bytes();
    std::atomic<uint64_t> nanoseconds{0};
    const auto work = [&](uint64_t batch, uint32_t worker) -> Result<std::vector<EncodedWindow>> {
      const Timed timed(nanoseconds);
      std::vector<EncodedWindow> encoded;
      for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i) {
        const WindowPlan& window = windows[i];
        Result<EncodedWindow> result = encode_window(primitive_of(window), plans_[mesh_of_[window.primitive]], window,
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
    GeometryWriter geometry(pool, writer, writer.page_count(), options_.zstd_level);
    uint64_t done = 0;
    const auto rates = [&] {
      const ReadTotals read = read_totals();
      StageRates now;
      now.triangles = done;
      now.read_bytes = read.bytes - before.bytes;
      now.written_bytes = writer.bytes() - written_before;
      now.read_seconds = read.seconds - before.seconds;
      now.encode_seconds =
          std::max(0.0, 1e-9 * static_cast<double>(nanoseconds.load()) - now.read_seconds) + geometry.seal_seconds();
      now.write_seconds = geometry.write_seconds();
      now.threads = limits.threads;
      return now;
    };
    const auto take = [&](uint64_t batch, std::vector<EncodedWindow> encoded) -> Result<void> {
      std::vector<WindowOutcome> outcomes;
      for (uint64_t i = 0; i < encoded.size(); ++i) {
        Result<WindowOutcome> outcome = place_window(encoded[i], batches[batch].first + i, geometry);
        if (!outcome) return outcome.error();
        note_window(*outcome, mesh_of_[windows[batches[batch].first + i].primitive]);
        outcomes.push_back(std::move(*outcome));
      }
      log_windows(writer, batches[batch].first, outcomes);
      done += batches[batch].triangles;
      progress_.update(done, writer.bytes(), [&] { return describe(rates()); });
      return {};
    };
    const InFlight limit{kJobsPerThread * pool.threads(), limits.flight_bytes};
    if (const Result<void> run = run_ordered<std::vector<EncodedWindow>>(pool, batches.size(), limit, work, cost, take);
        !run)
      return run;
    const Result<void> finished = geometry.finish();
    report_.rates = rates();
    return finished;
  }

  /// Gives the chunks of window `number` their places; those that are in the file already have them.
  Result<WindowOutcome> place_window(EncodedWindow& window, uint64_t number, GeometryWriter& geometry) {
    const uint32_t mesh = mesh_of_[measurement_.windows[number].primitive];
    const format::MeshRecord& record = tables_.meshes[mesh];
    if (window.position_error > record.max_position_error)
      return Error{ErrorCode::kRange, primitive_place(scene_, plans_[mesh].primitive) + ": a position error of " +
                                          std::to_string(window.position_error) + ", but at most " +
                                          std::to_string(record.max_position_error) + " is stated"};
    WindowOutcome outcome;
    outcome.position_error = window.position_error;
    outcome.uv_error = window.uv_error;
    outcome.welded = window.welded;
    outcome.repaired_uvs = window.repaired_uvs;
    outcome.repaired_colors = window.repaired_colors;
    outcome.repaired_normals = window.repaired_normals;
    uint64_t triangle = 0;
    if (record.chunk_count > 0) triangle = tables_.chunks.back().first_triangle + tables_.chunks.back().triangle_count;
    const size_t placed = number == resumed_.whole_windows ? resumed_.chunks_of_next : 0;
    for (size_t i = 0; i < window.chunks.size(); ++i) {
      EncodedChunk& chunk = window.chunks[i];
      chunk.record.mesh = mesh;
      chunk.record.first_triangle = triangle;
      triangle += chunk.record.triangle_count;
      outcome.position_bytes.push_back(
          bounds_error(options_) ? PositionTable::position_bytes(record, chunk.record, chunk.payload) : 0);
      if (i < placed) {
        chunk.record.page = resumed_.windows[number].chunks[i].page;
        chunk.record.offset = resumed_.windows[number].chunks[i].offset;
      } else if (const Result<void> added = geometry.add(chunk); !added) {
        return added.error();
      }
      outcome.chunks.push_back(chunk.record);
    }
    return outcome;
  }

  void note_window(const WindowOutcome& window, uint32_t mesh) {
    format::MeshRecord& record = tables_.meshes[mesh];
    if (record.chunk_count == 0) record.first_chunk = tables_.chunks.size();
    record.max_uv_error = std::max(record.max_uv_error, window.uv_error);
    for (size_t i = 0; i < window.chunks.size(); ++i) {
      const format::ChunkRecord& chunk = window.chunks[i];
      if (bounds_error(options_))
        report_.positions.add(record, record.chunk_count == 0, chunk, window.position_bytes[i]);
      record.vertex_count += chunk.vertex_count;
      ++record.chunk_count;
      tables_.chunks.push_back(chunk);
    }
    report_.position_error = std::max(report_.position_error, window.position_error);
    const double diagonal = box_diagonal(plans_[mesh].box);
    if (diagonal > 0)
      report_.relative_position_error = std::max(report_.relative_position_error, window.position_error / diagonal);
    welded_.add(window.welded);
    repaired_uvs_ += window.repaired_uvs;
    repaired_colors_ += window.repaired_colors;
    repaired_normals_ += window.repaired_normals;
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
  const std::set<std::string>& files_;
  tools::Progress& progress_;
  ConvertReport& report_;
  Resumed resumed_;
  std::vector<bool> wanted_;  // of the primitives: some node draws them
  MemoryPlan memory_;
  Measurement measurement_;
  std::map<uint32_t, Primitive> sorted_;  // copies of primitives without locality
  MergedMaterials merged_;
  std::vector<uint32_t> first_equal_;  // of each group the one that is stored for it
  std::vector<MeshPlan> plans_;        // as tables_.meshes
  std::vector<uint32_t> mesh_of_;      // of each primitive, or kNone
  ImagePlan images_;
  InstancePlan instances_;
  format::TableSet tables_;
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
    if (const Result<void> done = Converter(options, *scene, files, progress, report).run(); !done) return done.error();
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

}  // namespace scree::convert
