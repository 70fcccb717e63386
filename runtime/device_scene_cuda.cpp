// DeviceScene where the program is built with CUDA; device_scene_none.cpp stands in elsewhere.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "kernels/cuda_check.h"
#include "kernels/frame_cuda.h"
#include "kernels/resolve_cuda.h"
#include "runtime/device_scene.h"
#include "runtime/parallel.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::DeviceBuffer;

namespace {

constexpr uint64_t kAlignment = 256;
constexpr uint64_t kStagingBytes = uint64_t{4} << 20;
constexpr uint32_t kStagingBuffers = 2;  // a thread: one is filled while the other is copied

/// What goes where in the arena.
struct Piece {
  const std::byte* from;
  uint64_t bytes;
  uint64_t offset;  // in the arena
};

class Layout {
 public:
  uint64_t add(const void* from, uint64_t bytes) {
    const uint64_t offset = bytes_;
    if (bytes != 0) pieces_.push_back({static_cast<const std::byte*>(from), bytes, offset});
    bytes_ = (bytes_ + bytes + kAlignment - 1) & ~(kAlignment - 1);
    return offset;
  }
  template <class T>
  uint64_t add_array(const T* from, uint64_t count) {
    return add(from, count * sizeof(T));
  }
  uint64_t bytes() const { return bytes_; }
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  std::vector<Piece> pieces_;
  uint64_t bytes_ = 0;
};

/// Pinned memory, a stream and an event a buffer; one a thread.
class Stager {
 public:
  Stager() = default;
  Stager(const Stager&) = delete;
  Stager& operator=(const Stager&) = delete;
  ~Stager() {
    if (stream_ != nullptr) (void)cudaStreamSynchronize(stream_);
    for (uint32_t i = 0; i < kStagingBuffers; ++i) {
      if (ready_[i] != nullptr) (void)cudaEventDestroy(ready_[i]);
      (void)cudaFreeHost(pinned_[i]);
    }
    if (stream_ != nullptr) (void)cudaStreamDestroy(stream_);
  }

  Result<void> open() {
    if (auto done = cuda_check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream"); !done)
      return done;
    for (uint32_t i = 0; i < kStagingBuffers; ++i) {
      if (auto done = cuda_check(cudaMallocHost(&pinned_[i], kStagingBytes), "allocating pinned memory"); !done)
        return done;
      if (auto done = cuda_check(cudaEventCreateWithFlags(&ready_[i], cudaEventDisableTiming), "making an event");
          !done)
        return done;
    }
    return {};
  }

  /// `bytes` <= kStagingBytes.
  Result<void> copy(std::byte* to, const std::byte* from, uint64_t bytes) {
    const uint32_t i = next_++ % kStagingBuffers;
    if (auto done = cuda_check(cudaEventSynchronize(ready_[i]), "waiting for a copy"); !done) return done;
    std::memcpy(pinned_[i], from, bytes);
    if (auto done = cuda_check(cudaMemcpyAsync(to, pinned_[i], bytes, cudaMemcpyHostToDevice, stream_),
                               "copying to the device");
        !done)
      return done;
    return cuda_check(cudaEventRecord(ready_[i], stream_), "recording a copy");
  }
  Result<void> finish() { return cuda_check(cudaStreamSynchronize(stream_), "finishing the copies"); }

 private:
  cudaStream_t stream_ = nullptr;
  void* pinned_[kStagingBuffers] = {};
  cudaEvent_t ready_[kStagingBuffers] = {};
  uint32_t next_ = 0;
};

Result<void> copy_pieces(const std::vector<Piece>& pieces, std::byte* arena, uint32_t threads) {
  std::vector<Piece> parts;
  for (const Piece& piece : pieces)
    for (uint64_t done = 0; done < piece.bytes; done += kStagingBytes)
      parts.push_back({piece.from + done, std::min(kStagingBytes, piece.bytes - done), piece.offset + done});
  std::atomic<uint64_t> next{0};
  std::mutex mutex;
  Result<void> result;
  parallel_for(std::min<uint64_t>(threads, parts.size()), threads, [&](uint64_t) {
    Stager stager;
    Result<void> done = stager.open();
    for (uint64_t i = next++; done && i < parts.size(); i = next++)
      done = stager.copy(arena + parts[i].offset, parts[i].from, parts[i].bytes);
    if (done) done = stager.finish();
    if (!done) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (result) result = done;
      next = parts.size();
    }
  });
  return result;
}

}  // namespace

Result<void> find_device() {
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status == cudaErrorInsufficientDriver)
    return Error{ErrorCode::kDevice,
                 "the NVIDIA driver is missing or older than this program's CUDA; install a newer one "
                 "or use --backend cpu"};
  if (status == cudaErrorNoDevice || (status == cudaSuccess && count == 0))
    return Error{ErrorCode::kDevice, "no NVIDIA GPU found; use --backend cpu"};
  if (Result<void> done = cuda_check(status, "looking for a GPU"); !done) return done;
  cudaDeviceProp properties;
  if (Result<void> done = cuda_check(cudaGetDeviceProperties(&properties, 0), "asking the GPU what it is"); !done)
    return done;
  if (properties.major < 9)
    return Error{ErrorCode::kDevice, std::string(properties.name) + " has compute capability " +
                                         std::to_string(properties.major) + "." + std::to_string(properties.minor) +
                                         ", expected 9.0 or newer; use --backend cpu"};
  return {};
}

struct DeviceScene::Impl {
  const Scene* scene = nullptr;
  DeviceBuffer arena;
  DeviceBuffer samples;
  DeviceBuffer pixels;
  kernels::CudaResolver resolver;
  kernels::SceneView view{};
  std::optional<kernels::CudaFrames> frames;
  UploadStats stats;
};

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() = default;

const UploadStats& DeviceScene::stats() const {
  return impl_->stats;
}

kernels::CudaFrames& DeviceScene::frames() {
  return *impl_->frames;
}

const kernels::SceneView& DeviceScene::device_view() const {
  return impl_->view;
}

Result<DeviceScene> DeviceScene::upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads) {
  if (Result<void> found = find_device(); !found) return found.error();
  const auto start = std::chrono::steady_clock::now();
  const kernels::SceneView& host = scene.view();
  const format::Container& container = scene.container();

  // The tables of pointers are filled once the arena's address is known; their places are laid out now.
  std::vector<const std::byte*> page_pointers(container.pages().size());
  std::vector<kernels::TextureView> textures(host.textures, host.textures + host.texture_count);

  Layout layout;
  const uint64_t meshes = layout.add_array(host.meshes, host.mesh_count);
  const uint64_t chunks = layout.add_array(host.chunks, host.chunk_count);
  const uint64_t instances = layout.add_array(host.instances, host.instance_count);
  const uint64_t instance_base = layout.add_array(host.instance_base, host.instance_count + 1);
  const uint64_t matrices = layout.add_array(host.matrices, host.matrix_count);
  const uint64_t materials = layout.add_array(host.materials, host.material_count);
  const uint64_t texture_views = layout.add_array(textures.data(), textures.size());
  const uint64_t page_table = layout.add_array(page_pointers.data(), page_pointers.size());
  std::vector<uint64_t> page_offset(page_pointers.size());
  for (uint64_t i = 0; i < page_pointers.size(); ++i)
    if (host.pages[i] != nullptr) page_offset[i] = layout.add(host.pages[i], container.pages()[i].raw_bytes);
  std::map<const uint8_t*, uint64_t> texel_offset;  // several textures may show one image
  for (const kernels::TextureView& texture : textures) {
    if (texture.texels == nullptr || texel_offset.contains(texture.texels)) continue;
    const uint32_t last = texture.level_count - 1;
    const uint64_t texels = texture.level_offset[last] +
                            uint64_t{std::max(texture.width >> last, 1u)} * std::max(texture.height >> last, 1u);
    texel_offset[texture.texels] = layout.add(texture.texels, 4 * texels);
  }

  size_t free_bytes = 0;
  size_t total_bytes = 0;
  if (auto done = cuda_check(cudaMemGetInfo(&free_bytes, &total_bytes), "asking for free device memory"); !done)
    return done.error();
  const uint64_t budget = budget_bytes == 0 ? free_bytes : std::min<uint64_t>(budget_bytes, free_bytes);
  const uint64_t needed = layout.bytes() + kernels::CudaFrames::device_bytes(host);
  if (needed > budget)
    return Error{ErrorCode::kDevice, "the scene takes " + std::to_string(needed) + " bytes of device memory, but " +
                                         std::to_string(budget) + " are " +
                                         (budget == free_bytes ? "free" : "allowed") + "; use --backend cpu"};
  auto impl = std::make_unique<Impl>();
  impl->scene = &scene;
  Result<DeviceBuffer> arena = DeviceBuffer::allocate(std::max<uint64_t>(layout.bytes(), 1), "allocating the scene");
  if (!arena) return arena.error();
  impl->arena = std::move(*arena);
  std::byte* const base = impl->arena.data();

  for (uint64_t i = 0; i < page_pointers.size(); ++i)
    if (host.pages[i] != nullptr) page_pointers[i] = base + page_offset[i];
  for (kernels::TextureView& texture : textures)
    if (texture.texels != nullptr)
      texture.texels = reinterpret_cast<const uint8_t*>(base + texel_offset[texture.texels]);

  if (Result<void> done = copy_pieces(layout.pieces(), base, std::max(threads, 1u)); !done) return done.error();
  impl->view = host;
  impl->view.meshes = reinterpret_cast<const format::MeshRecord*>(base + meshes);
  impl->view.chunks = reinterpret_cast<const format::ChunkRecord*>(base + chunks);
  impl->view.instances = reinterpret_cast<const format::InstanceRecord*>(base + instances);
  impl->view.instance_base = reinterpret_cast<const uint64_t*>(base + instance_base);
  impl->view.matrices = reinterpret_cast<const format::MatrixRecord*>(base + matrices);
  impl->view.materials = reinterpret_cast<const format::MaterialRecord*>(base + materials);
  impl->view.textures = reinterpret_cast<const kernels::TextureView*>(base + texture_views);
  impl->view.pages = reinterpret_cast<const std::byte* const*>(base + page_table);
  Result<kernels::CudaFrames> frames = kernels::CudaFrames::create(host, impl->view);
  if (!frames) return frames.error();
  impl->frames = std::move(*frames);
  impl->stats.device_bytes = needed;
  impl->stats.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return DeviceScene(std::move(impl));
}

Result<kernels::FrameStats> DeviceScene::draw(const kernels::View& view) {
  const uint64_t bytes = uint64_t{view.width} * view.height * sizeof(uint64_t);
  if (impl_->samples.bytes() != bytes) {
    impl_->samples = DeviceBuffer();
    Result<DeviceBuffer> buffer = DeviceBuffer::allocate(bytes, "allocating the visibility buffer");
    if (!buffer) return buffer.error();
    impl_->samples = std::move(*buffer);
  }
  return impl_->frames->draw(view, reinterpret_cast<uint64_t*>(impl_->samples.data()));
}

Result<void> DeviceScene::read_samples(std::span<uint64_t> samples) {
  if (impl_->samples.bytes() != samples.size_bytes())
    return Error{ErrorCode::kRange, std::to_string(samples.size()) + " samples, but the picture has " +
                                        std::to_string(impl_->samples.bytes() / sizeof(uint64_t))};
  return cuda_check(cudaMemcpy(samples.data(), impl_->samples.data(), samples.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the visibility buffer");
}

Result<void> DeviceScene::resolve(const kernels::View& view, uint32_t samples_per_side,
                                  const kernels::ShadeOptions& options, std::span<uint32_t> pixels,
                                  kernels::ResolveTimes* times) {
  if (impl_->samples.bytes() != uint64_t{view.width} * view.height * sizeof(uint64_t))
    return Error{ErrorCode::kRange, "no picture of " + std::to_string(view.width) + " x " +
                                        std::to_string(view.height) + " samples was drawn"};
  if (auto checked = kernels::check_resolve(view, samples_per_side); !checked) return checked;
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (impl_->pixels.bytes() < count * sizeof(uint32_t)) {
    impl_->pixels = DeviceBuffer();
    Result<DeviceBuffer> buffer = DeviceBuffer::allocate(count * sizeof(uint32_t), "allocating the picture");
    if (!buffer) return buffer.error();
    impl_->pixels = std::move(*buffer);
  }
  const auto device_pixels = reinterpret_cast<uint32_t*>(impl_->pixels.data());
  if (auto done = impl_->resolver.resolve(impl_->view, view, samples_per_side,
                                          reinterpret_cast<const uint64_t*>(impl_->samples.data()),
                                          impl_->frames->transforms(), options, device_pixels, nullptr, times);
      !done)
    return done;
  if (pixels.empty()) return {};
  if (pixels.size() != count)
    return Error{ErrorCode::kRange,
                 std::to_string(pixels.size()) + " pixels, but the picture has " + std::to_string(count)};
  return cuda_check(cudaMemcpy(pixels.data(), device_pixels, pixels.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the picture");
}

}  // namespace scree::runtime
