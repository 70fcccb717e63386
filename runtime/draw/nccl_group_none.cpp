// NcclGroup where the program is built without CUDA.
#include "runtime/draw/nccl_group.h"

#include <utility>

namespace scree::runtime {

struct NcclGroup::Impl {};

NcclGroup::NcclGroup(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NcclGroup::NcclGroup(NcclGroup&&) noexcept = default;
NcclGroup& NcclGroup::operator=(NcclGroup&&) noexcept = default;
NcclGroup::~NcclGroup() = default;

namespace {
Error none() {
  return {ErrorCode::kUnsupported, "this program was built without CUDA"};
}
}  // namespace

Result<NcclGroup> NcclGroup::open() {
  return none();
}
Result<NcclGroup::Id> NcclGroup::make_id() const {
  return none();
}
Result<void> NcclGroup::connect(const Id&, uint32_t, uint32_t, uint64_t) {
  return none();
}
Result<void> NcclGroup::least(uint64_t*, uint64_t, void*) {
  return none();
}
Result<void> NcclGroup::most(uint32_t*, uint64_t, uint32_t, void*) {
  return none();
}
Result<void> NcclGroup::wait(void*) {
  return none();
}

}  // namespace scree::runtime
