#include "format/container/part_log.h"

#include <cstring>
#include <vector>

#include "format/container/checksum.h"

namespace scree::format {
namespace {

constexpr uint8_t kMarkMagic[8] = {0x89, 'S', 'C', 'R', 'P', 'A', 'R', 'T'};
constexpr uint32_t kLogVersion = 1;
constexpr uint32_t kMaxEntryBytes = 1u << 30;  // a batch of windows whose chunks are single triangles takes 27 MB

struct Mark {
  uint8_t magic[8];
  uint32_t version;
  uint32_t reserved;
  uint64_t offset;
  PartId id;
  uint64_t reserved2[2];
  uint64_t checksum;  // of the fields before it
};
static_assert(sizeof(Mark) == 64);

struct EntryHead {
  uint32_t kind;
  uint32_t bytes;
  uint64_t checksum;  // of kind, bytes and the bytes that follow
};
static_assert(sizeof(EntryHead) == 16);

uint64_t checksum_of(const EntryHead& head, std::span<const std::byte> entry) {
  Checksum sum;
  sum.add(std::as_bytes(std::span(&head, 1)).first(offsetof(EntryHead, checksum)));
  sum.add(entry);
  return sum.value();
}

uint64_t checksum_of(const Mark& mark) {
  return checksum(std::as_bytes(std::span(&mark, 1)).first(offsetof(Mark, checksum)));
}

}  // namespace

Result<PartLog> PartLog::start(const PartFile& file, const PartId& id, uint64_t offset) {
  Mark mark{};
  std::memcpy(mark.magic, kMarkMagic, sizeof kMarkMagic);
  mark.version = kLogVersion;
  mark.offset = offset;
  mark.id = id;
  mark.checksum = checksum_of(mark);
  SCREE_TRY(file.write_at(0, std::as_bytes(std::span<const Mark>(&mark, 1))));
  PartLog log;
  log.offset_ = log.end_ = offset;
  return log;
}

Result<PartLog> PartLog::read(const PartFile& file, const PartId& id, const Take& take) {
  const auto bytes = SCREE_TRY(file.size());
  Mark mark{};
  if (bytes < sizeof mark) return Error{ErrorCode::kFormat, "it has nothing to go on from"};
  SCREE_TRY(file.read_at(0, std::as_writable_bytes(std::span(&mark, 1))));
  if (std::memcmp(mark.magic, kMarkMagic, sizeof kMarkMagic) != 0 || mark.checksum != checksum_of(mark) ||
      mark.version != kLogVersion)
    return Error{ErrorCode::kFormat, "it has nothing to go on from"};
  if (mark.id != id) return Error{ErrorCode::kFormat, "it was made from another input or with other options"};

  PartLog log;
  log.offset_ = log.end_ = mark.offset;
  std::vector<std::byte> entry;
  for (;;) {
    EntryHead head{};
    if (log.end_ > bytes || bytes - log.end_ < sizeof head) break;
    SCREE_TRY(file.read_at(log.end_, std::as_writable_bytes(std::span(&head, 1))));
    if (head.bytes > kMaxEntryBytes || bytes - log.end_ - sizeof head < head.bytes) break;
    entry.resize(head.bytes);
    SCREE_TRY(file.read_at(log.end_ + sizeof head, entry));
    if (head.checksum != checksum_of(head, entry)) break;
    take(head.kind, entry);
    log.end_ += sizeof head + head.bytes;
  }
  return log;
}

Result<void> PartLog::add(const PartFile& file, uint32_t kind, std::span<const std::byte> entry) {
  if (entry.size() > kMaxEntryBytes) return Error{ErrorCode::kRange, file.path() + ": an entry too long for its log"};
  EntryHead head{kind, static_cast<uint32_t>(entry.size()), 0};
  head.checksum = checksum_of(head, entry);
  // One write takes half the time of two. A half-written entry fails its checksum and is ignored.
  std::vector<std::byte> all(sizeof head + entry.size());
  std::memcpy(all.data(), &head, sizeof head);
  if (!entry.empty()) std::memcpy(all.data() + sizeof head, entry.data(), entry.size());
  SCREE_TRY(file.write_at(end_, all));
  end_ += all.size();
  return {};
}

}  // namespace scree::format
