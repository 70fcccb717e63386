#include "tools/gltf/meshopt_stream.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cstring>

namespace scree::convert {
namespace {

using Mode = DocMeshopt::Mode;
using Filter = DocMeshopt::Filter;

struct ModeRule {
  const char* name;
  uint32_t header;   // high half of the stream's first byte; the low half is its version
  uint32_t version;  // the newest that is read
};

const ModeRule& rule_of(Mode mode) {
  static constexpr ModeRule kAttributes{"ATTRIBUTES", 0xa0, 0}, kTriangles{"TRIANGLES", 0xe0, 1},
      kIndices{"INDICES", 0xd0, 1};
  return mode == Mode::kAttributes ? kAttributes : mode == Mode::kTriangles ? kTriangles : kIndices;
}

}  // namespace

const char* mode_name(Mode mode) {
  return rule_of(mode).name;
}

std::unique_ptr<const MeshoptStream> MeshoptStream::make(const DocMeshopt& stated,
                                                         std::shared_ptr<const ByteSource> source) {
  switch (stated.mode) {
    case Mode::kAttributes:
      return attribute_stream(stated, std::move(source));
    case Mode::kTriangles:
      return triangle_stream(stated, std::move(source));
    case Mode::kIndices:
      break;
  }
  return index_stream(stated, std::move(source));
}

Result<MeshoptPlace> MeshoptStream::begin() const {
  const ModeRule& rule = rule_of(stated_.mode);
  std::byte first{0};
  if (stated_.bytes > 0)
    if (auto read = source_->read(stated_.offset, std::span(&first, 1)); !read) return read.error();
  const uint32_t header = std::to_integer<uint32_t>(first);
  if ((header & 0xf0) != rule.header) return Error{ErrorCode::kFormat, name() + ": not a stream of " + rule.name};
  const uint32_t version = header & 0x0f;
  if (version > rule.version)
    return Error{ErrorCode::kUnsupported, name() + ": " + rule.name + " of version " + std::to_string(version) +
                                              ", but at most " + std::to_string(rule.version) + " is read"};
  return start(version);
}

void MeshoptStream::undo_filter(std::span<std::byte> elements) const {
  const size_t count = elements.size() / stated_.stride;
  switch (stated_.filter) {
    case Filter::kNone:
      break;
    case Filter::kOctahedral:
      meshopt_decodeFilterOct(elements.data(), count, stated_.stride);
      break;
    case Filter::kQuaternion:
      meshopt_decodeFilterQuat(elements.data(), count, stated_.stride);
      break;
    case Filter::kExponential:
      meshopt_decodeFilterExp(elements.data(), count, stated_.stride);
      break;
  }
}

std::string MeshoptStream::name() const {
  return "buffer view " + std::to_string(stated_.view) + ": " + stated_.extension();
}

Error MeshoptStream::ends_early() const {
  return {ErrorCode::kTruncated, name() + ": " + std::to_string(stated_.bytes) + " bytes end before " +
                                     std::to_string(stated_.count) + " elements are unpacked"};
}

Error MeshoptStream::has_more() const {
  return {ErrorCode::kTrailing, name() + ": " + std::to_string(stated_.bytes) + " bytes do not unpack to " +
                                    std::to_string(stated_.count) + " elements"};
}

Result<void> PieceReader::want(size_t bytes) {
  if (size() >= bytes || is_at_end()) return {};
  const size_t rest = size();
  std::memmove(bytes_.data() + kRoomBefore, data(), rest);
  const uint64_t more = std::min<uint64_t>(kPieceBytes - rest, end_ - next_);
  first_ = kRoomBefore;
  last_ = kRoomBefore + rest + more;
  if (auto read = source_.read(next_, std::span(bytes_).subspan(kRoomBefore + rest, more)); !read) return read;
  next_ += more;
  return {};
}

}  // namespace scree::convert
