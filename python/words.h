// Words of options and texts of the library in Python.
#ifndef SCREE_PYTHON_WORDS_H
#define SCREE_PYTHON_WORDS_H

#include <pybind11/pybind11.h>

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

namespace scree_python {

namespace py = pybind11;

// The index of a word is its value in scree.h.
constexpr std::array<const char*, 9> kShows{"texture", "color", "uv",    "normal", "triangle",
                                            "cluster", "mesh",  "stage", "depth"};
constexpr std::array<const char*, 4> kLights{"auto", "camera", "environment", "scene"};
constexpr std::array<const char*, 4> kReadings{"auto", "mapped", "buffered", "direct"};
constexpr std::array<const char*, 3> kBackends{"auto", "cpu", "cuda"};
constexpr std::array<const char*, 3> kTextures{"keep", "raw", "jpeg"};
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

/// A text of the library. Names in files may be any bytes: those that are not UTF-8 become \\xNN.
inline py::str text_of(std::string_view text) {
  PyObject* const made = PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "backslashreplace");
  if (made == nullptr) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(made);
}

}  // namespace scree_python

#endif
