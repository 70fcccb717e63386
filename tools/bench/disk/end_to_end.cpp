#include "tools/bench/disk/end_to_end.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <new>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/renderer.h"
#include "runtime/draw/stream_cpu.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"
#include "tools/bench/setup/file_views.h"
#include "tools/bench/setup/machine.h"
#include "tools/bench/setup/packed_file.h"
#include "tools/bench/setup/timed_frames.h"
#include "tools/bench/setup/work_folder.h"
#include "tools/common/memory_use.h"
#include "tools/common/sigbus.h"
#include "tools/convert/passes/source_files.h"
#include "tools/gltf/source.h"
#include "tools/synth/synth.h"

namespace scree::bench {
namespace {

using tools::format_bytes;

constexpr uint64_t kBudgetShare = 4;  // one of so many parts
constexpr ImageSize kFileImageSize{1920, 1080};

/// Nothing is written where it would not fit; what others write meanwhile nobody knows.
Result<void> check_room(const std::string& folder, uint64_t needed, const std::string& scene) {
  std::error_code failed;
  const std::filesystem::space_info space = std::filesystem::space(folder, failed);
  if (failed) return Error{ErrorCode::kFile, folder + ": " + failed.message()};
  if (space.available >= needed) return {};
  return Error{ErrorCode::kFile, folder + ": has " + format_bytes(space.available) + " free, but " + scene +
                                     " may take " + format_bytes(needed) +
                                     " there (--work names another folder, a smaller --scale needs less)"};
}

uint64_t wrong_samples(std::span<const uint64_t> samples, std::span<const uint64_t> expected) {
  uint64_t wrong = 0;
  for (size_t i = 0; i < expected.size(); ++i) wrong += samples[i] != expected[i];
  return wrong;
}

class EndToEnd {
 public:
  EndToEnd(const EndToEndOptions& options, bool gpu, Machine machine)
      : options_(options), gpu_(gpu), machine_(std::move(machine)) {
    row_.threads = options.threads;
    row_.memory = options.memory;
    row_.backend = gpu ? "cuda" : "cpu";
    row_.encoding = encoding_name(options.bench.encodings[0]);
  }

  Result<void> run() {
    Result<WorkFolder> folder = make_folder();
    if (!folder) return folder.error();
    const std::string gltf_folder = folder->file("gltf");
    const std::string packed = folder->file("packed.scree");
    Result<std::string> source = make_source(gltf_folder);
    if (!source) return source.error();
    if (const auto done = pack(*source, packed); !done) return done;
    if (const auto done = read_gltf_raw(); !done) return done;
    std::error_code ignored;
    std::filesystem::remove_all(gltf_folder, ignored);
    if (const auto done = write_raw_beside(folder->file("raw")); !done) return done;
    if (const auto done = load(packed); !done) return done;
    if (const auto done = draw(packed); !done) return done;
    std::printf("%s; commit %s; %u threads\n%s", machine_.gpu.c_str(), machine_.commit.c_str(), options_.threads,
                end_to_end_table(row_).c_str());
    if (!options_.bench.csv.empty()) {
      const CsvCells cells = end_to_end_cells(machine_, row_);
      if (const auto done = append_csv(options_.bench.csv, csv_columns(cells), csv_values(cells)); !done) return done;
    }
    if (!row_.streamed || row_.streamed->wrong_samples == 0) return {};
    return Error{ErrorCode::kRange, row_.scene + ": " + std::to_string(row_.streamed->wrong_samples) +
                                        " samples drawn from a part of its memory differ from those of all of it"};
  }

 private:
  bool is_synthetic() const { return options_.bench.files.empty(); }

  /// After there is known to be room in it.
  Result<WorkFolder> make_folder() {
    const Result<std::string> parent = options_.work.empty() ? WorkFolder::default_parent() : options_.work;
    if (!parent) return parent.error();
    uint64_t needed = 0;
    if (is_synthetic()) {
      scene_ = make_scene(options_.bench.scenes[0], options_.bench.order, options_.bench.scale);
      row_.scene = options_.bench.scenes[0];
      row_.scale = scene_scale(row_.scene, options_.bench.scale);
      synthetic_size_ = {scene_.width, scene_.height};
      needed = room_for(scene_);
    } else {
      row_.scene = file_name(options_.bench.files[0]);
      const Result<convert::SourceScene> source = convert::import_gltf(options_.bench.files[0], {});
      if (!source) return source.error();
      source_files_ = convert::source_files(options_.bench.files[0], *source);
      for (const std::string& file : source_files_) {
        std::error_code failed;
        const uint64_t bytes = std::filesystem::file_size(file, failed);
        if (!failed) needed += bytes;
      }
      needed += std::min(needed, kMostRawWriteBytes);
    }
    if (const auto fits = check_room(*parent, needed, row_.scene); !fits) return fits.error();
    return WorkFolder::make(*parent);
  }

  /// The glTF to pack.
  Result<std::string> make_source(const std::string& folder) {
    if (!is_synthetic()) return options_.bench.files[0];
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    if (failed) return Error{ErrorCode::kFile, folder + ": " + failed.message()};
    synth::SynthOptions synth;
    synth.scene = row_.scene;
    synth.output = folder + "/scene.gltf";
    synth.threads = options_.threads;
    synth.progress = true;
    if (const auto written = synth::write_scene(scene_, synth); !written) return written.error();
    scene_ = {};
    for (const auto& entry : std::filesystem::directory_iterator(folder, failed))
      source_files_.insert(entry.path().string());
    return synth.output;
  }

  Result<void> pack(const std::string& source, const std::string& packed) {
    convert::ConvertOptions convert = packing(source, packed, options_.bench.encodings[0], options_.threads);
    convert.memory = options_.memory;
    convert.progress = true;
    for (const std::string& file : source_files_) {
      const Result<double> share = drop_from_cache(file);
      if (!share) return share.error();
      row_.gltf_cached_share = std::max(row_.gltf_cached_share, *share);
    }
    tools::give_back_free_memory();
    tools::forget_peak();
    const Result<convert::ConvertReport> report = convert::convert(convert);
    if (!report) return report.error();
    row_.gltf_bytes = report->input_bytes;
    row_.unique_triangles = report->triangles;
    row_.drawn_triangles = report->triangles_drawn;
    row_.convert_s = report->seconds;
    row_.convert_work = convert::describe_work(*report);
    row_.peak_bytes = report->peak_bytes;
    row_.scree_bytes = report->output_bytes;
    row_.position_error = report->position_error;
    row_.position_bound = report->position_error_bound;
    return {};
  }

  /// After convert, so that no cache below the file system has the glTF for it.
  Result<void> read_gltf_raw() {
    std::string largest;
    uint64_t most_bytes = 0;
    for (const std::string& file : source_files_) {
      std::error_code failed;
      const uint64_t bytes = std::filesystem::file_size(file, failed);
      if (failed || bytes <= most_bytes) continue;
      most_bytes = bytes;
      largest = file;
    }
    RawReads disk;
    std::vector<std::string> notes;
    if (const auto read = disk.read(largest, notes); !read) return read;
    print_notes(notes);
    row_.gltf_raw_gb_per_s = disk.gb_per_s();
    return {};
  }

  /// No more than the .scree file has, which is room that the glTF took.
  Result<void> write_raw_beside(const std::string& path) {
    const Result<RawRate> raw = write_raw(path, row_.scree_bytes);
    if (!raw && raw.error().code != ErrorCode::kUnsupported) return raw.error();
    if (raw)
      row_.raw_write = *raw;
    else
      print_notes({raw.error().message});
    return {};
  }

  static void print_notes(const std::vector<std::string>& notes) {
    for (const std::string& note : notes) std::fprintf(stderr, "scree bench: %s\n", note.c_str());
  }

  Result<void> load(const std::string& packed) {
    tools::report_sigbus("bench", packed);
    LoadSettings settings;
    settings.threads = options_.threads;
    settings.size = image_size();
    if (!options_.bench.views.empty()) settings.view = options_.bench.views[0];
    std::vector<std::string> notes;
    const Result<std::vector<LoadRow>> rows =
        measure_loads(packed, {gpu_ ? LoadWay::kGpu : LoadWay::kMap}, false, options_.repeats, settings, notes);
    print_notes(notes);
    if (!rows) return rows.error();
    row_.load = rows->front();
    return {};
  }

  Result<void> draw(const std::string& packed) {
    std::vector<uint64_t> expected;
    Result<kernels::View> view = draw_resident(packed, expected);
    if (!view) return view.error();
    runtime::SceneOptions options;
    options.textures = false;
    options.threads = options_.threads;
    options.pages = false;
    Result<runtime::Scene> scene = runtime::Scene::open(packed, options);
    if (!scene) return scene.error();
    return gpu_ ? stream_on_gpu(*scene, *view, expected) : stream_on_cpu(*scene, *view, expected);
  }

  /// Times frames of the whole scene in memory; `samples`: the picture's.
  Result<kernels::View> draw_resident(const std::string& packed, std::vector<uint64_t>& samples) {
    runtime::SceneOptions options;
    options.textures = false;
    options.threads = options_.threads;
    options.pages = !gpu_;
    Result<runtime::Scene> scene = runtime::Scene::open(packed, options);
    if (!scene) return scene.error();
    row_.instances = scene->view().instance_count;
    std::optional<runtime::DeviceScene> device;
    if (gpu_) {
      Result<runtime::DeviceScene> uploaded = runtime::DeviceScene::upload(*scene, 0, options_.threads);
      if (!uploaded) return uploaded.error();
      device.emplace(std::move(*uploaded));
    }
    const Result<std::vector<NamedView>> views = file_views(*scene, packed, options_.bench.views, image_size());
    if (!views) return views.error();
    const kernels::View view = views->front().frames[0];
    row_.view = views->front().name;
    row_.size = image_size();
    samples.resize(uint64_t{view.width} * view.height);
    const auto times = timed_frames(options_.bench.frames, options_.bench.warmup, [&]() -> Result<float> {
      if (device) {
        kernels::FrameTimes ms{};
        const auto drawn = device->draw(view, &ms);
        return drawn ? Result<float>(ms.raster_ms) : drawn.error();
      }
      const runtime::Stopwatch watch;
      const auto drawn = kernels::draw_cpu(scene->view(), view, samples, options_.threads);
      return drawn ? Result<float>(static_cast<float>(watch.elapsed().wall_ms)) : drawn.error();
    });
    if (!times) return times.error();
    row_.resident = summarize(*times);
    row_.resident_frames = static_cast<uint32_t>(times->size());
    if (device)
      if (const auto read = device->read_samples(samples); !read) return read.error();
    return view;
  }

  Result<void> stream_on_cpu(const runtime::Scene& scene, const kernels::View& view,
                             std::span<const uint64_t> expected) {
    EndToEndRow::Streamed streamed;
    const std::vector<uint64_t> chunks = runtime::ChunkSource(scene).chunk_bytes();
    uint64_t largest = 0;
    for (const uint64_t bytes : chunks) {
      const uint64_t room = format::align_up(bytes, runtime::Residency::kAlignment);
      streamed.budget_bytes += room;
      largest = std::max(largest, room);
    }
    // A scene of a few chunks: less than one is no pool.
    streamed.budget_bytes = std::max(streamed.budget_bytes / kBudgetShare, largest);
    auto stream = runtime::CpuStream::create(scene, streamed.budget_bytes, options_.threads);
    if (!stream) return stream.error();
    return stream_frames(streamed, expected, [&](uint64_t& bytes, std::vector<uint64_t>* samples) -> Result<float> {
      const runtime::Stopwatch watch;
      const auto drawn = (*stream)->draw_frame(view, nullptr);
      if (!drawn) return drawn.error();
      const auto ms = static_cast<float>(watch.elapsed().wall_ms);
      bytes = drawn->streamed_bytes;
      if (samples != nullptr) samples->assign((*stream)->samples().begin(), (*stream)->samples().end());
      return ms;
    });
  }

  Result<void> stream_on_gpu(const runtime::Scene& scene, const kernels::View& view,
                             std::span<const uint64_t> expected) {
    EndToEndRow::Streamed streamed;
    streamed.budget_bytes = row_.load.last.device_bytes / kBudgetShare;
    const Result<double> link = measure_link();
    if (!link) return link.error();
    streamed.link_gb_per_s = *link;
    auto device = runtime::DeviceScene::upload(scene, streamed.budget_bytes, options_.threads);
    if (!device && device.error().code != ErrorCode::kDevice) return device.error();
    if (!device) {
      row_.not_streamed = device.error().message;
      return {};
    }
    return stream_frames(streamed, expected, [&](uint64_t& bytes, std::vector<uint64_t>* samples) -> Result<float> {
      const runtime::Stopwatch watch;
      const auto drawn = device->draw(view);
      if (!drawn) return drawn.error();
      const auto ms = static_cast<float>(watch.elapsed().wall_ms);
      if (device->stream_stats()) bytes = device->stream_stats()->streamed_bytes;
      if (samples != nullptr)
        if (const auto read = device->read_samples(*samples); !read) return read.error();
      return ms;
    });
  }

  /// `draw`: draws a frame, says how many bytes it loaded where that is known, copies its samples where they are asked
  /// for, and gives its ms.
  template <class Draw>
  Result<void> stream_frames(EndToEndRow::Streamed streamed, std::span<const uint64_t> expected, const Draw& draw) {
    std::vector<uint64_t> samples(expected.size());
    uint64_t bytes = kUnknown;
    const Result<float> first = draw(bytes, &samples);
    if (!first) return first.error();
    streamed.first_ms = *first;
    if (bytes != kUnknown) streamed.first_bytes = bytes;
    streamed.wrong_samples = wrong_samples(samples, expected);
    const auto times = timed_frames(options_.bench.frames, options_.bench.warmup, [&] { return draw(bytes, nullptr); });
    if (!times) return times.error();
    if (const Result<float> last = draw(bytes, &samples); !last) return last.error();
    streamed.wrong_samples += wrong_samples(samples, expected);
    if (bytes != kUnknown) streamed.then_bytes = bytes;
    streamed.then = summarize(*times);
    streamed.frames = static_cast<uint32_t>(times->size());
    row_.streamed = streamed;
    return {};
  }

  ImageSize image_size() const {
    if (options_.bench.size) return *options_.bench.size;
    return is_synthetic() ? synthetic_size_ : kFileImageSize;
  }

  static constexpr uint64_t kUnknown = ~uint64_t{0};

  const EndToEndOptions& options_;
  bool gpu_;
  Machine machine_;
  EndToEndRow row_;
  synth::Scene scene_;
  ImageSize synthetic_size_{};
  std::set<std::string> source_files_;
};

}  // namespace

uint64_t room_for(const synth::Scene& scene) {
  // Of the document a mesh and an instance take less than this each, and the packed file no more than the glTF.
  constexpr uint64_t kRecordBytes = 1024;
  uint64_t bytes = kRecordBytes * (scene.meshes.size() + scene.instances.size() + scene.cameras.size() + 8);
  for (const synth::MeshRecipe& mesh : scene.meshes)
    bytes += 12 * synth::vertex_count(mesh) + 12 * synth::triangle_count(mesh);
  return 2 * bytes;
}

Result<void> run_end_to_end(const EndToEndOptions& options) {
  const Result<std::optional<runtime::Gpu>> gpu = tools::choose_gpu("bench", options.backend);
  if (!gpu) return gpu.error();
  Result<Machine> machine = gpu->has_value() ? find_machine(**gpu) : Result<Machine>(cpu_machine());
  if (!machine) return machine.error();
  try {
    return EndToEnd(options, gpu->has_value(), std::move(*machine)).run();
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for the scene; a smaller --scale or --size needs less"};
  }
}

}  // namespace scree::bench
