#include "tools/gltf/meshopt/source.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstring>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "format/bytes.h"
#include "format/fail.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/meshopt/stream.h"
#include "tools/gltf/meshopt/windows.h"

namespace scree::convert {
namespace {

using Mode = DocMeshopt::Mode;
using Filter = DocMeshopt::Filter;

/// The fewest bytes of a stream of `count` elements; nullopt if that exceeds 64 bits.
std::optional<uint64_t> fewest_bytes(Mode mode, uint64_t count, uint64_t stride) {
  // Attributes: two bits for every byte of up to 256 elements that are all equal in that byte (version 0: of 16).
  // Triangles: one byte each and a table of 16. Indices: one byte each and a tail of 4. All have one byte of header.
  if (mode == Mode::kTriangles) return 1 + count / 3 + 16;
  if (mode == Mode::kIndices) return format::checked_add(count, 5);
  const auto bytes = format::checked_mul(count, stride);
  return bytes ? std::optional<uint64_t>(1 + *bytes / 1024) : std::nullopt;
}

Result<void> check_stride(const DocMeshopt& stated) {
  const uint64_t stride = stated.stride;
  const auto fail = [&](const char* expected) {
    return scree::fail(ErrorCode::kFormat, "byteStride is ", stride, ", expected ", expected);
  };
  if (stated.mode != Mode::kAttributes) {
    if (stride != 2 && stride != 4) return fail("2 or 4 for indices");
    return {};
  }
  if (stride == 0 || stride > 256 || stride % 4 != 0) return fail("a multiple of 4 up to 256");
  if (stated.filter == Filter::kOctahedral && stride != 4 && stride != 8) return fail("4 or 8 for OCTAHEDRAL");
  if (stated.filter == Filter::kColor && stride != 4 && stride != 8) return fail("4 or 8 for COLOR");
  if (stated.filter == Filter::kQuaternion && stride != 8) return fail("8 for QUATERNION");
  return {};
}

}  // namespace

Result<void> check_meshopt(const DocMeshopt& stated, uint64_t view_bytes, uint64_t view_stride) {
  if (stated.unknown_mode.has_value())
    return Error{ErrorCode::kFormat,
                 "mode is \"" + *stated.unknown_mode + "\", expected ATTRIBUTES, TRIANGLES or INDICES"};
  if (stated.mode != Mode::kAttributes && stated.filter != Filter::kNone)
    return Error{ErrorCode::kFormat, std::string("a filter, but the mode is ") + mode_name(stated.mode)};
  SCREE_TRY(check_stride(stated));
  if (view_stride != 0 && view_stride != stated.stride)
    return fail(ErrorCode::kFormat, "byteStride is ", stated.stride, ", but the buffer view's is ", view_stride);
  if (stated.mode == Mode::kTriangles && stated.count % 3 != 0)
    return fail(ErrorCode::kFormat, "count is ", stated.count, ", expected a multiple of 3 for TRIANGLES");
  const auto unpacked = format::checked_mul(stated.count, stated.stride);
  if (!unpacked || *unpacked != view_bytes)
    return fail(ErrorCode::kRange, stated.count, " elements of ", stated.stride, " bytes, but the buffer view has ",
                view_bytes, " bytes");
  const auto fewest = fewest_bytes(stated.mode, stated.count, stated.stride);
  if (!fewest || *fewest > stated.bytes)
    return fail(ErrorCode::kTruncated, stated.count, " elements do not fit into ", stated.bytes, " bytes");
  return {};
}

namespace {

class WindowedView final : public MeshoptView {
 public:
  WindowedView(const DocMeshopt& stated, std::shared_ptr<const ByteSource> stream, std::shared_ptr<KeptWindows> kept,
               uint64_t window_bytes)
      : size_(stated.count * stated.stride),
        stride_(stated.stride),
        stream_(MeshoptStream::make(stated, std::move(stream))),
        kept_(std::move(kept)) {
    const uint64_t together = stream_->granularity() * stride_;
    window_bytes_ = std::max<uint64_t>(window_bytes / together, 1) * together;
    windows_ = size_ / window_bytes_ + (size_ % window_bytes_ != 0);
    capacity_ = windows_ > 1 ? std::max(window_bytes, window_bytes_) : size_;
  }
  ~WindowedView() override {
    kept_->forget(this, reached_.load() + 1);
  }  // + 1: the window whose unpacking may have failed

  uint64_t size() const override { return size_; }
  const std::string& path() const override { return stream_->path(); }
  PackedViewMemory memory() const override {
    return {capacity_ + MeshoptStream::kScratchBytes, windows_ * sizeof(MeshoptPlace),
            windows_ * (capacity_ + KeptWindows::kEntryBytes)};
  }

  void will_need(uint64_t offset, uint64_t bytes) const override {
    const uint64_t count = size_ / stride_, first = std::min(offset / stride_, count);
    stream_->will_need(first, first + std::min(bytes / stride_ + 1, count - first));
  }

  void unpack_ahead(uint64_t offset, uint64_t bytes) const override {
    const uint64_t end = std::min((offset + bytes + window_bytes_ - 1) / window_bytes_, windows_);
    while (reached_.load(std::memory_order_acquire) < end)
      if (!reach_next(end)) return;
  }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override try {
    SCREE_TRY(check_read(offset, out, size_, "buffer view"));
    while (!out.empty()) {
      const auto window = SCREE_TRY(unpacked(offset / window_bytes_));
      const auto from = window->all().subspan(offset % window_bytes_);
      const size_t bytes = std::min(out.size(), from.size());
      std::memcpy(out.data(), from.data(), bytes);
      offset += bytes;
      out = out.subspan(bytes);
    }
    return {};
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, stream_->name() + ": no memory to unpack it"};
  }

 private:
  using Window = std::shared_ptr<MeshoptWindow>;

  Result<Window> unpacked(uint64_t index) const {
    while (reached_.load(std::memory_order_acquire) <= index) {
      auto window = SCREE_TRY(reach_next(index + 1));
      if (window.first == index) return window.second;
    }
    Window window = take(index);
    const std::lock_guard<std::mutex> lock(window->mutex);  // other threads that need it wait
    if (window->is_unpacked) return window;
    MeshoptPlace at = places_[index];
    SCREE_TRY(unpack(index, at, *window));
    return window;
  }

  /// Unpacks the first window that was never unpacked, if its number is below `end`. Returns the number and the window.
  /// Locks for one window at a time, because another thread's window may be ready before this one.
  Result<std::pair<uint64_t, Window>> reach_next(uint64_t end) const {
    const std::lock_guard<std::mutex> lock(reaching_);
    const uint64_t next = reached_.load(std::memory_order_relaxed);
    if (next >= end) return std::pair<uint64_t, Window>(next, nullptr);
    Window window = SCREE_TRY(reach(next));
    return std::pair(next, std::move(window));
  }

  /// Unpacks the first window that was never unpacked. Only that finds the beginning of the next window.
  Result<Window> reach(uint64_t index) const {
    if (index == 0) {
      places_.reset(new MeshoptPlace[windows_]);  // left uninitialised, so that windows never reached take no memory
      places_[0] = SCREE_TRY(stream_->begin());
    }
    Window window = take(index);
    const std::lock_guard<std::mutex> lock(window->mutex);
    MeshoptPlace at = places_[index];
    SCREE_TRY(unpack(index, at, *window));
    if (index + 1 < windows_) places_[index + 1] = at;
    reached_.store(index + 1, std::memory_order_release);
    return window;
  }

  Window take(uint64_t index) const {
    return kept_->take(this, index, std::min(window_bytes_, size_ - index * window_bytes_), capacity_);
  }

  Result<void> unpack(uint64_t index, MeshoptPlace& at, MeshoptWindow& window) const {
    SCREE_TRY(stream_->unpack(at, index * (window_bytes_ / stride_), window.all()));
    stream_->undo_filter(window.all());
    window.is_unpacked = true;
    return {};
  }

  const uint64_t size_;
  const uint64_t stride_;
  const std::unique_ptr<const MeshoptStream> stream_;
  const std::shared_ptr<KeptWindows> kept_;
  uint64_t window_bytes_;
  uint64_t windows_;
  uint64_t capacity_;  // of a window; the same for all views of several windows, so that windows can reuse each other's
                       // memory

  // Entries of places_ from reached_ on are accessed only by the holder of reaching_. Earlier ones do not change.
  mutable std::mutex reaching_;
  mutable std::unique_ptr<MeshoptPlace[]> places_;  // of each window's first element
  mutable std::atomic<uint64_t> reached_ = 0;       // number of windows that were unpacked
};

}  // namespace

MeshoptCache::MeshoptCache(uint64_t kept_bytes, uint64_t window_bytes)
    : kept_(std::make_shared<KeptWindows>(kept_bytes)), window_bytes_(window_bytes) {}

std::shared_ptr<const MeshoptView> MeshoptCache::view(const DocMeshopt& stated,
                                                      std::shared_ptr<const ByteSource> stream) const {
  return std::make_shared<WindowedView>(stated, std::move(stream), kept_, window_bytes_);
}

}  // namespace scree::convert
