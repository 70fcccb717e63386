#include "tools/convert/passes/converter.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "format/container/container.h"
#include "format/fail.h"
#include "runtime/files/mapped_file.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/common/output/progress.h"
#include "tools/convert/encode/geometry_writer.h"
#include "tools/convert/images/images.h"
#include "tools/convert/images/masks.h"
#include "tools/convert/passes/encode_ahead.h"
#include "tools/convert/passes/encode_pass.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/passes/merge_pass.h"
#include "tools/convert/passes/output_bound.h"
#include "tools/convert/passes/resume.h"
#include "tools/convert/passes/shard.h"
#include "tools/convert/passes/sort_scattered.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/lattices.h"
#include "tools/convert/plan/left_out.h"
#include "tools/convert/plan/mesh_plan.h"
#include "tools/convert/plan/scene_tables.h"
#include "tools/convert/windows/duplicates.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/box.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

using format::kNone;

constexpr uint64_t kEncodeJobsPerThread = 3;

class Converter {
 public:
  Converter(const ConvertOptions& options, SourceScene& scene, const std::set<std::string>& files, ShardSet* shards,
            tools::Progress& progress, ConvertReport& report)
      : options_(options), scene_(scene), files_(files), shards_(shards), progress_(progress), report_(report) {}

  Result<void> run() {
    find_wanted();
    SCREE_TRY(find_masks());
    SCREE_TRY(plan_memory());
    if (shards_ == nullptr) prepare_ahead();
    read_before_ = read_totals();  // the rates count only the geometry, not the images before it
    SCREE_TRY(shards_ != nullptr ? take_measured() : measure_primitives());
    for (const Measured& primitive : measurement_.primitives) {
      report_.dropped_degenerate += primitive.dropped_degenerate;
      report_.dropped_nonfinite += primitive.dropped_nonfinite;
    }
    if (!ahead_) SCREE_TRY(plan_images(materials_used()));
    if (options_.shards > 0) note_plan();
    merge_equal();
    add_meshes();
    plan_materials();
    instances_ = SCREE_TRY(plan_scenes(scene_, tables_));
    SCREE_TRY(choose_lattices(options_, scene_, instances_, plans_, tables_));
    add_source_record();
    EncodeStart start;
    if (options_.shards > 0) start = cut_shard();
    if (!ahead_) {
      writer_ = SCREE_TRY(open_writer());
      if (options_.resume && options_.on_part) options_.on_part();
      // Images come first, so that a damaged image is reported before the geometry is encoded.
      SCREE_TRY(store_images(*writer_));
      written_before_ = writer_->bytes();
    }
    report_.warnings.insert(report_.warnings.end(), images_.warnings.begin(), images_.warnings.end());
    tables_.images = images_.records;
    tables_.mip_levels = images_.levels;
    SCREE_TRY(shards_ != nullptr ? place_shards() : encode(*writer_, std::move(start)));
    if (options_.shards > 0) return finish_shard();
    SCREE_TRY(store_masks(*writer_));
    list_left_out();
    SCREE_TRY(write_nodes(scene_, instances_, tables_, *writer_));
    format::ContainerWriter::Check check;
    if (shards_ != nullptr) check = [this](const std::string& part) { return check_merged(part); };
    report_.output_bytes = SCREE_TRY(writer_->finish(tables_, check));
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

  /// Finds the alpha masks that hide some texels but not all. A primitive that its mask hides everywhere is no longer
  /// wanted.
  Result<void> find_masks() {
    WorkerPool pool(report_.threads_asked, options_.stop);
    ImageOptions image_options = options_.images;
    image_options.memory = std::min(image_options.memory, options_.memory / 2);
    masks_ = SCREE_TRY(plan_masks(scene_, wanted_, image_options, pool, [](uint64_t) {}));
    for (size_t i = 0; i < wanted_.size(); ++i) {
      if (!wanted_[i] || masks_.kind(scene_.primitives[i]) != MaskKind::kClear) continue;
      wanted_[i] = false;
      ++clear_;
    }
    return {};
  }

  Result<void> plan_memory() {
    const uint64_t image_bytes =
        SCREE_TRY(largest_image_bytes(scene_, options_.images, report_.threads_asked, options_.stop));
    memory_ = SCREE_TRY(MemoryPlan::make(options_, scene_, wanted_, std::max(image_bytes, largest_mask_bytes(scene_)),
                                         report_.threads_asked));
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
    const auto show = [&](uint64_t done) { progress_.update(done, bytes_read(done, triangles)); };
    SCREE_TRY(ahead_ ? measure_and_encode(measure_options, triangles, show) : measure_all(measure_options, show));
    SortedPrimitives sorted = SCREE_TRY(sort_scattered(scene_, report_.output, memory_, measure_options, options_.stop,
                                                       progress_, times_, measurement_));
    report_.sorted_triangles = sorted.triangles;
    report_.sort_file_bytes = sorted.file_bytes;
    sorted_ = std::move(sorted.copies);
    return {};
  }

  /// Reads the measurement from the shards.
  Result<void> take_measured() {
    SCREE_TRY(check_shards(*shards_, scene_));
    measurement_ = std::move(shards_->plan.measurement);
    for (const uint32_t primitive : shards_->plan.sorted) {
      sorted_.emplace(primitive, scene_.primitives[primitive]);
      report_.sorted_triangles += scene_.primitives[primitive].triangle_count();
    }
    return {};
  }

  /// Records the plan for the shard before equal meshes are joined, because merging joins them itself.
  void note_plan() {
    ShardPlan plan;
    plan.count = options_.shards;
    plan.options = options_;
    plan.files = stamp_files(options_.input, files_);
    plan.measurement = measurement_;
    for (const auto& [primitive, copy] : sorted_) plan.sorted.push_back(primitive);
    plan.images = images_;
    shard_plan_ = pack_plan(plan);
  }

  /// Keeps only this shard's share of the images and windows. Returns the state in which encoding them begins.
  EncodeStart cut_shard() {
    shard_share_.index = options_.shard;
    shard_share_.input = whole_path(options_.input).string();
    keep_share(options_.shard, options_.shards, images_);
    EncodeStart start;
    start.triangle = keep_share(options_.shard, options_.shards, measurement_.windows);
    if (start.triangle > 0) start.mesh = mesh_of_[measurement_.windows.front().primitive];
    return start;
  }

  /// Adds the plan and this shard's share, which merging reads, and finishes the file.
  Result<void> finish_shard() {
    SCREE_TRY(append_shard_pages(shard_plan_, shard_share_, *writer_));
    format::TableSet tables;
    tables.source = tables_.source;
    tables.strings = tables_.strings;
    report_.output_bytes = SCREE_TRY(writer_->finish(tables));
    fill_report();
    return {};
  }

  /// Writes the encoded windows of the shards.
  Result<void> place_shards() {
    uint64_t triangles = 0, done = 0;
    for (const WindowPlan& window : measurement_.windows) triangles += window.count;
    progress_.stage("merge", triangles);
    report_.threads = report_.threads_asked;
    WorkerPool pool(report_.threads_asked, options_.stop);
    MergePass pass(pool, *writer_, options_.zstd_level, times_);
    const Result<void> merged = merge_windows(*shards_, measurement_.windows, mesh_of_, tables_.meshes, pass,
                                              [&](const WindowPlan& window, const WindowOutcome& outcome) {
                                                note_window(outcome, mesh_of_[window.primitive]);
                                                done += window.count;
                                                progress_.update(done, writer_->bytes());
                                                return tools::check_stop(options_.stop);
                                              });
    report_.rates = rates();
    return merged;
  }

  /// Checks all tables of the merged file: shards come from outside, and not all of their numbers have a check of their
  /// own.
  Result<void> check_merged(const std::string& part) const {
    const auto map = SCREE_TRY(runtime::MappedFile::open(part));
    SCREE_TRY_AT(report_.output + ": its shards give no valid file", format::Container::open(map.bytes()));
    return {};
  }

  Result<void> measure_all(const MeasureOptions& options, const std::function<void(uint64_t)>& show) {
    WorkerPool pool(memory_.measure().threads, options_.stop);
    measurement_ =
        SCREE_TRY(measure(scene_, wanted_, options, {pool, times_, show, read_ahead_bytes(options_.memory)}));
    return {};
  }

  /// Measures everything, and encodes as many windows as possible meanwhile.
  Result<void> measure_and_encode(const MeasureOptions& options, uint64_t triangles,
                                  const std::function<void(uint64_t)>& show) {
    progress_.stage("encode", triangles);
    report_.threads = ahead_->threads;
    WorkerPool pool(ahead_->threads, options_.stop);
    EncodeAhead ahead(options_, scene_, pool, *writer_, *ahead_, times_, [&](uint64_t done) {
      progress_.update(done, writer_->bytes(), [&] { return describe(rates()); });
    });
    bool is_alone = false;
    const auto show_alone = [&](uint64_t done) {
      if (ahead.is_stopped() && !std::exchange(is_alone, true)) progress_.stage("measure", triangles);
      if (is_alone) show(done);
    };
    measurement_ = SCREE_TRY(
        measure(scene_, wanted_, options, {pool, times_, show_alone, read_ahead_bytes(options_.memory), &ahead}));
    EncodeAhead::Written written = SCREE_TRY(ahead.finish());
    resumed_.windows = std::move(written.windows);
    resumed_.whole_windows = resumed_.windows.size();
    open_page_ = std::move(written.page);
    report_.windows_ahead = written.before;
    report_.windows_guessed = written.guessed;
    report_.windows_discarded = written.discarded;
    return {};
  }

  /// Prepares encoding of meshes before all are measured, if the document alone suffices for that. It does not with
  /// --grid scene and --max-error-pixels, where a mesh depends on others, nor with --resume, which first checks that
  /// the input is unchanged. It is not done either if there is a .part of an earlier run: that file is replaced only
  /// after the input was checked, because --resume could continue it. If a step fails, no state has changed, and the
  /// error occurs again after measuring.
  void prepare_ahead() {
    const std::optional<std::vector<bool>> used = materials_known(scene_, wanted_, options_.drop_nonfinite);
    std::error_code ignored;
    const bool is_other_part = std::filesystem::exists(report_.output + ".part", ignored);
    if (options_.resume || options_.shards > 0 || is_other_part || options_.grid != Grid::kMesh ||
        options_.pixel_bound.pixels > 0 || !used || !memory_.ahead())
      return;
    if (const Result<void> planned = plan_images(*used); planned) {
      Result<format::ContainerWriter> writer = create_writer(most_bytes(most_geometry_bytes(scene_, wanted_, memory_)));
      if (writer && store_images(*writer)) ahead_ = memory_.ahead();  // after the images, whose memory is free again
      if (ahead_) {
        writer_ = std::move(*writer);
        written_before_ = writer_->bytes();
      }
    }
    if (!ahead_) {
      images_ = {};
      return;
    }
    if (options_.share) merged_ = merge_materials(scene_, *used, images_.places, masks_);
  }

  /// The primitive of a window: its sorted copy if there is one.
  const Primitive& primitive_of(const WindowPlan& window) const {
    const auto sorted = sorted_.find(window.primitive);
    return sorted == sorted_.end() ? scene_.primitives[window.primitive] : sorted->second;
  }

  /// An estimate for the progress line: reading advances about evenly with the triangles.
  uint64_t bytes_read(uint64_t done, uint64_t total) const {
    const double share = total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 0;
    return static_cast<uint64_t>(share * static_cast<double>(scene_.buffer_bytes));
  }

  /// Adds groups, and a mesh for every primitive that keeps a triangle.
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
    const PlannedMesh mesh =
        plan_mesh(options_, scene_, primitive, measurement_.primitives[primitive], sorted_.contains(primitive));
    mesh_of_[primitive] = static_cast<uint32_t>(tables_.meshes.size());
    tables_.meshes.push_back(mesh.record);  // plan_materials() renumbers its material
    plans_.push_back(mesh.plan);
  }

  std::vector<bool> materials_used() const { return convert::materials_used(scene_, measurement_.primitives); }

  /// The options of a pass over images or masks, with its limit of memory, and its number of threads.
  std::pair<ImageOptions, uint32_t> image_stage() const {
    ImageOptions options = options_.images;
    const StageLimits limits = memory_.images(options.memory);
    options.memory = limits.flight_bytes;
    return {options, limits.threads};
  }

  /// Plans the images of the primitives that are kept.
  Result<void> plan_images(const std::vector<bool>& used) {
    const MaterialUse use = find_material_use(scene_, used);
    std::vector<bool> wanted(scene_.images.size());
    for (size_t i = 0; i < wanted.size(); ++i) wanted[i] = use.images[i] != kNone;
    const auto [image_options, threads] = image_stage();
    WorkerPool pool(threads, options_.stop);
    const auto count = static_cast<uint64_t>(std::count(wanted.begin(), wanted.end(), true));
    if (shards_ != nullptr) {
      images_ = std::move(shards_->plan.images);
      for (size_t i = 0; i < wanted.size(); ++i)
        if (wanted[i] != (images_.places[i] != kNone))
          return fail(ErrorCode::kFormat, shards_->files.front().map.path(), ": image ", i,
                      " is not used as in the source");
    } else {
      if (count > 0) progress_.stage("check images", count, "images");
      Result<ImagePlan> images = check_images(scene_, wanted, image_options, pool,
                                              [&](uint64_t done, uint64_t bytes) { progress_.update(done, bytes); });
      if (!images) return images.error();
      images_ = std::move(*images);
    }
    for (size_t i = 0; i < images_.records.size(); ++i)
      images_.records[i].name = tables_.strings.add(scene_.images[images_.sources[i]].name);
    return {};
  }

  Result<void> store_images(format::ContainerWriter& writer) {
    const auto [image_options, threads] = image_stage();
    if (shards_ != nullptr) resumed_.images = SCREE_TRY(append_images(*shards_, images_.records.size(), writer));
    shard_share_.images = resumed_.images;
    WorkerPool pool(threads, options_.stop);
    const uint64_t before = resumed_.images.size(), count = images_.records.size();
    if (count > before) progress_.stage("store images", count - before, "images");
    return write_images(scene_, image_options, images_, pool, writer, resumed_.images,
                        [&](uint64_t number, const StoredImageRecord& stored) {
                          log_image(writer, number, stored);
                          if (options_.shards > 0) shard_share_.images.push_back(stored);
                          progress_.update(number + 1 - before, writer.bytes());
                        });
  }

  /// Masks are written after the geometry, so --resume makes them again; keeping them would save little.
  Result<void> store_masks(format::ContainerWriter& writer) {
    const auto [image_options, threads] = image_stage();
    WorkerPool pool(threads, options_.stop);
    const MaterialUse use = find_material_use(scene_, materials_used());
    return write_masks(scene_, masks_, use.materials, image_options, options_.zstd_level, pool, writer, tables_);
  }

  void merge_equal() {
    if (options_.share && !ahead_) merged_ = merge_materials(scene_, materials_used(), images_.places, masks_);
    first_equal_ = find_equal_groups(scene_, measurement_);
    for (SourceNode& node : scene_.nodes)
      if (node.group != kNone) node.group = first_equal_[node.group];
    std::erase_if(measurement_.windows, [&](const WindowPlan& window) { return is_repeat(window.primitive); });
  }

  /// Whether a primitive belongs to a glTF mesh that repeats an earlier one, which is stored in its place.
  bool is_repeat(size_t primitive) const {
    const uint32_t group = scene_.primitives[primitive].group;
    return first_equal_[group] != group;
  }

  /// Plans the materials and textures of the meshes that are kept.
  void plan_materials() {
    const MaterialUse use = find_material_use(scene_, materials_used());
    for (format::MeshRecord& mesh : tables_.meshes)
      if (mesh.material != kNone) mesh.material = use.materials[mesh.material];
    add_materials(scene_, use, images_.places, tables_);
  }

  /// A new writer, or one that continues the .part of an earlier run.
  Result<format::ContainerWriter> open_writer() {
    if (options_.resume) {
      const format::PartId id = make_part_id();
      const std::string part = report_.output + ".part";
      std::error_code ignored;
      const bool is_there = std::filesystem::exists(part, ignored);
      progress_.stage("check " + part, 0);
      Result<format::ContainerWriter> writer = format::ContainerWriter::resume(
          report_.output, id,
          [&](uint32_t kind, std::span<const std::byte> entry) { read_entry(kind, entry, resumed_); },
          options_.existing);
      if (!writer && writer.error().code != ErrorCode::kFormat) return writer;
      if (writer && !is_of_this_input(resumed_))
        writer = Error{ErrorCode::kFormat, "it was made from another input or with other options"};
      if (writer) {
        drop_incomplete_tail(resumed_, writer->page_count(), images_.records.size(), measurement_.windows.size());
        writer->drop_pages(resumed_.pages);
        report_.resumed_pages = resumed_.pages;
      }
      if (is_there && resumed_.pages == 0)
        report_.warnings.push_back(part +
                                   ": starts afresh: " + (writer ? "it has no whole page" : writer.error().message));
      if (writer) return writer;
      resumed_ = {};
    }
    return create_writer(most_bytes(most_geometry_bytes(options_, measurement_.windows, plans_, mesh_of_)));
  }

  Result<format::ContainerWriter> create_writer(uint64_t bytes) {
    format::ContainerWriter writer = SCREE_TRY(format::ContainerWriter::create(report_.output, options_.existing));
    if (options_.resume) writer.keep_part();
    writer.keep_log(make_part_id(), bytes);
    return writer;
  }

  format::PartId make_part_id() const {
    std::string options = describe_options(options_);
    if (options_.shards > 0)
      options += " --shard " + std::to_string(options_.shard + 1) + "/" + std::to_string(options_.shards);
    return part_id(options, files_, images_);
  }

  /// Whether the logged windows of an earlier run equal the windows that were measured now.
  bool is_of_this_input(const Resumed& resumed) const {
    for (size_t i = 0; i < std::min(resumed.windows.size(), measurement_.windows.size()); ++i) {
      const WindowPlan& window = measurement_.windows[i];
      const uint32_t mesh = mesh_of_[window.primitive];
      if (resumed.windows[i].made_from != window_id(window, mesh, tables_.meshes[mesh])) return false;
    }
    return resumed.windows.size() <= measurement_.windows.size();
  }

  /// Upper bound of the size of the finished file. `geometry`: of its geometry.
  uint64_t most_bytes(uint64_t geometry) const {
    return most_file_bytes(geometry, scene_, images_, masks_.bytes(), tables_.strings.bytes().size());
  }

  /// `start`: the state before the first window, if none is in the file.
  Result<void> encode(format::ContainerWriter& writer, EncodeStart start) {
    const std::vector<WindowPlan>& windows = measurement_.windows;
    for (uint64_t i = 0; i < resumed_.whole_windows; ++i)
      note_window(resumed_.windows[i], mesh_of_[windows[i].primitive]);
    resumed_.windows.erase(resumed_.windows.begin(),
                           resumed_.windows.begin() + static_cast<ptrdiff_t>(resumed_.whole_windows));
    start.page = std::move(open_page_);
    start.window = resumed_.whole_windows;
    if (start.window > 0) {
      const format::ChunkRecord& last = tables_.chunks.back();
      start.mesh = last.mesh;
      start.triangle = last.first_triangle + last.triangle_count;
    }
    if (resumed_.chunks_of_next > 0) {
      start.placed = std::move(resumed_.windows.front().chunks);
      start.placed.resize(resumed_.chunks_of_next);
    }
    const std::vector<Batch> batches = make_batches(windows, start.window);
    const StageLimits limits = memory_.encode(windows);
    if (!batches.empty() || !ahead_) report_.threads = std::max(report_.threads, limits.threads);
    if (!batches.empty()) {
      uint64_t source_triangles = 0;
      for (const Batch& batch : batches) source_triangles += batch.triangles;
      progress_.stage("encode", source_triangles);
    }

    WorkerPool pool(limits.threads, options_.stop);
    std::vector<EncodeScratch> scratch(pool.threads());
    EncodePass pass(options_, scene_, pool, scratch, writer,
                    {kEncodeJobsPerThread * pool.threads(), limits.flight_bytes}, times_, std::move(start));
    const uint64_t done_before = times_.encoded_triangles;
    uint64_t number = resumed_.whole_windows;
    const auto take_one = [&]() -> Result<void> {
      std::vector<EncodedWindow> encoded = SCREE_TRY(pass.next());
      const std::vector<WindowOutcome> placed = SCREE_TRY(pass.place(std::move(encoded)));
      for (const WindowOutcome& outcome : placed) note_window(outcome, mesh_of_[windows[number++].primitive]);
      progress_.update(times_.encoded_triangles - done_before, writer.bytes(), [&] { return describe(rates()); });
      return {};
    };
    for (const Batch& batch : batches) {
      std::vector<EncodeItem> items;
      for (uint64_t i = batch.first; i < batch.first + batch.count; ++i) {
        const uint32_t mesh = mesh_of_[windows[i].primitive];
        items.push_back({windows[i], &primitive_of(windows[i]), &plans_[mesh], &tables_.meshes[mesh], mesh, nullptr});
      }
      while (!pass.has_room(items)) SCREE_TRY(take_one());
      pass.submit(std::move(items));
    }
    while (pass.in_flight() > 0) SCREE_TRY(take_one());
    const Result<void> finished = pass.finish();
    report_.rates = rates();
    return finished;
  }

  StageRates rates() const {
    const ReadTotals read = read_totals();
    return times_.rates({read.bytes - read_before_.bytes, read.seconds - read_before_.seconds},
                        writer_->bytes() - written_before_, report_.threads);
  }

  void note_window(const WindowOutcome& window, uint32_t mesh) {
    if (options_.shards > 0) shard_share_.windows.push_back(window);
    format::MeshRecord& record = tables_.meshes[mesh];
    if (record.chunk_count == 0) record.first_chunk = tables_.chunks.size();
    record.max_uv_error = std::max(record.max_uv_error, window.uv_error);
    for (size_t i = 0; i < window.chunks.size(); ++i) {
      const format::ChunkRecord& chunk = window.chunks[i];
      if (bounds_error(options_)) report_.positions.add(record, record.chunk_count == 0, chunk, window.saved[i]);
      record.vertex_count += chunk.vertex_count;
      ++record.chunk_count;
      tables_.chunks.push_back(chunk);
    }
    const double diagonal = diagonal_of(plans_[mesh].box);
    if (diagonal > 0)
      report_.relative_position_error = std::max(report_.relative_position_error, window.position_error / diagonal);
    encoded_.add(window);
  }

  void add_source_record() {
    format::SourceRecord& source = tables_.source;
    source.json_bytes = scene_.json_bytes;
    source.buffer_bytes = scene_.buffer_bytes;
    source.file_bytes = report_.input_bytes;
    add_source_bytes(scene_, mesh_of_, source);
    source.name = tables_.strings.add(scene_.file_name);
    source.options = tables_.strings.add(describe_options(options_));
    source.generator = tables_.strings.add("scree " SCREE_VERSION);
    source.copyright = tables_.strings.add(scene_.copyright);
  }

  void list_left_out() {
    const LeftOutFacts facts = {scene_,
                                plans_,
                                mesh_of_,
                                measurement_.primitives,
                                first_equal_,
                                images_,
                                merged_,
                                encoded_,
                                options_.normals,
                                undrawn_,
                                report_.dropped_degenerate,
                                report_.dropped_nonfinite,
                                clear_};
    add_left_out(facts, tables_);
    const std::vector<std::string> warnings = left_out_warnings(facts);
    report_.warnings.insert(report_.warnings.end(), warnings.begin(), warnings.end());
    if (tables_.meshes.empty()) report_.warnings.push_back(scene_.file_name + ": there is nothing to draw");
  }

  void fill_report() {
    report_.position_error = encoded_.position_error;
    report_.windows = measurement_.windows.size();
    report_.left_out = lost_parts(tables_);
    add_results(tables_, *writer_, report_);
  }

  const ConvertOptions& options_;
  SourceScene& scene_;
  const std::set<std::string>& files_;
  ShardSet* shards_;
  tools::Progress& progress_;
  ConvertReport& report_;
  std::optional<AheadLimits> ahead_;  // set if meshes are encoded before all are measured
  Resumed resumed_;  // the windows and images in the file before encode(): of an earlier run, or encoded ahead
  GeometryWriter::OpenPage open_page_;             // the page after them
  std::optional<format::ContainerWriter> writer_;  // once it is open
  StageTimes times_;
  ReadTotals read_before_;
  uint64_t written_before_ = 0;  // bytes of images and of an earlier run
  std::vector<bool> wanted_;     // by primitive: whether a node draws it
  MaskPlan masks_;
  MemoryPlan memory_;
  Measurement measurement_;
  std::map<uint32_t, Primitive> sorted_;  // copies of primitives without locality
  MergedMaterials merged_;
  std::vector<uint32_t> first_equal_;  // by group: the first equal group, which is stored
  std::vector<MeshPlan> plans_;        // by mesh of tables_
  std::vector<uint32_t> mesh_of_;      // by primitive: its mesh, or kNone
  ImagePlan images_;
  InstancePlan instances_;
  format::TableSet tables_;
  std::vector<std::byte> shard_plan_;  // ShardPlan of the shard that is being made
  ShardShare shard_share_;
  uint64_t undrawn_ = 0;
  uint64_t clear_ = 0;  // primitives whose alpha mask hides all of them
  EncodedFacts encoded_;
};

}  // namespace

Result<void> run_conversion(const ConvertOptions& options, SourceScene& scene, const std::set<std::string>& files,
                            ShardSet* shards, tools::Progress& progress, ConvertReport& report) {
  return Converter(options, scene, files, shards, progress, report).run();
}

}  // namespace scree::convert
