#include "tools/common/options/version.h"

#include "commit.h"
#include "runtime/draw/device_list.h"
#include "runtime/images/image.h"
#include "tools/gltf/draco/source.h"

namespace scree::tools {
namespace {

std::string compiler() {
#if defined(__clang__)
  return "Clang " __clang_version__;
#else
  return "GCC " __VERSION__;
#endif
}

/// The version of an optional library, or "none".
std::string or_none(const std::string& version) {
  return version.empty() ? "none" : version;
}

}  // namespace

std::string version_text() {
  const runtime::GpuList program = runtime::program_without_gpus();
  std::string text = "scree " SCREE_VERSION "\ncommit " SCREE_COMMIT "\ncompiler " + compiler() + "\nlibwebp " +
                     or_none(runtime::webp_version()) + "\nlibdraco " + or_none(convert::draco_version()) + "\n";
  if (program.program_cuda == 0) return text + "CUDA none";
  return text + "CUDA " + runtime::cuda_version_name(program.program_cuda) + ", code for " + program.code_for;
}

}  // namespace scree::tools
