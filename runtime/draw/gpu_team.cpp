#include "runtime/draw/gpu_team.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <new>
#include <span>
#include <string>
#include <utility>

#include "kernels/shade/pixels.h"
#include "runtime/draw/device_list.h"
#include "runtime/scene/pages.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::FrameStats;

namespace {

static_assert(kMostGpus <= kernels::kMostBuffers);

/// How long a thread waits for the next frame, or for the other GPUs, before it sleeps.
constexpr std::chrono::microseconds kSpin{1000};

std::string gpu_name(int gpu) {
  return "GPU " + std::to_string(gpu);
}

void add(UploadCounts& sum, const UploadCounts& one) {
  sum.pages += one.pages;
  sum.stored_bytes += one.stored_bytes;
  sum.unpacked_bytes += one.unpacked_bytes;
  sum.copied_bytes += one.copied_bytes;
  sum.direct_bytes += one.direct_bytes;
  sum.joined_pages += one.joined_pages;
}

}  // namespace

bool GpuTeam::fits(const Scene& scene, uint32_t gpus, const Options& options) {
  const std::vector<uint32_t> owners = owners_of_pages(scene.drawn_pages(), gpus);
  for (uint32_t i = 0; i < gpus; ++i) {
    const PageShare share{owners, i};
    const uint64_t beside = i == 0 ? options.beside : options.beside_others;
    if (CudaScene::device_bytes(scene, nullptr, options.texture_cache, &share) + beside > options.budget) return false;
  }
  return true;
}

GpuTeam::~GpuTeam() {
  const KeptGpu kept;
  for (Member& member : members_) {
    (void)make_current(member);
    member.frames.reset();
    member.scene = CudaScene();
  }
}

Result<void> GpuTeam::make_current(const Member& member) const {
  return cuda_check(cudaSetDevice(member.gpu), "choosing the GPU");
}

/// Lets every GPU read and write the memory of all others.
Result<void> GpuTeam::connect() const {
  for (const Member& from : members_) {
    SCREE_TRY(make_current(from));
    for (const Member& to : members_) {
      if (to.gpu == from.gpu) continue;
      int can = 0;
      SCREE_TRY(cuda_check(cudaDeviceCanAccessPeer(&can, from.gpu, to.gpu), "asking for peer access"));
      if (can == 0)
        return Error{ErrorCode::kDevice, gpu_name(from.gpu) + " cannot read the memory of " + gpu_name(to.gpu) +
                                             " (no peer access), so they cannot draw one scene together"};
      const cudaError_t status = cudaDeviceEnablePeerAccess(to.gpu, 0);
      if (status == cudaErrorPeerAccessAlreadyEnabled) {
        (void)cudaGetLastError();
        continue;
      }
      SCREE_TRY(cuda_check(status, "enabling peer access"));
    }
  }
  return {};
}

Result<CudaScene> GpuTeam::open(const Scene& scene, std::span<const int> gpus, const Options& options) {
  const auto start = std::chrono::steady_clock::now();
  const KeptGpu kept;
  members_.resize(gpus.size());
  for (size_t i = 0; i < gpus.size(); ++i) members_[i].gpu = gpus[i];
  buffers_.count = size();
  draw_ms_.resize(size());
  workers_.emplace(size(), kSpin);
  if (workers_->start() != size()) return Error{ErrorCode::kMemory, "the system starts no thread for each GPU"};
  SCREE_TRY(connect());

  const std::vector<uint32_t> owners = owners_of_pages(scene.drawn_pages(), size());
  const uint32_t threads = std::max(options.threads / size(), 1u);
  const uint64_t host_memory = options.host_memory / size();
  std::vector<CudaScene> scenes(size());
  std::vector<Result<void>> uploaded(size());
  workers_->for_each(size(), [&](uint64_t i) {
    uploaded[i] = make_current(members_[i]);
    if (!uploaded[i]) return;
    const Result<uint64_t> budget = device_budget(options.budget);
    if (!budget) {
      uploaded[i] = budget.error();
      return;
    }
    const PageShare share{owners, static_cast<uint32_t>(i)};
    const uint64_t beside = i == 0 ? options.beside : options.beside_others;
    const uint64_t whole = CudaScene::device_bytes(scene, nullptr, options.texture_cache) + beside;
    const uint64_t more = DeviceBlockPager::more_room(scene, *budget - std::min(*budget, whole));
    Result<CudaScene> made =
        CudaScene::upload(scene, options.budget, beside, threads, options.reading, options.texture_cache, nullptr,
                          host_memory, i == 0 ? options.progress : nullptr, &share, more);
    if (!made) {
      uploaded[i] = made.error();
      return;
    }
    scenes[i] = std::move(*made);
    uploaded[i] = scenes[i].keep_textures(scene, DeviceBlockPager::most_kept_bytes(scene, host_memory));
  });
  for (uint32_t i = 0; i < size(); ++i) {
    if (!uploaded[i]) {
      Error failed = uploaded[i].error();
      if (failed.code == ErrorCode::kDevice) failed.message = gpu_name(gpus[i]) + ": " + failed.message;
      return failed;
    }
    add(stats_.counts, scenes[i].stats().counts);
  }

  divides_picture_ = true;
  for (uint32_t i = 0; i < size() && divides_picture_; ++i) {
    SCREE_TRY(make_current(members_[i]));
    const uint64_t free = SCREE_TRY(device_budget(0));
    const uint64_t copied = scenes[i].copied_bytes_of(scenes);
    const uint64_t beside = i == 0 ? options.beside : options.beside_others;
    divides_picture_ =
        copied + beside <= free && (options.budget == 0 || scenes[i].stats().device_bytes + copied <= options.budget);
  }
  for (uint32_t i = 0; i < size(); ++i) {
    Member& member = members_[i];
    SCREE_TRY(make_current(member));
    if (divides_picture_) SCREE_TRY(scenes[i].copy_pages_of(scenes));
    stats_.device_bytes += scenes[i].stats().device_bytes;
    for (kernels::DeviceEvent* const event : {&member.drawn, &member.joined, &member.shaded_part})
      SCREE_TRY(event->make(cudaEventDisableTiming));
    member.frames = SCREE_TRY(kernels::CudaFrames::create(scene.view(), scenes[i].view(), options.queues));
    if (!divides_picture_) SCREE_TRY(scenes[i].add_pages_of(scenes));
    member.shaded = scenes[i].view();
    member.textures = scenes[i].texture_cache();
    member.pager = scenes[i].block_pager();
  }
  SCREE_TRY(make_current(members_[0]));
  CudaScene first = std::move(scenes[0]);
  for (uint32_t i = 1; i < size(); ++i) members_[i].scene = std::move(scenes[i]);
  stats_.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return Result<CudaScene>(std::move(first));
}

/// Makes buffers_ large enough for the frame.
Result<void> GpuTeam::reserve(const kernels::View& view, uint64_t* samples) {
  buffers_.of[0] = samples;
  for (uint32_t i = 1; i < size(); ++i) {
    Member& member = members_[i];
    SCREE_TRY(make_current(member));
    SCREE_TRY(member.samples.reserve(uint64_t{view.width} * view.height * sizeof(uint64_t),
                                     "allocating the visibility buffer"));
    buffers_.of[i] = reinterpret_cast<uint64_t*>(member.samples.data());
  }
  return {};
}

/// Queues work on the stream of GPU `index`: once all GPUs have drawn, it joins its own part of all buffers, and then
/// waits for the other parts. Called by a thread per GPU; each thread waits until all have recorded the events that its
/// GPU waits for.
Result<void> GpuTeam::join(size_t index, uint64_t count, cudaStream_t stream, std::barrier<>& threads) {
  const auto meet = [&](kernels::DeviceEvent Member::*event) -> Result<void> {
    SCREE_TRY(cuda_check(cudaEventRecord(members_[index].*event, stream), "recording an event"));
    threads.arrive_and_wait();
    for (size_t i = 0; i < members_.size(); ++i)
      if (i != index) SCREE_TRY(cuda_check(cudaStreamWaitEvent(stream, members_[i].*event, 0), "ordering the GPUs"));
    return {};
  };
  const uint64_t part = (count + size() - 1) / size();
  SCREE_TRY(meet(&Member::drawn));
  SCREE_TRY(kernels::start_least_samples(buffers_, std::min(index * part, count), std::min((index + 1) * part, count),
                                         stream));
  return meet(&Member::joined);
}

/// Draws the frame on a GPU, by a thread per GPU at the same time.
Result<kernels::CudaFrames::Finished> GpuTeam::draw_share(size_t index, const kernels::View& view,
                                                          std::barrier<>& threads) {
  struct Leave {
    std::barrier<>& threads;
    ~Leave() { threads.arrive_and_drop(); }
  };
  const Leave at_end{threads};  // also after an error, so that no thread waits for this one
  const std::function<Result<void>(void*)> join_on = [&](void* stream) {
    return join(index, uint64_t{view.width} * view.height, static_cast<cudaStream_t>(stream), threads);
  };
  kernels::DrawOptions options;
  options.join = &join_on;
  kernels::CudaFrames& frames = *members_[index].frames;
  SCREE_TRY(make_current(members_[index]));
  SCREE_TRY(frames.start(view, buffers_.of[index], options));
  return frames.finish();
}

/// Draws a GPU's rows, by a thread per GPU at the same time.
Result<kernels::CudaFrames::Finished> GpuTeam::draw_rows(size_t index, const kernels::View& view) {
  Member& member = members_[index];
  kernels::DrawOptions options;
  options.rows = shares_.rows(index);
  if (options.rows.is_empty()) return kernels::CudaFrames::Finished{};
  SCREE_TRY(make_current(member));
  SCREE_TRY(member.frames->start(view, buffers_.of[index], options));
  kernels::FrameTimes times{};
  Result<kernels::CudaFrames::Finished> drawn = member.frames->finish(&times);
  draw_ms_[index] = times.raster_ms;
  if (drawn) drawn->is_drawn_again = false;  // it is whole
  return drawn;
}

/// Copies the other GPUs' rows of the last picture to a GPU's samples, unless it has them. Waits.
Result<void> GpuTeam::gather_at(size_t index) {
  Member& member = members_[index];
  if (!divides_picture_ || member.has_all_rows) return {};
  constexpr const char* kWhat = "copying other GPUs' samples";
  const KeptGpu kept;
  SCREE_TRY(make_current(member));
  for (size_t i = 0; i < members_.size(); ++i) {
    if (i == index || shares_.rows(i).is_empty()) continue;
    const uint64_t first = uint64_t{shares_.rows(i).first} * width_, end = uint64_t{shares_.rows(i).end} * width_;
    SCREE_TRY(cuda_check(cudaMemcpyAsync(buffers_.of[index] + first, buffers_.of[i] + first,
                                         (end - first) * sizeof(uint64_t), cudaMemcpyDefault, nullptr),
                         kWhat));
  }
  SCREE_TRY(cuda_check(cudaStreamSynchronize(nullptr), kWhat));
  member.has_all_rows = true;
  return {};
}

Result<kernels::CudaFrames::Finished> GpuTeam::draw_once(const kernels::View& view) {
  using Finished = kernels::CudaFrames::Finished;
  std::vector<Result<Finished>> drawn(size(), Finished{});
  std::atomic<bool> has_memory = true;
  std::barrier threads(size());
  workers_->for_each(size(), [&](uint64_t i) {
    try {
      drawn[i] = divides_picture_ ? draw_rows(i, view) : draw_share(i, view, threads);
    } catch (const std::bad_alloc&) {  // would end the loop before each GPU has a thread, which the others wait for
      has_memory = false;
    }
  });
  if (!has_memory) throw std::bad_alloc();
  Finished sum{};
  for (size_t i = 0; i < drawn.size(); ++i) {
    if (!drawn[i]) return drawn[i].error();
    if (i != 0) drawn[i]->stats.instances_drawn = 0;  // every GPU finds the same instances
    sum.stats += drawn[i]->stats;
    sum.is_drawn_again |= drawn[i]->is_drawn_again;
  }
  return sum;
}

Result<FrameStats> GpuTeam::draw(const kernels::View& view, uint64_t* samples) {
  const KeptGpu kept;
  SCREE_TRY(kernels::check_frame(view, 0));
  const Result<void> reserved = reserve(view, samples);
  if (divides_picture_) shares_.divide(view.height, draw_ms_);
  width_ = view.width;
  for (Member& member : members_) member.has_all_rows = false;
  for (;;) {
    const Result<kernels::CudaFrames::Finished> drawn =
        reserved ? draw_once(view) : Result<kernels::CudaFrames::Finished>(reserved.error());
    if (!drawn) wait_for_all();
    if (!drawn) return drawn.error();
    if (drawn->is_drawn_again) continue;
    const Result<void> back = make_current(members_[0]);
    return back ? drawn->stats : Result<FrameStats>(back.error());
  }
}

/// After an error, so that no GPU writes to memory that the caller frees.
void GpuTeam::wait_for_all() const {
  for (const Member& member : members_)
    if (make_current(member)) (void)cudaDeviceSynchronize();
}

Result<void> GpuTeam::resolve(const kernels::View& view, uint32_t samples_per_side,
                              const kernels::ShadeOptions& options, uint32_t* pixels, kernels::ResolveTimes* times) {
  const auto start = std::chrono::steady_clock::now();
  const KeptGpu kept;
  Result<void> done = start_resolve(view, samples_per_side, options, pixels, times);
  if (done && times != nullptr) {
    done = cuda_check(cudaStreamSynchronize(nullptr), "resolving");
    const std::chrono::duration<float, std::milli> taken = std::chrono::steady_clock::now() - start;
    times->resolve_ms = taken.count() - times->occlusion_ms;
  }
  if (!done) wait_for_all();
  return done;
}

/// The rows of pixels that GPU `index` shades, in `out`.
std::span<const kernels::RowRange> GpuTeam::shaded_rows(uint32_t index, uint32_t height, uint32_t samples_per_side,
                                                        std::span<kernels::RowRange, kBandsPerGpu> out) const {
  size_t count = 0;
  const auto add = [&](uint32_t first, uint32_t end) {
    if (first < end) out[count++] = {first, end};
  };
  if (divides_picture_) {
    add(shares_.rows(index).first / samples_per_side, shares_.rows(index).end / samples_per_side);
  } else {
    const uint32_t bands = size() * kBandsPerGpu;
    const uint32_t band = ((height - 1) / (bands * kernels::kPixelTileHeight) + 1) * kernels::kPixelTileHeight;
    for (uint32_t first = index * band; first < height; first += size() * band)
      add(first, std::min(first + band, height));
  }
  return out.first(count);
}

/// Shades a GPU's rows, by a thread per GPU at the same time, because rounds of shading wait.
Result<void> GpuTeam::shade_rows(uint32_t index, const kernels::View& view, uint32_t samples_per_side,
                                 const kernels::ShadeOptions& options, uint32_t* pixels, kernels::ResolveTimes* times) {
  Member& member = members_[index];
  kernels::RowRange room[kBandsPerGpu];
  const std::span<const kernels::RowRange> rows =
      shaded_rows(index, view.height / samples_per_side, samples_per_side, room);
  if (rows.empty()) return {};
  SCREE_TRY(make_current(member));
  if (member.pager != nullptr) SCREE_TRY(member.pager->settle());
  if (index != 0) SCREE_TRY(cuda_check(cudaStreamWaitEvent(nullptr, members_[0].shaded_part, 0), "ordering the GPUs"));
  SCREE_TRY(member.resolver.resolve(member.shaded, view, samples_per_side, buffers_.of[index],
                                    member.frames->transforms(), options, pixels, nullptr, times, member.textures,
                                    rows));
  return index == 0 ? Result<void>() : cuda_check(cudaEventRecord(member.shaded_part, nullptr), "recording an event");
}

/// The other GPUs wait for the first one's earlier work with `pixels`, and its later work waits for them.
Result<void> GpuTeam::start_resolve(const kernels::View& view, uint32_t samples_per_side,
                                    const kernels::ShadeOptions& options, uint32_t* pixels,
                                    kernels::ResolveTimes* times) {
  // Other pictures need no rows of other GPUs.
  if (options.ssao || options.edl || options.show == kernels::Show::kDepth)
    for (uint32_t i = 0; i < size(); ++i) SCREE_TRY(gather_at(i));
  SCREE_TRY(make_current(members_[0]));
  SCREE_TRY(cuda_check(cudaEventRecord(members_[0].shaded_part, nullptr), "recording an event"));
  std::vector<Result<void>> shaded(size());
  workers_->for_each(size(), [&](uint64_t i) {
    shaded[i] = shade_rows(static_cast<uint32_t>(i), view, samples_per_side, options, pixels, i == 0 ? times : nullptr);
  });
  for (const Result<void>& each : shaded) SCREE_TRY(each);
  SCREE_TRY(make_current(members_[0]));
  for (uint32_t i = 1; i < size(); ++i)
    SCREE_TRY(cuda_check(cudaStreamWaitEvent(nullptr, members_[i].shaded_part, 0), "ordering the GPUs"));
  return {};
}

}  // namespace scree::runtime
