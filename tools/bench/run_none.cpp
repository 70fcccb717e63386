// run_bench() where the program is built without CUDA.
#include "tools/bench/run.h"

namespace scree::bench {

Result<void> run_bench(const BenchOptions&) {
  return Error{ErrorCode::kDevice, "built without CUDA; bench measures a GPU (cmake --preset cuda-release)"};
}

}  // namespace scree::bench
