#include "tools/gltf/draco/source.h"

#include <cstring>
#include <mutex>
#include <new>
#include <utility>

#include "format/bytes.h"
#include "tools/gltf/byte_source.h"

namespace scree::convert {
namespace {

class DracoSource final : public ByteSource {
 public:
  DracoSource(DracoPrimitive primitive, std::shared_ptr<const ByteSource> stream, uint64_t offset, uint64_t bytes,
              std::shared_ptr<KeptWindows> kept)
      : primitive_(std::move(primitive)),
        size_(*primitive_.offset_of(primitive_.arrays.size())),
        stream_(std::move(stream)),
        offset_(offset),
        bytes_(bytes),
        kept_(std::move(kept)) {}
  ~DracoSource() override { kept_->forget(this, 1); }

  uint64_t size() const override { return size_; }
  const std::string& path() const override { return stream_->path(); }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override try {
    SCREE_TRY(check_read(offset, out, size_, "primitive"));
    const std::shared_ptr<MeshoptWindow> window = kept_->take(this, 0, size_, size_);
    {
      const std::lock_guard<std::mutex> lock(window->mutex);  // other threads that need it wait
      if (!window->is_unpacked) {
        std::vector<std::byte> stream(bytes_);
        SCREE_TRY(stream_->read(offset_, stream));
        SCREE_TRY_AT("Draco", decode_draco(primitive_, stream, window->all()));
        window->is_unpacked = true;
      }
    }
    std::memcpy(out.data(), window->bytes.get() + offset, out.size());
    return {};
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "Draco: no memory to unpack it"};
  }

 private:
  const DracoPrimitive primitive_;
  const uint64_t size_;
  const std::shared_ptr<const ByteSource> stream_;
  const uint64_t offset_;
  const uint64_t bytes_;
  const std::shared_ptr<KeptWindows> kept_;
};

/// Upper bound of decode_draco()'s memory beside its output for a stream of this size, including the stream.
uint64_t scratch_bytes(const DracoPrimitive& primitive, uint64_t stream_bytes) {
  // Per triangle: its corners, a table of opposite corners, one of vertices, and one for each kind of seam. Per vertex:
  // integers, values and indices of every attribute. Measured on grids and scans (docs/import.md).
  constexpr uint64_t kTriangleBytes = 96, kVertexBytes = 96, kComponentBytes = 12, kSmallBytes = 64 << 10;
  uint64_t components = primitive.other_components;
  for (const DracoArray& array : primitive.arrays) components += array.components;
  return kSmallBytes + 2 * stream_bytes + kTriangleBytes * primitive.triangles +
         (kVertexBytes + kComponentBytes * components) * primitive.vertices;
}

}  // namespace

std::optional<uint64_t> DracoPrimitive::offset_of(size_t number) const {
  auto end = format::checked_mul(triangles, 12);
  for (size_t i = 0; i < number && end; ++i) {
    const uint64_t bytes = vertices * arrays[i].components * component_bytes(arrays[i].type);  // below 2^36
    end = format::checked_add(*end, format::align_up(bytes, 4));
  }
  return end;
}

PackedViewMemory draco_memory(const DracoPrimitive& primitive, uint64_t stream_bytes) {
  const uint64_t size = *primitive.offset_of(primitive.arrays.size()) + KeptWindows::kEntryBytes;
  return {size + scratch_bytes(primitive, stream_bytes), 0, size};
}

std::shared_ptr<const ByteSource> draco_source(DracoPrimitive primitive, std::shared_ptr<const ByteSource> stream,
                                               uint64_t offset, uint64_t bytes, std::shared_ptr<KeptWindows> kept) {
  return std::make_shared<DracoSource>(std::move(primitive), std::move(stream), offset, bytes, std::move(kept));
}

}  // namespace scree::convert
