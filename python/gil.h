// Calls without the GIL, Python's global lock.
#ifndef SCREE_PYTHON_GIL_H
#define SCREE_PYTHON_GIL_H

#include <pybind11/pybind11.h>

#include <optional>

namespace scree_python {

namespace py = pybind11;

/// Calls `call` without the GIL. `call` may wait for a view or a GPU that another thread uses, and that thread may need
/// the GIL.
template <class Call>
auto without_gil(const Call& call) {
  const py::gil_scoped_release release;
  return call();
}

/// Deletes an object without the GIL, on the thread that drops the last reference.
template <class T>
void end(T* object) {
  std::optional<py::gil_scoped_release> release;
  if (Py_IsInitialized() != 0 && PyGILState_Check() != 0) release.emplace();
  delete object;
}

}  // namespace scree_python

#endif
