#include "tools/bench/frames/nvjpeg.h"

#include <cuda_runtime_api.h>
#include <dlfcn.h>

#include <cstddef>
#include <fstream>
#include <iterator>
#include <memory>
#include <thread>
#include <utility>

#include "kernels/cuda/check.h"
#include "runtime/threads/stopwatch.h"

namespace scree::bench {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;

// As nvjpeg.h (CUDA Toolkit 13.0) declares them: the library is loaded where it is, and nothing here needs it.
constexpr int kSuccess = 0;
constexpr int kInterleavedRgb = 5;  // NVJPEG_OUTPUT_RGBI
struct Backend {
  int number;  // nvjpegBackend_t
  const char* name;
};
constexpr Backend kBackends[] = {{1, "host Huffman"}, {2, "GPU Huffman"}, {3, "decoder engine"}};
struct Picture {  // nvjpegImage_t
  unsigned char* channel[4];
  size_t pitch[4];
};
using Handle = void*;
using State = void*;

/// The functions of libnvjpeg.
struct Library {
  int (*create)(int backend, void* device_allocator, void* pinned_allocator, unsigned flags, Handle* handle);
  int (*destroy)(Handle handle);
  int (*create_state)(Handle handle, State* state);
  int (*destroy_state)(State state);
  int (*info)(Handle handle, const unsigned char* data, size_t length, int* components, int* subsampling, int* widths,
              int* heights);
  int (*decode)(Handle handle, State state, const unsigned char* data, size_t length, int format, Picture* picture,
                cudaStream_t stream);
};

template <class Function>
bool find(void* library, const char* name, Function& function) {
  function = reinterpret_cast<Function>(::dlsym(library, name));
  return function != nullptr;
}

/// Kept loaded: it may own threads.
bool load(Library& library) {
  void* opened = nullptr;
  for (const char* name : {"libnvjpeg.so.13", "libnvjpeg.so.12", "libnvjpeg.so"}) {
    opened = ::dlopen(name, RTLD_NOW | RTLD_LOCAL);
    if (opened == nullptr)
      opened = ::dlopen((std::string("/usr/local/cuda/lib64/") + name).c_str(), RTLD_NOW | RTLD_LOCAL);
    if (opened != nullptr) break;
  }
  return opened != nullptr && find(opened, "nvjpegCreateEx", library.create) &&
         find(opened, "nvjpegDestroy", library.destroy) &&
         find(opened, "nvjpegJpegStateCreate", library.create_state) &&
         find(opened, "nvjpegJpegStateDestroy", library.destroy_state) &&
         find(opened, "nvjpegGetImageInfo", library.info) && find(opened, "nvjpegDecode", library.decode);
}

/// What a thread decodes with, and where to.
class Decoder {
 public:
  Decoder(const Library& library, Handle handle) : library_(library), handle_(handle) {}
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
  ~Decoder() {
    if (state_ != nullptr) library_.destroy_state(state_);
    if (stream_ != nullptr) (void)cudaStreamDestroy(stream_);
  }

  /// Decodes a picture and waits for it.
  Result<void> decode(const std::string& jpeg) {
    const auto* data = reinterpret_cast<const unsigned char*>(jpeg.data());
    if (stream_ == nullptr) {
      if (auto made = cuda_check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream"); !made)
        return made;
      if (const int status = library_.create_state(handle_, &state_); status != kSuccess)
        return refused("nvjpegJpegStateCreate", status);
    }
    int components = 0;
    int subsampling = 0;
    int widths[4] = {};
    int heights[4] = {};
    if (const int status = library_.info(handle_, data, jpeg.size(), &components, &subsampling, widths, heights);
        status != kSuccess)
      return refused("nvjpegGetImageInfo", status);
    const size_t pitch = size_t{3} * static_cast<size_t>(widths[0]);
    const size_t bytes = pitch * static_cast<size_t>(heights[0]);
    if (Result<void> done = out_.reserve(bytes, "allocating a picture"); !done) return done.error();
    Picture picture{{reinterpret_cast<unsigned char*>(out_.data())}, {pitch}};
    if (const int status = library_.decode(handle_, state_, data, jpeg.size(), kInterleavedRgb, &picture, stream_);
        status != kSuccess)
      return refused("nvjpegDecode", status);
    pixels_ += static_cast<double>(widths[0]) * heights[0];
    return cuda_check(cudaStreamSynchronize(stream_), "waiting for nvJPEG");
  }

  double pixels() const { return pixels_; }

 private:
  static Error refused(const char* call, int status) {
    return {ErrorCode::kDevice, std::string(call) + " returned " + std::to_string(status)};
  }

  const Library& library_;
  Handle handle_;
  State state_ = nullptr;
  cudaStream_t stream_ = nullptr;
  DeviceBuffer out_;
  double pixels_ = 0;
};

/// Every picture once, on `thread_count` threads.
Result<NvJpegTimes> decode_all(const Library& library, Handle handle, const std::vector<std::string>& jpegs,
                               size_t thread_count) {
  std::vector<std::unique_ptr<Decoder>> decoders;
  std::vector<Result<void>> results(thread_count);
  for (size_t i = 0; i < thread_count; ++i) decoders.push_back(std::make_unique<Decoder>(library, handle));
  const auto run = [&]() -> bool {
    std::vector<std::jthread> threads;  // which join, also where one of them cannot be started
    try {
      for (size_t i = 0; i < thread_count; ++i)
        threads.emplace_back([&, i] {
          for (size_t j = i; j < jpegs.size() && results[i]; j += thread_count)
            results[i] = decoders[i]->decode(jpegs[j]);
        });
    } catch (const std::system_error&) {
      return false;
    }
    return true;
  };
  const Error no_threads{ErrorCode::kMemory, std::to_string(thread_count) + " threads cannot be started"};
  if (!run()) return no_threads;
  const auto pixels = [&] {
    double sum = 0;
    for (const auto& decoder : decoders) sum += decoder->pixels();
    return sum;
  };
  NvJpegTimes times;
  const double before = pixels();
  const runtime::Stopwatch watch;
  if (!run()) return no_threads;
  times.seconds = watch.elapsed().wall_ms * 1e-3;
  times.pixels = pixels() - before;
  for (const Result<void>& result : results)
    if (!result) return result.error();
  return times;
}

}  // namespace

Result<std::vector<NvJpegTimes>> time_nvjpeg(const std::vector<std::string>& files) {
  std::vector<NvJpegTimes> rows;
  Library library;
  if (files.empty() || !load(library)) return rows;
  std::vector<std::string> jpegs;
  for (const std::string& file : files) {
    std::ifstream in(file, std::ios::binary);
    jpegs.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    if (!in || jpegs.back().empty()) return Error{ErrorCode::kFile, file + ": cannot be read"};
  }
  for (const Backend& backend : kBackends) {
    Handle handle = nullptr;
    const int status = library.create(backend.number, nullptr, nullptr, 0, &handle);
    for (const size_t threads : {size_t{1}, jpegs.size()}) {
      Result<NvJpegTimes> times = status == kSuccess
                                      ? decode_all(library, handle, jpegs, threads)
                                      : Error{ErrorCode::kDevice, "nvjpegCreateEx returned " + std::to_string(status)};
      NvJpegTimes row = times ? *times : NvJpegTimes{{}, 0, 0, times.error().message};
      row.way = std::string(backend.name) + (threads == 1 ? ", one by one" : ", all at once");
      rows.push_back(std::move(row));
      if (jpegs.size() == 1) break;
    }
    if (handle != nullptr) library.destroy(handle);
  }
  return rows;
}

}  // namespace scree::bench
