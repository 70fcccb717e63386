// The libFuzzer entry of the target that SCREE_FUZZ_TARGET names.
#include <string_view>

#include "tests/fuzz/mutate_container.h"
#include "tests/fuzz/targets.h"

namespace {

constexpr scree::fuzz::Target find(std::string_view name) {
  for (const scree::fuzz::Target& target : scree::fuzz::kTargets)
    if (name == target.name) return target;
  throw "no such target";
}
constexpr scree::fuzz::Target kTarget = find(SCREE_FUZZ_TARGET);

}  // namespace

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  kTarget.run({reinterpret_cast<const std::byte*>(data), size});
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size, unsigned seed) {
  if (!kTarget.is_container) return LLVMFuzzerMutate(data, size, max_size);
  return scree::fuzz::mutate_container(data, size, max_size, seed, LLVMFuzzerMutate);
}
