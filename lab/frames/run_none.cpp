// Replaces run.cpp in a build without CUDA: frames of generated scenes are an error.
#include "lab/frames/run.h"
#include "lab/setup/machine.h"

namespace scree::lab {

Result<Machine> find_machine(const runtime::Gpu&) {
  return Error{ErrorCode::kDevice, "built without CUDA; frames are measured on a GPU (cmake --preset cuda-release)"};
}

Result<void> run_bench(const LabOptions&) {
  return find_machine({}).error();
}

}  // namespace scree::lab
