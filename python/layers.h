// The layers of a view in Python: names and numpy's types.
#ifndef SCREE_PYTHON_LAYERS_H
#define SCREE_PYTHON_LAYERS_H

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <scree/scree.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace scree_python {

namespace py = pybind11;

constexpr std::array<const char*, 8> kLayers{"color",   "depth",  "triangle", "instance",
                                             "samples", "normal", "uv",       "linear"};

/// The index of a word. Throws ValueError, with a list of the words, for another word. `what`: the argument's name.
template <size_t kCount>
int number_of(const std::array<const char*, kCount>& words, const std::string& word, const char* what) {
  std::string all;
  for (size_t i = 0; i < kCount; ++i) {
    if (word == words[i]) return static_cast<int>(i);
    all += (i == 0 ? "" : ", ") + std::string(words[i]);
  }
  throw py::value_error(std::string(what) + ": '" + word + "' is not one of " + all);
}

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
