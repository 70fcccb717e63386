#include "tools/common/version.h"

#include "commit.h"
#include "runtime/draw/device_list.h"

namespace scree::tools {
namespace {

std::string compiler() {
#if defined(__clang__)
  return "Clang " __clang_version__;
#else
  return "GCC " __VERSION__;
#endif
}

}  // namespace

std::string version_text() {
  const runtime::GpuList program = runtime::program_without_gpus();
  std::string text = "scree " SCREE_VERSION "\ncommit " SCREE_COMMIT "\ncompiler " + compiler() + "\n";
  if (program.program_cuda == 0) return text + "CUDA none";
  return text + "CUDA " + runtime::cuda_version_name(program.program_cuda) + ", code for " + program.code_for;
}

}  // namespace scree::tools
