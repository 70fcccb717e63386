// Frames on a GPU: the draw list's tables, the queues, and the order of the passes.
#include <algorithm>
#include <cstring>
#include <string>
#include <vector>

#include "kernels/cuda_check.h"
#include "kernels/cuda_large.cuh"
#include "kernels/cuda_small.cuh"
#include "kernels/frame_cuda.h"

#pragma nv_diag_suppress 2810  // nvcc 13 takes the assignment of a nodiscard class for an ignored result

namespace scree::kernels {
namespace {

/// Device memory for `count` values.
template <class T>
class DeviceArray {
 public:
  /// Loses what was there.
  Result<void> allocate(uint64_t count, const char* what) {
    count_ = 0;
    if (Result<void> done = buffer_.release("freeing device memory"); !done) return done;
    Result<DeviceBuffer> made = DeviceBuffer::allocate(max_of<uint64_t>(count, 1) * sizeof(T), what);
    if (!made) return made.error();
    buffer_ = std::move(*made);
    count_ = count;
    return {};
  }
  Result<void> fill(const std::vector<T>& values, const char* what) {
    if (Result<void> done = allocate(values.size(), what); !done || values.empty()) return done;
    return cuda_check(cudaMemcpy(data(), values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice), what);
  }
  T* data() const { return reinterpret_cast<T*>(buffer_.data()); }
  uint64_t count() const { return count_; }

 private:
  DeviceBuffer buffer_;
  uint64_t count_ = 0;
};

/// What a scene's draw list is made from, and what the passes have to be able to draw.
struct SceneTables {
  std::vector<uint32_t> order;
  std::vector<uint32_t> mesh_first;
  std::vector<Candidate> candidates;
  bool has_lattice = false;
  bool has_float32 = false;
  bool has_instances = false;  // a mesh is drawn more than once
};

/// Instances with triangles, and candidates, of each mesh. `count(mesh, instances)` for every mesh drawn.
template <class Count>
void for_each_drawn_mesh(const SceneView& scene, const std::vector<uint64_t>& instances, const Count& count) {
  for (uint64_t m = 0; m < scene.mesh_count; ++m) {
    if (instances[m] != 0) count(m, instances[m]);
  }
}

std::vector<uint64_t> instances_by_mesh(const SceneView& scene) {
  std::vector<uint64_t> count(scene.mesh_count);
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    const uint32_t mesh = scene.instances[i].mesh;
    if (scene.meshes[mesh].triangle_count != 0) ++count[mesh];
  }
  return count;
}

uint64_t candidate_count(const SceneView& scene, const std::vector<uint64_t>& instances) {
  uint64_t sum = 0;
  for_each_drawn_mesh(scene, instances, [&](uint64_t m, uint64_t count) {
    sum += (count + kGroupInstances - 1) / kGroupInstances * scene.meshes[m].chunk_count;
  });
  return sum;
}

Result<SceneTables> make_tables(const SceneView& scene) {
  const std::vector<uint64_t> instances = instances_by_mesh(scene);
  const uint64_t candidates = candidate_count(scene, instances);
  if (scene.instance_count >= UINT32_MAX || scene.chunk_count >= UINT32_MAX || candidates >= kMaxItems) {
    return Error{ErrorCode::kRange,
                 "the scene has " + std::to_string(scene.instance_count) + " instances and " +
                     std::to_string(candidates) +
                     " groups of 16 instances of a chunk; a GPU draws fewer than 2^32 - 1 and 2^28; use "
                     "--backend cpu"};
  }
  SceneTables tables;
  tables.mesh_first.resize(scene.mesh_count);
  tables.candidates.reserve(candidates);
  uint32_t place = 0;
  for_each_drawn_mesh(scene, instances, [&](uint64_t m, uint64_t count) {
    const format::MeshRecord& mesh = scene.meshes[m];
    tables.mesh_first[m] = place;
    place += static_cast<uint32_t>(count);
    (mesh.position_encoding == format::PositionEncoding::kFloat32 ? tables.has_float32 : tables.has_lattice) = true;
    tables.has_instances = tables.has_instances || count > 1;
    for (uint64_t c = 0; c < mesh.chunk_count; ++c) {
      for (uint64_t first = 0; first < count; first += kGroupInstances) {
        tables.candidates.push_back({static_cast<uint32_t>(mesh.first_chunk + c), static_cast<uint32_t>(first)});
      }
    }
  });
  tables.order.resize(place);
  std::vector<uint32_t> next = tables.mesh_first;
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    const uint32_t mesh = scene.instances[i].mesh;
    if (scene.meshes[mesh].triangle_count != 0) tables.order[next[mesh]++] = static_cast<uint32_t>(i);
  }
  return tables;
}

/// A kernel of stage 1, built for what a scene has.
struct SmallVariant {
  void (*kernel)(const SmallFrame);
  size_t shared_bytes;
  uint32_t blocks;  // that the GPU holds at once
};

template <bool kOrthographic, bool kLattice, bool kFloat32, bool kInstanced>
SmallVariant small_variant() {
  return {raster_small<kOrthographic, kLattice, kFloat32, kInstanced>, kSmallWarps * sizeof(SmallShared<kInstanced>),
          0};
}

SmallVariant choose_small(const SceneTables& tables, bool orthographic) {
  if (orthographic) return small_variant<true, true, true, true>();
  if (tables.has_lattice && tables.has_float32) return small_variant<false, true, true, true>();
  if (tables.has_float32) {
    return tables.has_instances ? small_variant<false, false, true, true>()
                                : small_variant<false, false, true, false>();
  }
  return tables.has_instances ? small_variant<false, true, false, true>() : small_variant<false, true, false, false>();
}

enum Mark { kStart, kCleared, kCulled, kSmallDone, kMediumDone, kLargeBegun, kLargeDone, kAllDone, kMarkCount };

}  // namespace

struct CudaFrames::Impl {
  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (stream != nullptr) (void)cudaStreamSynchronize(stream);
    for (cudaEvent_t event : marks) {
      if (event != nullptr) (void)cudaEventDestroy(event);
    }
    (void)cudaFreeHost(seen);
    if (side_stream != nullptr) (void)cudaStreamDestroy(side_stream);
    if (stream != nullptr) (void)cudaStreamDestroy(stream);
  }

  Result<void> open(const SceneView& host, const CudaQueueSizes& sizes);
  Result<void> grow(uint64_t medium_count, uint64_t large_count);
  template <bool kOrthographic>
  Result<void> submit(const FrameView& frame, uint64_t* samples, const DrawOptions& options);
  Result<void> prepare(SmallVariant& variant) const;
  Result<void> mark(Mark place) { return cuda_check(cudaEventRecord(marks[place], stream), "recording an event"); }
  Result<void> read_times(FrameTimes& times) const;

  SceneView scene{};
  uint64_t triangle_count = 0;
  SceneTables tables;  // the flags; the vectors are given up once they are on the device
  uint32_t multiprocessors = 0;
  SmallVariant variants[2] = {};  // perspective, orthographic
  cudaStream_t stream = nullptr;
  cudaStream_t side_stream = nullptr;  // stage 3
  // Both are blocking streams: who works on the default stream (the resolver) is ordered with them.
  cudaEvent_t marks[kMarkCount] = {};
  FrameCounters* seen = nullptr;  // pinned: the counters after a frame

  DeviceArray<uint32_t> order;
  DeviceArray<uint32_t> mesh_first;
  DeviceArray<Candidate> candidates;
  DeviceArray<ChunkBounds> bounds;
  DeviceArray<std::byte> zeroed;  // the counters, then the visible instances of each mesh
  DeviceArray<uint32_t> visible;
  DeviceArray<Transform> transforms;
  DeviceArray<DrawGroup> groups;
  DeviceArray<Triangle> medium;
  DeviceArray<Triangle> large;
  DeviceArray<TileItem> tiles;
};

Result<void> CudaFrames::Impl::open(const SceneView& host, const CudaQueueSizes& sizes) {
  triangle_count = host.instance_base[host.instance_count];
  Result<SceneTables> made = make_tables(host);
  if (!made) return made.error();
  tables = std::move(*made);
  int device = 0;
  int count = 0;
  Result<void> done = cuda_check(cudaGetDevice(&device), "asking for the device");
  if (done) {
    done = cuda_check(cudaDeviceGetAttribute(&count, cudaDevAttrMultiProcessorCount, device),
                      "asking for multiprocessors");
  }
  multiprocessors = static_cast<uint32_t>(count);
  for (const bool orthographic : {false, true}) {
    variants[orthographic] = choose_small(tables, orthographic);
    if (done) done = prepare(variants[orthographic]);
  }
  if (done) done = cuda_check(cudaStreamCreate(&stream), "making a stream");
  if (done) done = cuda_check(cudaStreamCreate(&side_stream), "making a stream");
  for (cudaEvent_t& event : marks) {
    if (done) done = cuda_check(cudaEventCreate(&event), "making an event");
  }
  if (done) {
    done =
        cuda_check(cudaMallocHost(reinterpret_cast<void**>(&seen), sizeof(FrameCounters)), "allocating pinned memory");
  }
  if (done) done = order.fill(tables.order, "allocating the draw list");
  if (done) done = mesh_first.fill(tables.mesh_first, "allocating the draw list");
  if (done) done = candidates.fill(tables.candidates, "allocating the draw list");
  if (done && tables.has_float32) done = bounds.allocate(host.chunk_count, "allocating the chunks' bounds");
  if (done && tables.has_float32) {
    find_bounds<<<multiprocessors * 8, 128, 0, stream>>>(scene, bounds.data());
    done = cuda_check(cudaGetLastError(), "finding the chunks' bounds");
  }
  if (done) {
    done = zeroed.allocate(sizeof(FrameCounters) + host.mesh_count * sizeof(uint32_t), "allocating the draw list");
  }
  if (done) done = visible.allocate(tables.order.size(), "allocating the draw list");
  if (done) done = transforms.allocate(host.instance_count, "allocating the frame's transforms");
  if (done) done = groups.allocate(tables.candidates.size(), "allocating the draw list");
  if (done) done = tiles.allocate(sizes.tiles, "allocating the queues");
  if (done) done = grow(sizes.medium, sizes.large);
  if (done) done = cuda_check(cudaStreamSynchronize(stream), "preparing to draw");
  tables.order = {};
  tables.mesh_first = {};
  tables.candidates = {};
  return done;
}

Result<void> CudaFrames::Impl::prepare(SmallVariant& variant) const {
  int resident = 0;
  Result<void> done = cuda_check(cudaFuncSetAttribute(variant.kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                                      static_cast<int>(variant.shared_bytes)),
                                 "asking for shared memory");
  if (done) {
    done = cuda_check(
        cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, variant.kernel, kSmallThreads, variant.shared_bytes),
        "asking for occupancy");
  }
  variant.blocks = multiprocessors * static_cast<uint32_t>(std::max(resident, 1));
  return done;
}

Result<void> CudaFrames::Impl::grow(uint64_t medium_count, uint64_t large_count) {
  constexpr const char* kWhat = "allocating the queues of triangles; --backend cpu draws without them";
  if (medium_count > medium.count()) {
    if (Result<void> done = medium.allocate(medium_count, kWhat); !done) return done;
  }
  if (large_count > large.count()) {
    if (Result<void> done = large.allocate(min_of<uint64_t>(large_count, UINT32_MAX), kWhat); !done) return done;
  }
  return {};
}

template <bool kOrthographic>
Result<void> CudaFrames::Impl::submit(const FrameView& frame, uint64_t* samples, const DrawOptions& options) {
  auto* const counters = reinterpret_cast<FrameCounters*>(zeroed.data());
  const Queues queues{nullptr,        medium.data(), large.data(),  tiles.data(),     0,
                      medium.count(), large.count(), tiles.count(), &counters->queues};
  const DrawList list{order.data(),
                      mesh_first.data(),
                      candidates.data(),
                      bounds.data(),
                      static_cast<uint32_t>(order.count()),
                      static_cast<uint32_t>(candidates.count()),
                      reinterpret_cast<uint32_t*>(zeroed.data() + sizeof(FrameCounters)),
                      visible.data(),
                      transforms.data(),
                      groups.data(),
                      counters};
  const Target target{samples, frame.width};
  const uint64_t sample_count = static_cast<uint64_t>(frame.width) * static_cast<uint64_t>(frame.height);

  Result<void> done = mark(kStart);
  static_assert(kBackground == ~uint64_t{0});
  if (done) done = cuda_check(cudaMemsetAsync(samples, 0xff, sample_count * sizeof(uint64_t), stream), "clearing");
  if (done) done = cuda_check(cudaMemsetAsync(zeroed.data(), 0, zeroed.count(), stream), "clearing the counters");
  if (done) done = mark(kCleared);
  if (done && list.candidate_count != 0) {
    cull_instances<<<(list.instance_count - 1) / kCullThreads + 1, kCullThreads, 0, stream>>>(scene, frame, list);
    cull_chunks<<<(list.candidate_count - 1) / kCullThreads + 1, kCullThreads, 0, stream>>>(scene, frame, list);
    done = cuda_check(cudaGetLastError(), "starting culling");
  }
  if (done) done = mark(kCulled);
  if (done && list.candidate_count != 0) {
    const SmallFrame small{scene, frame, target, queues, list, make_sample_limits(frame), options.sampleless_test};
    const SmallVariant& variant = variants[kOrthographic ? 1 : 0];
    variant.kernel<<<variant.blocks, kSmallThreads, variant.shared_bytes, stream>>>(small);
    done = cuda_check(cudaGetLastError(), "starting stage 1");
  }
  if (done) done = mark(kSmallDone);
  // Stages 2 and 3 draw what stage 1 left, each alone too little for the GPU.
  const LargeFrame rest{frame, target, queues};
  if (done) done = cuda_check(cudaStreamWaitEvent(side_stream, marks[kSmallDone]), "forking");
  if (done) done = cuda_check(cudaEventRecord(marks[kLargeBegun], side_stream), "recording an event");
  if (done) {
    const uint32_t blocks = multiprocessors * kLargeBlocks;
    split_large<kOrthographic><<<blocks, kLargeThreads, 0, side_stream>>>(rest);
    raster_large<kOrthographic><<<blocks, kLargeThreads, 0, side_stream>>>(rest);
    done = cuda_check(cudaGetLastError(), "starting stage 3");
  }
  if (done) done = cuda_check(cudaEventRecord(marks[kLargeDone], side_stream), "recording an event");
  if (done) {
    raster_medium<kOrthographic><<<multiprocessors * kMediumBlocks, kLargeThreads, 0, stream>>>(rest);
    done = cuda_check(cudaGetLastError(), "starting stage 2");
  }
  if (done) done = mark(kMediumDone);
  if (done) done = cuda_check(cudaStreamWaitEvent(stream, marks[kLargeDone]), "joining");
  if (done) done = mark(kAllDone);
  if (done) {
    done = cuda_check(cudaMemcpyAsync(seen, counters, sizeof *seen, cudaMemcpyDeviceToHost, stream),
                      "reading the counters");
  }
  if (done) done = cuda_check(cudaStreamSynchronize(stream), "drawing");
  return done;
}

Result<void> CudaFrames::Impl::read_times(FrameTimes& times) const {
  const struct {
    float* out;
    Mark from;
    Mark to;
  } spans[] = {{&times.clear_ms, kStart, kCleared},        {&times.cull_ms, kCleared, kCulled},
               {&times.small_ms, kCulled, kSmallDone},     {&times.medium_ms, kSmallDone, kMediumDone},
               {&times.large_ms, kLargeBegun, kLargeDone}, {&times.raster_ms, kCleared, kAllDone}};
  for (const auto& span : spans) {
    Result<void> done = cuda_check(cudaEventElapsedTime(span.out, marks[span.from], marks[span.to]), "reading times");
    if (!done) return done;
  }
  return {};
}

CudaFrames::CudaFrames(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CudaFrames::CudaFrames(CudaFrames&&) noexcept = default;
CudaFrames& CudaFrames::operator=(CudaFrames&&) noexcept = default;
CudaFrames::~CudaFrames() = default;

uint64_t CudaFrames::device_bytes(const SceneView& host, const CudaQueueSizes& sizes) {
  const std::vector<uint64_t> instances = instances_by_mesh(host);
  return sizeof(FrameCounters) + 2 * host.mesh_count * sizeof(uint32_t) +
         host.instance_count * (2 * sizeof(uint32_t) + sizeof(Transform)) + host.chunk_count * sizeof(ChunkBounds) +
         candidate_count(host, instances) * (sizeof(Candidate) + sizeof(DrawGroup)) +
         (sizes.medium + sizes.large) * sizeof(Triangle) + sizes.tiles * sizeof(TileItem);
}

Result<CudaFrames> CudaFrames::create(const SceneView& host, const SceneView& device, const CudaQueueSizes& sizes) {
  auto impl = std::make_unique<Impl>();
  impl->scene = device;
  if (Result<void> opened = impl->open(host, sizes); !opened) return opened.error();
  return CudaFrames(std::move(impl));
}

Result<FrameStats> CudaFrames::draw(const View& view, uint64_t* samples, const DrawOptions& options,
                                    FrameTimes* times) {
  if (Result<void> checked = check_frame(view, impl_->triangle_count); !checked) return checked.error();
  const FrameView frame = make_frame_view(view);
  for (;;) {
    const Result<void> done = view.orthographic ? impl_->submit<true>(frame, samples, options)
                                                : impl_->submit<false>(frame, samples, options);
    if (!done) return done.error();
    const Counters& seen = impl_->seen->queues;
    if (seen.medium <= impl_->medium.count() && seen.large <= impl_->large.count()) break;
    // A little more than was asked for, since the camera moves; or just that where no more fits.
    const auto more = [](uint64_t asked, uint64_t there) { return asked > there ? asked + asked / 4 : there; };
    Result<void> grown = impl_->grow(more(seen.medium, impl_->medium.count()), more(seen.large, impl_->large.count()));
    if (!grown) grown = impl_->grow(seen.medium, seen.large);
    if (!grown) return grown.error();
  }
  if (times != nullptr) {
    if (Result<void> done = impl_->read_times(*times); !done) return done.error();
  }
  const Counters& seen = impl_->seen->queues;
  FrameStats stats{};
  stats.instances_drawn = seen.instances_drawn;
  stats.draws = seen.draws;
  stats.triangles = seen.triangles;
  stats.triangles_small = seen.triangles_small;
  stats.triangles_medium = seen.medium;
  stats.triangles_large = seen.large;
  stats.triangles_clipped = seen.triangles_clipped;
  return stats;
}

const Transform* CudaFrames::transforms() const {
  return impl_->transforms.data();
}

}  // namespace scree::kernels
