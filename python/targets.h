// The caller's arrays, into which a batch is drawn.
#ifndef SCREE_PYTHON_TARGETS_H
#define SCREE_PYTHON_TARGETS_H

#include <pybind11/pybind11.h>

#include <scree/scree.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace scree_python {

namespace py = pybind11;

struct Targets {
  std::vector<scree_target> all;
  std::vector<py::object> owners;  // keep the arrays' memory alive; destroyed only with the GIL
  uint32_t width;
  uint32_t height;
  void* stream;  // a cudaStream_t; null: the default stream
};

/// Checks `arrays`, by layer, for `cameras` pictures that GPU `gpu` draws (-1: the CPU), and takes their addresses. An
/// array is a numpy array, or has __cuda_array_interface__ or __dlpack__. `stream`: a number; None takes the stream
/// that the arrays name, else the default stream. Throws TypeError (no array, another dtype) and ValueError (shape,
/// gaps, read-only, alignment, device, stream). The text begins with the array's name, such as targets['depth'].
Targets take_targets(const py::dict& arrays, size_t cameras, int gpu, const py::object& stream);

}  // namespace scree_python

#endif
