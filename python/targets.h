// Arrays of the caller's that a batch is drawn into.
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
  std::vector<py::object> owners;  // keep the memory while it is drawn into; the GIL is needed to drop them
  uint32_t width;
  uint32_t height;
  void* stream;  // a cudaStream_t; null: the default stream
};

/// Checks `arrays`, by layer, for `cameras` pictures that GPU `gpu` draws (-1: the CPU), and takes their addresses. An
/// array is numpy's, or has __cuda_array_interface__ or __dlpack__. `stream`: a number, or None: the one that the
/// arrays name, else the default stream. Throws TypeError (no array, another dtype) and ValueError (shape, gaps,
/// read-only, alignment, device, stream), whose text begins with the array's place.
Targets take_targets(const py::dict& arrays, size_t cameras, int gpu, const py::object& stream);

}  // namespace scree_python

#endif
