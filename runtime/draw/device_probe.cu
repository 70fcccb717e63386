#include "runtime/draw/device_probe.h"

namespace scree::runtime {
namespace {

/// Built for the same architectures as all kernels. It is small, so that a GPU that has to compile PTX takes no time
/// for it.
__global__ void probe(unsigned* out) {
  if (out != nullptr) *out = 1;
}

}  // namespace

cudaError_t probe_kernel() {
  cudaFuncAttributes attributes;
  return cudaFuncGetAttributes(&attributes, reinterpret_cast<const void*>(probe));
}

}  // namespace scree::runtime
