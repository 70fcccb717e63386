// The GIL, Python's global lock: calls without it, and calls of Python from the library.
#ifndef SCREE_PYTHON_GIL_H
#define SCREE_PYTHON_GIL_H

#include <cxxabi.h>
#include <unistd.h>

#include <pybind11/pybind11.h>

#include <optional>

namespace scree_python {

namespace py = pybind11;

[[noreturn]] inline void sleep_forever() {
  for (;;) pause();
}

/// Runs `call`, which takes the GIL. If the interpreter has ended meanwhile, Python before 3.14 unwinds the thread,
/// which would end the process with an error at the first destructor. Such a thread sleeps here instead, as in
/// Python 3.14.
template <class Call>
auto take_gil(const Call& call) {
  try {
    return call();
  } catch (const abi::__forced_unwind&) {
    sleep_forever();
  }
}

class WithoutGil {
 public:
  WithoutGil() : state_(PyEval_SaveThread()) {}
  ~WithoutGil() {
    take_gil([&] { PyEval_RestoreThread(state_); });
  }
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

 private:
  PyThreadState* state_;
};

class WithGil {
 public:
  WithGil() : state_(take_gil([] { return PyGILState_Ensure(); })) {}
  ~WithGil() { PyGILState_Release(state_); }
  WithGil(const WithGil&) = delete;
  WithGil& operator=(const WithGil&) = delete;

 private:
  PyGILState_STATE state_;
};

/// Calls `call` without the GIL. `call` may wait for a view or a GPU that another thread uses, and that thread may need
/// the GIL.
template <class Call>
auto without_gil(const Call& call) {
  const WithoutGil release;
  return call();
}

/// Deletes an object without the GIL, on the thread that drops the last reference.
template <class T>
void end(T* object) {
  std::optional<WithoutGil> release;
  if (Py_IsInitialized() != 0 && PyGILState_Check() != 0) release.emplace();
  delete object;
}

}  // namespace scree_python

#endif
