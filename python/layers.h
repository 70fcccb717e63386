// The layers of a view in Python: names and numpy's types.
#ifndef SCREE_PYTHON_LAYERS_H
#define SCREE_PYTHON_LAYERS_H

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <scree/scree.h>

#include <cstdint>
#include <string>

#include "words.h"

namespace scree_python {

namespace py = pybind11;

inline scree_layer layer_of(const std::string& word) {
  return static_cast<scree_layer>(number_of(kLayers, word, "layer"));
}

inline py::dtype numpy_type(scree_type type) {
  if (type == SCREE_UINT8) return py::dtype::of<uint8_t>();
  if (type == SCREE_FLOAT32) return py::dtype::of<float>();
  if (type == SCREE_INT64) return py::dtype::of<int64_t>();
  if (type == SCREE_INT32) return py::dtype::of<int32_t>();
  return py::dtype::of<uint64_t>();
}

}  // namespace scree_python

#endif
