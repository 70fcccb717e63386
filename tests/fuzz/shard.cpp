// The parts of a shard that scree merge reads: its plan and its share.
#include "tools/convert/passes/shard.h"

#include "tests/fuzz/input.h"

namespace scree::fuzz {

void shard(Bytes bytes) {
  const ExactCopy copy(bytes);
  if (const auto plan = convert::unpack_plan(copy.bytes()); plan) {
    const std::vector<std::byte> again = convert::pack_plan(*plan);
    const auto same = convert::unpack_plan(again);
    must(same && convert::pack_plan(*same) == again, "a plan is packed as it was unpacked");
  }
  if (const auto share = convert::unpack_share(copy.bytes()); share) {
    const std::vector<std::byte> again = convert::pack_share(*share);
    must(again.size() == bytes.size(), "a share is packed as it was unpacked");
  }
}

}  // namespace scree::fuzz
