// What needs a GPU, where the program is built without CUDA.
#include "tools/bench/frames/run.h"
#include "tools/bench/setup/machine.h"

namespace scree::bench {

Result<Machine> find_machine(const runtime::Gpu&) {
  return Error{ErrorCode::kDevice, "built without CUDA; bench measures a GPU (cmake --preset cuda-release)"};
}

Result<double> measure_link() {
  return find_machine({}).error();
}

Result<void> run_bench(const BenchOptions&) {
  return find_machine({}).error();
}

}  // namespace scree::bench
