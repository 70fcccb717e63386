#include "tools/convert/meshopt_source.h"

#include <meshoptimizer.h>

#include <array>
#include <cstddef>
#include <cstring>
#include <list>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/bytes.h"

namespace scree::convert {
namespace {

using Mode = DocMeshopt::Mode;
using Filter = DocMeshopt::Filter;
using Bytes = std::vector<std::byte>;

constexpr uint64_t kMaxUnpackedBytes = uint64_t{1} << 32;

struct ModeRule {
  Mode mode;
  const char* name;
  unsigned char header;   // high half of the stream's first byte; the low half is its version
  unsigned char version;  // the newest that meshoptimizer 0.18 reads
};
constexpr std::array<ModeRule, 3> kModes{{{Mode::kAttributes, "ATTRIBUTES", 0xa0, 0},
                                          {Mode::kTriangles, "TRIANGLES", 0xe0, 1},
                                          {Mode::kIndices, "INDICES", 0xd0, 1}}};

const ModeRule& rule_of(Mode mode) {
  return kModes[static_cast<size_t>(mode)];
}

std::string number(uint64_t value) {
  return std::to_string(value);
}

/// The fewest bytes that a stream of `count` elements takes; none where that passes 64 bits.
std::optional<uint64_t> fewest_bytes(Mode mode, uint64_t count, uint64_t stride) {
  // Attributes: a bit-width of two bits for 16 values of every byte of an element. Triangles: a byte each and a table
  // of
  // 16. Indices: a byte each and a tail of 4. All behind a byte of header.
  if (mode == Mode::kTriangles) return 1 + count / 3 + 16;
  if (mode == Mode::kIndices) return format::checked_add(count, 5);
  const auto bytes = format::checked_mul(count, stride);
  return bytes ? std::optional<uint64_t>(1 + *bytes / 64) : std::nullopt;
}

Result<void> check_stride(const DocMeshopt& stated) {
  const uint64_t stride = stated.stride;
  const auto fail = [&](const char* expected) {
    return Error{ErrorCode::kFormat, "byteStride is " + number(stride) + ", expected " + expected};
  };
  if (stated.mode != Mode::kAttributes) {
    if (stride != 2 && stride != 4) return fail("2 or 4 for indices");
    return {};
  }
  if (stride == 0 || stride > 256 || stride % 4 != 0) return fail("a multiple of 4 up to 256");
  if (stated.filter == Filter::kOctahedral && stride != 4 && stride != 8) return fail("4 or 8 for OCTAHEDRAL");
  if (stated.filter == Filter::kQuaternion && stride != 8) return fail("8 for QUATERNION");
  return {};
}

Result<void> unpack(const DocMeshopt& stated, std::span<const std::byte> stream, Bytes& out) {
  const ModeRule& rule = rule_of(stated.mode);
  const auto* const from = reinterpret_cast<const unsigned char*>(stream.data());
  if (stream.empty() || (from[0] & 0xf0) != rule.header)
    return Error{ErrorCode::kFormat, std::string("not a stream of ") + rule.name};
  if ((from[0] & 0x0f) > rule.version)
    return Error{ErrorCode::kUnsupported, std::string(rule.name) + " of version " + number(from[0] & 0x0fu) +
                                              ", but at most " + number(rule.version) + " is read"};
  int status = 0;
  switch (stated.mode) {
    case Mode::kAttributes:
      status = meshopt_decodeVertexBuffer(out.data(), stated.count, stated.stride, from, stream.size());
      break;
    case Mode::kTriangles:
      status = meshopt_decodeIndexBuffer(out.data(), stated.count, stated.stride, from, stream.size());
      break;
    case Mode::kIndices:
      status = meshopt_decodeIndexSequence(out.data(), stated.count, stated.stride, from, stream.size());
      break;
  }
  // -2: it ends too early; -3: bytes are left, or it refers to what it does not hold.
  if (status == -2)
    return Error{ErrorCode::kTruncated,
                 number(stream.size()) + " bytes end before " + number(stated.count) + " elements are unpacked"};
  if (status != 0)
    return Error{ErrorCode::kTrailing,
                 number(stream.size()) + " bytes do not unpack to " + number(stated.count) + " elements"};
  switch (stated.filter) {
    case Filter::kNone:
      break;
    case Filter::kOctahedral:
      meshopt_decodeFilterOct(out.data(), stated.count, stated.stride);
      break;
    case Filter::kQuaternion:
      meshopt_decodeFilterQuat(out.data(), stated.count, stated.stride);
      break;
    case Filter::kExponential:
      meshopt_decodeFilterExp(out.data(), stated.count, stated.stride);
      break;
  }
  return {};
}

}  // namespace

Result<void> check_meshopt(const DocMeshopt& stated, uint64_t view_bytes, uint64_t view_stride) {
  if (stated.unknown_mode.has_value())
    return Error{ErrorCode::kFormat,
                 "mode is \"" + *stated.unknown_mode + "\", expected ATTRIBUTES, TRIANGLES or INDICES"};
  if (stated.mode != Mode::kAttributes && stated.filter != Filter::kNone)
    return Error{ErrorCode::kFormat, std::string("a filter, but the mode is ") + rule_of(stated.mode).name};
  if (auto checked = check_stride(stated); !checked) return checked;
  if (view_stride != 0 && view_stride != stated.stride)
    return Error{ErrorCode::kFormat,
                 "byteStride is " + number(stated.stride) + ", but the buffer view's is " + number(view_stride)};
  if (stated.mode == Mode::kTriangles && stated.count % 3 != 0)
    return Error{ErrorCode::kFormat, "count is " + number(stated.count) + ", expected a multiple of 3 for TRIANGLES"};
  const auto unpacked = format::checked_mul(stated.count, stated.stride);
  if (!unpacked || *unpacked != view_bytes)
    return Error{ErrorCode::kRange, number(stated.count) + " elements of " + number(stated.stride) +
                                        " bytes, but the buffer view has " + number(view_bytes) + " bytes"};
  if (*unpacked > kMaxUnpackedBytes)
    return Error{ErrorCode::kUnsupported,
                 "unpacks to " + number(*unpacked) + " bytes, at most " + number(kMaxUnpackedBytes) + " are read"};
  const auto fewest = fewest_bytes(stated.mode, stated.count, stated.stride);
  if (!fewest || *fewest > stated.bytes)
    return Error{ErrorCode::kTruncated,
                 number(stated.count) + " elements do not fit into " + number(stated.bytes) + " bytes"};
  return {};
}

class KeptViews {
 public:
  explicit KeptViews(uint64_t most) : most_(most) {}

  std::shared_ptr<const Bytes> find(const void* owner) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
      if (entry->owner != owner) continue;
      entries_.splice(entries_.begin(), entries_, entry);
      return entry->bytes;
    }
    return nullptr;
  }

  void keep(const void* owner, std::shared_ptr<const Bytes> bytes) {
    const std::lock_guard<std::mutex> lock(mutex_);
    total_ += bytes->size();
    entries_.push_front({owner, std::move(bytes)});
    while (total_ > most_ && entries_.size() > 1) {
      total_ -= entries_.back().bytes->size();
      entries_.pop_back();
    }
  }

  void forget(const void* owner) {
    const std::lock_guard<std::mutex> lock(mutex_);
    entries_.remove_if([&](const Entry& entry) {
      if (entry.owner != owner) return false;
      total_ -= entry.bytes->size();
      return true;
    });
  }

 private:
  struct Entry {
    const void* owner;
    std::shared_ptr<const Bytes> bytes;
  };

  std::mutex mutex_;
  const uint64_t most_;
  uint64_t total_ = 0;
  std::list<Entry> entries_;  // used last first; few, so they are searched
};

namespace {

class MeshoptSource final : public ByteSource {
 public:
  MeshoptSource(const DocMeshopt& stated, std::shared_ptr<const ByteSource> stream, std::shared_ptr<KeptViews> kept)
      : stated_(stated), stream_(std::move(stream)), kept_(std::move(kept)) {}
  ~MeshoptSource() override { kept_->forget(this); }

  uint64_t size() const override { return stated_.count * stated_.stride; }
  const std::string& path() const override { return stream_->path(); }

  Result<void> read(uint64_t offset, std::span<std::byte> out) const override {
    if (!format::range_within(offset, out.size(), size()))
      return Error{ErrorCode::kTruncated, "read of " + number(out.size()) + " bytes at " + number(offset) +
                                              ", but the buffer view has " + number(size())};
    if (out.empty()) return {};
    auto bytes = unpacked();
    if (!bytes) return bytes.error();
    std::memcpy(out.data(), (*bytes)->data() + offset, out.size());
    return {};
  }

 private:
  Result<std::shared_ptr<const Bytes>> unpacked() const {
    if (auto kept = kept_->find(this)) return kept;
    const std::lock_guard<std::mutex> lock(unpacking_);  // others wait for the same bytes
    if (auto kept = kept_->find(this)) return kept;
    const std::string place = "buffer view " + number(stated_.view) + ": " + stated_.extension();
    try {
      Bytes stream(stated_.bytes);
      if (auto read = stream_->read(stated_.offset, stream); !read) return read.error();
      auto bytes = std::make_shared<Bytes>(size());
      if (auto done = unpack(stated_, stream, *bytes); !done) return at(place, done.error());
      std::shared_ptr<const Bytes> kept = std::move(bytes);
      kept_->keep(this, kept);
      return kept;
    } catch (const std::bad_alloc&) {
      return Error{ErrorCode::kMemory, place + ": no memory for " + number(size()) + " bytes"};
    }
  }

  DocMeshopt stated_;
  std::shared_ptr<const ByteSource> stream_;
  std::shared_ptr<KeptViews> kept_;
  mutable std::mutex unpacking_;
};

}  // namespace

MeshoptCache::MeshoptCache(uint64_t kept_bytes) : kept_(std::make_shared<KeptViews>(kept_bytes)) {}

std::shared_ptr<const ByteSource> MeshoptCache::source(const DocMeshopt& stated,
                                                       std::shared_ptr<const ByteSource> stream) {
  return std::make_shared<MeshoptSource>(stated, std::move(stream), kept_);
}

}  // namespace scree::convert
