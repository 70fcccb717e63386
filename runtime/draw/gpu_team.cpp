#include "runtime/draw/gpu_team.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "runtime/draw/device_list.h"
#include "runtime/scene/pages.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::FramePart;
using kernels::FrameStats;

namespace {

static_assert(kMostGpus <= kernels::kMostBuffers);

std::string gpu_name(int gpu) {
  return "GPU " + std::to_string(gpu);
}

void add(UploadCounts& sum, const UploadCounts& one) {
  sum.pages += one.pages;
  sum.stored_bytes += one.stored_bytes;
  sum.unpacked_bytes += one.unpacked_bytes;
  sum.copied_bytes += one.copied_bytes;
  sum.direct_bytes += one.direct_bytes;
}

}  // namespace

GpuTeam::~GpuTeam() {
  const KeptGpu kept;
  for (Member& member : members_) {
    (void)make_current(member);
    member.frames.reset();
    if (member.joined != nullptr) (void)cudaEventDestroy(member.joined);
  }
}

Result<void> GpuTeam::make_current(const Member& member) const {
  return cuda_check(cudaSetDevice(member.gpu), "choosing the GPU");
}

/// Lets every GPU read and write the memory of all others.
Result<void> GpuTeam::connect() const {
  for (const Member& from : members_) {
    if (Result<void> done = make_current(from); !done) return done;
    for (const Member& to : members_) {
      if (to.gpu == from.gpu) continue;
      int can = 0;
      if (Result<void> done = cuda_check(cudaDeviceCanAccessPeer(&can, from.gpu, to.gpu), "asking for peer access");
          !done)
        return done;
      if (can == 0)
        return Error{ErrorCode::kDevice, gpu_name(from.gpu) + " cannot read the memory of " + gpu_name(to.gpu) +
                                             " (no peer access), so they cannot draw one scene together"};
      const cudaError_t status = cudaDeviceEnablePeerAccess(to.gpu, 0);
      if (status == cudaErrorPeerAccessAlreadyEnabled) {
        (void)cudaGetLastError();
        continue;
      }
      if (Result<void> done = cuda_check(status, "enabling peer access"); !done) return done;
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
  workers_.emplace(size());
  if (const Result<void> connected = connect(); !connected) return connected.error();

  const std::vector<uint32_t> owners = owners_of_pages(scene.drawn_pages(), size());
  const uint32_t threads = std::max(options.threads / size(), 1u);
  const uint64_t host_memory = options.host_memory / size();
  std::vector<CudaScene> scenes(size());
  std::vector<Result<void>> uploaded(size());
  workers_->for_each(size(), [&](uint64_t i) {
    uploaded[i] = make_current(members_[i]);
    if (!uploaded[i]) return;
    const PageShare share{owners, static_cast<uint32_t>(i)};
    Result<CudaScene> made = CudaScene::upload(scene, options.budget, i == 0 ? options.beside : options.beside_others,
                                               threads, options.reading, options.texture_cache, nullptr, host_memory,
                                               i == 0 ? options.progress : nullptr, &share);
    if (made)
      scenes[i] = std::move(*made);
    else
      uploaded[i] = made.error();
  });
  for (uint32_t i = 0; i < size(); ++i) {
    if (!uploaded[i]) {
      Error failed = uploaded[i].error();
      if (failed.code == ErrorCode::kDevice) failed.message = gpu_name(gpus[i]) + ": " + failed.message;
      return failed;
    }
    add(stats_.counts, scenes[i].stats().counts);
    stats_.device_bytes += scenes[i].stats().device_bytes;
  }

  for (uint32_t i = 0; i < size(); ++i) {
    Member& member = members_[i];
    Result<void> done = make_current(member);
    if (done) done = cuda_check(cudaEventCreateWithFlags(&member.joined, cudaEventDisableTiming), "making an event");
    if (!done) return done.error();
    Result<kernels::CudaFrames> frames = kernels::CudaFrames::create(scene.view(), scenes[i].view(), options.queues);
    if (!frames) return frames.error();
    member.frames = std::move(*frames);
  }
  if (const Result<void> done = make_current(members_[0]); !done) return done.error();
  CudaScene first = std::move(scenes[0]);
  if (const Result<void> done = first.add_pages_of(std::span(scenes).subspan(1)); !done) return done.error();
  for (uint32_t i = 1; i < size(); ++i) members_[i].scene = std::move(scenes[i]);
  stats_.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return Result<CudaScene>(std::move(first));
}

/// Makes buffers_ large enough for the frame, and clears them.
Result<void> GpuTeam::start_frame(const kernels::View& view, uint64_t* samples) {
  const uint64_t bytes = uint64_t{view.width} * view.height * sizeof(uint64_t);
  for (uint32_t i = 0; i < size(); ++i) {
    Member& member = members_[i];
    Result<void> done = make_current(member);
    if (done && i != 0) done = member.samples.reserve(bytes, "allocating the visibility buffer");
    buffers_.of[i] = i == 0 ? samples : reinterpret_cast<uint64_t*>(member.samples.data());
    static_assert(kernels::kBackground == ~uint64_t{0});
    if (done) done = cuda_check(cudaMemsetAsync(buffers_.of[i], 0xff, bytes, nullptr), "clearing");
    if (!done) return done;
  }
  return {};
}

/// Each GPU joins its own part of all buffers. Work that is queued on a default stream afterwards runs on the joined
/// words.
Result<void> GpuTeam::join(uint64_t count) {
  const uint64_t part = (count + size() - 1) / size();
  for (uint32_t i = 0; i < size(); ++i) {
    Result<void> done = make_current(members_[i]);
    if (done)
      done =
          kernels::start_least_samples(buffers_, std::min(i * part, count), std::min((i + 1) * part, count), nullptr);
    if (done) done = cuda_check(cudaEventRecord(members_[i].joined, nullptr), "recording an event");
    if (!done) return done;
  }
  for (const Member& waiting : members_) {
    Result<void> done = make_current(waiting);
    for (const Member& other : members_)
      if (done && other.gpu != waiting.gpu)
        done = cuda_check(cudaStreamWaitEvent(nullptr, other.joined, 0), "ordering the GPUs");
    if (!done) return done;
  }
  return {};
}

/// Draws a part on all GPUs at the same time. The GPUs are idle when it returns, also after an error.
Result<FrameStats> GpuTeam::draw_part(const kernels::View& view, FramePart part) {
  std::vector<Result<FrameStats>> drawn(size(), FrameStats{});
  workers_->for_each(size(), [&](uint64_t i) {
    kernels::DrawOptions options;
    options.part = part;
    const Result<void> current = make_current(members_[i]);
    drawn[i] = current ? members_[i].frames->draw(view, buffers_.of[i], options) : Result<FrameStats>(current.error());
  });
  FrameStats sum{};
  for (size_t i = 0; i < drawn.size(); ++i) {
    if (!drawn[i]) return drawn[i].error();
    if (i != 0) drawn[i]->instances_drawn = 0;  // every GPU finds the same ones
    sum += *drawn[i];
  }
  return sum;
}

Result<FrameStats> GpuTeam::draw(const kernels::View& view, uint64_t* samples) {
  const KeptGpu kept;
  Result<void> done = start_frame(view, samples);
  FrameStats sum{};
  for (const FramePart part : {FramePart::kPreviouslyVisible, FramePart::kRest}) {
    const Result<FrameStats> drawn = done ? draw_part(view, part) : Result<FrameStats>(done.error());
    done = drawn ? join(uint64_t{view.width} * view.height) : Result<void>(drawn.error());
    if (drawn) sum += *drawn;
  }
  for (const Member& member : members_)
    if (done) done = cuda_check(cudaEventSynchronize(member.joined), "joining the samples of several GPUs");
  if (done) return sum;
  for (const Member& member : members_)
    if (make_current(member)) (void)cudaDeviceSynchronize();
  return done.error();
}

}  // namespace scree::runtime
