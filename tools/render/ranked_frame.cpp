#include "tools/render/ranked_frame.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "kernels/frame_parts.h"
#include "runtime/draw/linear_picture.h"
#include "runtime/draw/shadow_map.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/options.h"
#include "tools/common/process/sigbus.h"

namespace scree::tools {

using runtime::Stopwatch;

namespace {

/// Whether `options` request layers of surfaces.
bool reads_surfaces(const RenderOptions& options) {
  return !options.normals.empty() || !options.uvs.empty() ||
         (options.writes_exr() && (options.layers.normal || options.layers.uv));
}

/// Whether the root makes outputs from samples in host memory, even if GPUs draw and shade.
bool reads_samples(const RenderOptions& options) {
  return !options.visbuffer.empty() || !options.picks.empty() || layers_need_samples(options);
}

}  // namespace

Result<void> RankedFrame::open(uint64_t frames) {
  const Stopwatch watch;
  starts_next_ = frames > 1;
  SCREE_TRY(ranks_.agree(choose_gpu()));
  const uint64_t samples = uint64_t{width()} * height() * options_.samples_per_side * options_.samples_per_side;
  SCREE_TRY(ranks_.agree(links_.begin(ranks_, gpu_, options_.exchange, samples, frames)));
  SCREE_TRY(ranks_.agree(load_tables()));
  const Stopwatch connect_watch;
  SCREE_TRY(ranks_.agree(links_.finish(ranks_, options_.exchange, options_.quiet)));
  times_.connect = connect_watch.elapsed().wall_ms;
  SCREE_TRY(ranks_.agree(load_pages()));
  times_.load = watch.elapsed().wall_ms;
  return {};
}

Result<void> RankedFrame::choose_gpu() {
  BackendOptions backend = options_.backend;
  backend.device = gpu_of_rank(backend, ranks_.rank_on_host());
  Result<std::optional<runtime::Gpu>> gpu = tools::choose_gpu("render", backend, options_.quiet || !ranks_.is_first());
  if (!gpu) return at(options_.file, with_cpu_advice(gpu.error()));
  gpu_ = std::move(*gpu);
  return {};
}

Result<void> RankedFrame::load_tables() {
  report_sigbus("render", options_.file);
  runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(options_.file));
  const uint32_t index = SCREE_TRY(file.find_scene(options_.scene));
  runtime::SceneOptions load = options_.scene_options();
  load.pages = false;
  runtime::Scene scene = SCREE_TRY(runtime::Scene::load(std::move(file), index, load));
  scene_.emplace(std::move(scene));
  const bool is_quiet = options_.quiet || !ranks_.is_first();
  SCREE_TRY(accept_scene("render", *scene_, options_.light, is_quiet));
  if (options_.exchange == Exchange::kNccl && kernels::shows_layers(scene_->view(), options_.shade))
    return Error{ErrorCode::kUsage, "--exchange nccl: " + options_.file +
                                        " has blended surfaces, whose layers the CPUs draw and exchange"};
  // A default view of a small scene is fitted to its vertices, so every rank then reads all pages.
  if (!options_.path && runtime::view_reads_vertices(scene_->view(), options_.camera))
    SCREE_TRY(scene_->load_pages(options_.threads));
  scene_view_ = scene_->view();
  pages_.assign(scene_->container().pages().size(), nullptr);
  scene_view_.pages = pages_.data();
  shade_ = options_.shade;
  const runtime::DrawnPages& drawn = scene_->drawn_pages();
  owners_ = runtime::owners_of_pages(drawn, ranks_.count());
  for (uint64_t i = 0; i < drawn.size(); ++i)
    if (owners_[i] == ranks_.rank()) own_bytes_ += static_cast<double>(drawn.record(i).stored_bytes);
  return {};
}

/// The CPU draws layers of blended surfaces, and makes normals and texture coordinates.
Result<void> RankedFrame::load_pages() {
  SCREE_TRY(upload());
  if (device_ && !reads_surfaces(options_) && !kernels::shows_layers(scene_view_, options_.shade)) return {};
  return load_own_pages();
}

/// Uploads this rank's pages to its GPU, if it has one.
Result<void> RankedFrame::upload() {
  if (!gpu_) return {};
  runtime::PictureNeeds pictures{width(), height(), options_.samples_per_side,
                                 options_.output.empty() ? nullptr : &options_.shade};
  pictures.shadow_side = options_.light.shadow_side;
  pictures.starts_next = starts_next_;
  const runtime::PageShare share{owners_, ranks_.rank()};
  Result<runtime::DeviceScene> uploaded = runtime::DeviceScene::upload(
      *scene_, options_.device_memory, options_.threads, options_.reading, options_.textures.device_cache(),
      options_.host_memory, pictures, nullptr, 1, false, &share);
  if (!uploaded && uploaded.error().code != ErrorCode::kDevice) return uploaded.error();
  if (!uploaded) return falls_back(uploaded.error());
  device_ = std::move(*uploaded);
  Result<runtime::DeviceView> view = device_->add_view(*scene_);  // the first view, which the device has already
  if (!view) return view.error();
  on_gpu_ = std::move(*view);
  return {};
}

/// After an error of the GPU: with --backend auto the CPU does the rest, unless GPUs of other ranks wait for this one.
Result<void> RankedFrame::falls_back(const Error& error) {
  if (error.code != ErrorCode::kDevice || options_.backend.choice != BackendChoice::kAuto || joins_ != 0)
    return at(options_.file, with_cpu_advice(error));
  SCREE_TRY(end_reads());  // of a frame that is not drawn again
  if (!options_.quiet) warn_of_cpu("render", ranks_.named(error).message);
  sun_on_gpu_.reset();
  on_gpu_.reset();
  device_.reset();
  return {};
}

template <class OnGpu, class OnCpu>
Result<void> RankedFrame::on_gpu_or_cpu(const OnGpu& on_gpu, const OnCpu& on_cpu) {
  if (device_) {
    const Result<void> done = on_gpu();
    if (done) return done;
    SCREE_TRY(falls_back(done.error()));
    SCREE_TRY(load_own_pages());
  }
  return on_cpu();
}

Result<void> RankedFrame::load_own_pages() {
  if (!unpacked_.empty()) return {};
  const runtime::DrawnPages& drawn = scene_->drawn_pages();
  const format::Container& container = scene_->container();
  unpacked_.resize(drawn.size());
  runtime::FirstError failure;
  runtime::parallel_for(drawn.size(), options_.threads, [&](uint64_t i) {
    if (owners_[i] != ranks_.rank() || failure.is_superseded(i)) return;
    const auto raw = container.load_page(drawn.page(i), unpacked_[i]);
    if (!raw) return failure.report(i, raw.error());
    if (const Result<void> checked = drawn.check(i, *raw); !checked) return failure.report(i, checked.error());
    pages_[drawn.page(i)] = raw->data();
  });
  return failure.any() ? Result<void>(at(options_.file, failure.error())) : Result<void>();
}

kernels::View RankedFrame::in_samples(kernels::View view) const {
  view.width *= options_.samples_per_side;
  view.height *= options_.samples_per_side;
  return view;
}

Result<void> RankedFrame::draw(const kernels::View& view, uint32_t root, const std::optional<kernels::View>& next) {
  root_ = root;
  view_ = in_samples(view);
  next_ = next ? std::optional(in_samples(*next)) : std::nullopt;
  const Stopwatch watch;
  const Result<void> drawn = draw_part();
  times_.draw = watch.elapsed().wall_ms;
  SCREE_TRY(ranks_.agree(drawn));
  return join();
}

/// Sets sun_, and shade_.sun if the frame has its shadows.
void RankedFrame::place_sun() {
  shade_.sun = nullptr;
  if (options_.light.shadow_side == 0) return;
  const std::optional<kernels::SunShadow> sun =
      runtime::sun_of(scene_->view(), scene_->box(), view_, options_.light.shadow_side);
  if (!sun) return;
  sun_ = *sun;
  shade_.sun = &sun_;
}

/// Whether this rank can exchange the frame by NCCL.
bool RankedFrame::takes_nccl() const {
  return links_.group() != nullptr && device_ && !kernels::shows_layers(scene_view_, options_.shade);
}

/// Fills samples_, and shadows_ if the frame has shadows. If this rank can use NCCL, they stay on its GPU.
Result<void> RankedFrame::draw_part() {
  place_sun();
  const Result<void> drawn = on_gpu_or_cpu([&] { return draw_on_gpu(); }, [&] { return draw_on_cpu(); });
  return drawn ? check_unchanged(scene_->file().map()) : drawn;
}

Result<void> RankedFrame::draw_on_cpu() {
  const auto draw = [&](const kernels::View& view, std::vector<uint64_t>& samples) -> Result<void> {
    samples.assign(uint64_t{view.width} * view.height, kernels::kBackground);
    const auto drawn = kernels::draw_part_cpu(scene_view_, view, samples, options_.threads);
    return drawn ? Result<void>() : at(options_.file, drawn.error());
  };
  SCREE_TRY(draw(view_, samples_));
  for (uint32_t i = 0; shade_.sun != nullptr && i < sun_.map_count; ++i)
    SCREE_TRY(draw(sun_.maps[i].view, shadows_[i]));
  return {};
}

Result<void> RankedFrame::draw_on_gpu() {
  if (shade_.sun != nullptr && !sun_on_gpu_) sun_on_gpu_ = SCREE_TRY(device_->add_view(*scene_));
  for (uint32_t i = 0; shade_.sun != nullptr && i < sun_.map_count; ++i) {
    SCREE_TRY(sun_on_gpu_->draw(sun_.maps[i].view));
    shadows_on_gpu_[i] = SCREE_TRY(sun_on_gpu_->keep_samples(i));
  }
  is_whole_ = false;
  if (on_gpu_->has_started()) {
    const bool is_first = SCREE_TRY(on_gpu_->finish());
    is_whole_ = is_first && joins_ == 1;
  } else {
    SCREE_TRY(on_gpu_->draw(view_));
  }
  if (takes_nccl()) return {};
  (void)start_next(false);  // an error occurs again when that frame is drawn
  return read_samples();
}

/// The GPU begins to draw its part of the next frame. `by_nccl`: all ranks do so. After pass 1 it then gets the depths
/// of all ranks, and pass 2 skips clusters that another rank's surfaces hide.
Result<void> RankedFrame::start_next(bool by_nccl) {
  joins_ = 0;
  if (!next_) return {};
  if (!by_nccl) return on_gpu_->start(*next_);
  return on_gpu_->start(*next_, [this](uint64_t* samples, void* stream) {
    const uint64_t count = uint64_t{next_->width} * next_->height;
    return ++joins_ == 1 ? links_.group()->least(samples, count, stream) : Result<void>();
  });
}

/// Copies the samples from the GPU.
Result<void> RankedFrame::read_samples() {
  samples_.resize(uint64_t{view_.width} * view_.height);
  SCREE_TRY(on_gpu_->read_samples(samples_));
  for (uint32_t i = 0; shade_.sun != nullptr && i < sun_.map_count; ++i) {
    shadows_[i].resize(uint64_t{sun_.maps[i].view.width} * sun_.maps[i].view.height);
    SCREE_TRY(sun_on_gpu_->read(shadows_on_gpu_[i], std::as_writable_bytes(std::span(shadows_[i]))));
  }
  return {};
}

/// Joins the samples of all ranks. GPUs that do so by NCCL begin the next frame meanwhile.
Result<void> RankedFrame::join() {
  enum Way : uint64_t { kByMpi, kByNccl, kIsWhole };
  uint64_t way = !takes_nccl() ? kByMpi : is_whole_ ? kIsWhole : kByNccl;
  Result<void> done = ranks_.least(std::span(&way, 1));
  is_by_nccl_ = way != kByMpi;
  if (is_by_nccl_) {
    if (done) done = join_by_nccl(way == kIsWhole);
  } else {
    if (takes_nccl()) (void)start_next(false);
    const Stopwatch watch;
    if (takes_nccl() && done) done = read_samples();
    if (done) done = ranks_.least(samples_);
    for (uint32_t i = 0; done && shade_.sun != nullptr && i < sun_.map_count; ++i) done = ranks_.least(shadows_[i]);
    times_.exchange = watch.elapsed().wall_ms;
  }
  const bool reads = is_by_nccl_ && (reads_surfaces(options_) || (is_root() && reads_samples(options_)));
  if (done && reads) done = read_samples();
  return done ? done : at(options_.file, done.error());
}

/// `is_whole`: all ranks have the picture's samples already.
Result<void> RankedFrame::join_by_nccl(bool is_whole) {
  runtime::NcclGroup& group = *links_.group();
  void* const stream = on_gpu_->stream();
  const auto join = [&](uint64_t* samples, const kernels::View& view) {
    return group.least(samples, uint64_t{view.width} * view.height, stream);
  };
  uint64_t* const samples = SCREE_TRY(on_gpu_->samples());
  // NCCL exchanges in this order, so these run beside pass 1 of the next frame.
  Result<void> done = is_whole ? Result<void>() : join(samples, view_);
  for (uint32_t i = 0; done && shade_.sun != nullptr && i < sun_.map_count; ++i)
    done = join(shadows_on_gpu_[i], sun_.maps[i].view);
  if (done) done = start_next(true);
  const Stopwatch watch;
  if (done) done = group.wait(stream);
  times_.exchange = watch.elapsed().wall_ms;
  return done;
}

Result<void> RankedFrame::shade() {
  const bool has_colors = options_.writes_exr() ? options_.layers.color : !options_.output.empty();
  if (!has_colors || !kernels::shades_from_chunks(options_.shade.show)) return {};
  if (is_by_nccl_) {
    const Result<void> done = shade_by_nccl();
    return done ? done : at(options_.file, done.error());
  }
  const Stopwatch watch;
  const Result<void> shaded = on_gpu_or_cpu([&] { return shade_on_gpu(); }, [&] { return shade_on_cpu(); });
  if (!shaded) return shaded;
  SCREE_TRY(check_unchanged(scene_->file().map()));
  times_.shade = watch.elapsed().wall_ms;
  const Stopwatch gather_watch;
  const Result<void> gathered = ranks_.gather(std::span(colors_), root_);
  times_.exchange += gather_watch.elapsed().wall_ms;
  if (!gathered || !kernels::shows_layers(scene_view_, options_.shade)) return gathered;
  return draw_layers();
}

/// Makes shading on this host read shadows_.
void RankedFrame::read_shadows_on_host() {
  for (uint32_t i = 0; i < sun_.map_count; ++i) sun_.maps[i].samples = shadows_[i].data();
}

Result<void> RankedFrame::shade_on_cpu() {
  colors_.assign(3 * samples_.size(), 0.0f);
  read_shadows_on_host();
  const auto shaded = kernels::shade_part_cpu(scene_view_, view_, samples_, shade_, colors_, options_.threads);
  return shaded ? shaded : at(options_.file, shaded.error());
}

Result<void> RankedFrame::shade_on_gpu() {
  colors_.resize(3 * samples_.size());
  for (uint32_t i = 0; shade_.sun != nullptr && i < sun_.map_count; ++i) {
    SCREE_TRY(sun_on_gpu_->write(shadows_on_gpu_[i], std::as_bytes(std::span(shadows_[i]))));
  }
  SCREE_TRY(on_gpu_->write_samples(samples_));
  const Result<float*> colors = make_colors_on_gpu();
  return colors ? on_gpu_->read(*colors, std::as_writable_bytes(std::span(colors_))) : colors.error();
}

/// The colours of this rank's samples, in the GPU's memory.
Result<float*> RankedFrame::make_colors_on_gpu() {
  for (uint32_t i = 0; i < sun_.map_count; ++i) sun_.maps[i].samples = shadows_on_gpu_[i];
  return on_gpu_->make_colors(view_, shade_);
}

/// As shade(), with all words in the memory of the GPUs. If a pixel is one sample, the ranks exchange pixels, which
/// take a third of the bytes of colours. For a sample of another rank, a rank makes a black pixel with the alpha that
/// the owner's pixel has. No word with this alpha is less, so the greatest of all ranks' words is the owner's.
Result<void> RankedFrame::shade_by_nccl() {
  runtime::NcclGroup& group = *links_.group();
  const bool are_pixels = options_.samples_per_side == 1 && !options_.writes_exr();
  const Stopwatch watch;
  float* const colors = SCREE_TRY(make_colors_on_gpu());
  Result<uint32_t*> pixels = nullptr;
  if (are_pixels) pixels = on_gpu_->resolve_colors(view_, 1, shade_);
  void* const stream = on_gpu_->stream();
  Result<void> done = pixels ? group.wait(stream) : pixels.error();
  times_.shade = watch.elapsed().wall_ms;
  const Stopwatch gather_watch;
  const uint64_t samples = uint64_t{view_.width} * view_.height;
  if (done)
    done = are_pixels ? group.most(*pixels, samples, root_, stream)
                      : group.most(reinterpret_cast<uint32_t*>(colors), 3 * samples, root_, stream);
  if (done) done = group.wait(stream);
  times_.exchange += gather_watch.elapsed().wall_ms;
  if (!done || !is_root()) return done;
  const Stopwatch read_watch;
  if (options_.writes_exr()) {
    colors_.resize(3 * samples);
    done = on_gpu_->read(colors, std::as_writable_bytes(std::span(colors_)));
  } else if (!are_pixels) {
    pixels = on_gpu_->resolve_colors(view_, options_.samples_per_side, shade_);
    if (!pixels) return pixels.error();
  }
  pixels_ = *pixels;
  times_.shade += read_watch.elapsed().wall_ms;
  return done;
}

/// Fills over_ at the root. Every rank draws and shades its own part of each layer.
Result<void> RankedFrame::draw_layers() {
  const kernels::SceneView blended = kernels::blended_view(scene_view_);
  const kernels::LayerSource source{
      [&](const kernels::BlendTargets& at, const uint64_t* peeled) -> Result<void> {
        const Result<void> drawn = kernels::draw_layer_cpu(blended, view_, at, peeled, options_.threads);
        const Result<void> joined = ranks_.least({at.drawn, at.sample_count});
        return drawn ? joined : drawn;
      },
      [&](const kernels::BlendTargets& at) -> Result<void> {
        std::fill_n(at.colors, 3 * uint64_t{at.sample_count}, 0.0f);
        std::fill_n(at.alphas, at.sample_count, -1.0f);
        const Result<void> shaded = kernels::shade_layer_cpu(blended, view_, at, at.layer, shade_, options_.threads);
        // All ranks need the alphas, so that they end a sample's layers at the same layer.
        std::vector<uint64_t> alphas(at.sample_count);
        for (size_t i = 0; i < alphas.size(); ++i)
          alphas[i] = at.alphas[i] >= 0 ? std::bit_cast<uint32_t>(at.alphas[i]) : UINT64_MAX;
        const Result<void> joined = ranks_.least(alphas);
        for (size_t i = 0; i < alphas.size(); ++i)
          at.alphas[i] = std::bit_cast<float>(static_cast<uint32_t>(alphas[i]));
        const Result<void> gathered = ranks_.gather(std::span(at.colors, 3 * uint64_t{at.sample_count}), root_);
        if (!shaded) return shaded;
        return joined ? gathered : joined;
      }};
  read_shadows_on_host();
  over_ = SCREE_TRY_AT(options_.file, kernels::blend_cpu(view_, samples_, options_.shade.blend_layers, source,
                                                         options_.threads, blended_));
  return {};
}

Result<FrameLayers> RankedFrame::layers() {
  Result<FrameLayers> made = make_layers(
      options_, *scene_, [&](runtime::Layer layer, std::span<std::byte> out) { return read(layer, out); }, false);
  if (!made) return at(options_.file, made.error());
  return made;
}

/// The values of a layer, complete at the root. Normals and texture coordinates are made by the owners of the pages.
Result<void> RankedFrame::read(runtime::Layer layer, std::span<std::byte> out) {
  if (layer == runtime::Layer::kLinear)
    return is_root() ? read_linear({reinterpret_cast<float*>(out.data()), out.size() / sizeof(float)}) : Result<void>();
  const auto make = [&](runtime::Layer of, std::span<const uint64_t> samples, std::byte* values) {
    return kernels::layers_cpu(scene_view_, view_, options_.samples_per_side, samples, runtime::target_of(of, values),
                               options_.threads);
  };
  if (layer != runtime::Layer::kNormal && layer != runtime::Layer::kUv) {
    if (!is_root()) {
      std::fill(out.begin(), out.end(), std::byte{0xff});  // the background's ids; this rank may have no samples
      return {};
    }
    if (!is_by_nccl_) return make(layer, samples_, out.data());
    const Result<const std::byte*> made = on_gpu_->make_layer(view_, options_.samples_per_side, layer);
    return made ? on_gpu_->read(*made, out) : made.error();
  }
  std::vector<int64_t> triangles(uint64_t{width()} * height());
  SCREE_TRY(make(runtime::Layer::kTriangle, samples_, reinterpret_cast<std::byte*>(triangles.data())));
  // If another rank has the triangle of a pixel, the pixel becomes background here. Values of the background are 0.
  const uint64_t side = options_.samples_per_side;
  std::vector<uint64_t> own = samples_;
  runtime::parallel_for(height(), options_.threads, [&](uint64_t y) {
    for (uint64_t x = 0; x < width(); ++x) {
      const int64_t triangle = triangles[y * width() + x];
      if (triangle < 0 || has_page_of(static_cast<uint64_t>(triangle))) continue;
      for (uint64_t j = 0; j < side; ++j)
        std::fill_n(own.begin() + static_cast<ptrdiff_t>((y * side + j) * view_.width + x * side), side,
                    kernels::kBackground);
    }
  });
  SCREE_TRY(make(layer, own, out.data()));
  SCREE_TRY(check_unchanged(scene_->file().map()));
  return ranks_.gather({reinterpret_cast<float*>(out.data()), out.size() / sizeof(float)}, root_);
}

bool RankedFrame::has_page_of(uint64_t triangle) const {
  return pages_[scene_view_.chunks[kernels::find_triangle(scene_view_, triangle).chunk].page] != nullptr;
}

/// As runtime::linear_picture(), from the colours of all ranks.
Result<void> RankedFrame::read_linear(std::span<float> out) {
  runtime::PictureLight light =
      runtime::light_of_cpu(scene_view_, view_, options_.samples_per_side, samples_, shade_, options_.threads);
  light.colors = [&](std::span<float> colors) -> Result<void> {
    std::copy(colors_.begin(), colors_.end(), colors.begin());
    return {};
  };
  light.over = [&](std::vector<float>& over, kernels::BlendCounts&) -> Result<void> {
    over = over_;
    return {};
  };
  kernels::BlendCounts blended;
  return runtime::linear_picture(scene_view_, view_, options_.samples_per_side, samples_, shade_, options_.threads,
                                 light, out, blended);
}

Result<void> RankedFrame::read_picture(std::span<uint32_t> rgba) {
  const Stopwatch watch;
  const uint32_t side = options_.samples_per_side;
  const std::span<uint8_t> bytes(reinterpret_cast<uint8_t*>(rgba.data()), rgba.size_bytes());
  const bool is_shaded = kernels::shades_from_chunks(options_.shade.show);
  Result<void> done;
  if (is_by_nccl_) {
    if (!is_shaded) done = on_gpu_->resolve(view_, side, shade_, {});
    if (done) done = on_gpu_->read_later(is_shaded ? pixels_ : on_gpu_->pixels(), std::as_writable_bytes(rgba));
  } else {
    done = is_shaded
               ? kernels::resolve_colors_cpu(view_, side, samples_, colors_, over_, options_.shade, 4, bytes,
                                             options_.threads)
               : kernels::resolve_cpu(scene_view_, view_, side, samples_, options_.shade, 4, bytes, options_.threads);
  }
  times_.shade += watch.elapsed().wall_ms;
  return done ? done : at(options_.file, done.error());
}

Result<void> RankedFrame::read_depth(std::span<std::byte> out) {
  if (!is_by_nccl_) return read(runtime::Layer::kDepth, out);
  const Result<const std::byte*> made = on_gpu_->make_layer(view_, options_.samples_per_side, runtime::Layer::kDepth);
  const Result<void> queued = made ? on_gpu_->read_later(*made, out) : made.error();
  return queued ? queued : at(options_.file, queued.error());
}

Result<void> RankedFrame::end_reads() {
  const Result<void> done = on_gpu_ ? on_gpu_->end_reads() : Result<void>();
  return done ? done : at(options_.file, done.error());
}

}  // namespace scree::tools
