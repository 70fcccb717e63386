#include "targets.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <scree/scree.hpp>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "dlpack.h"
#include "layers.h"
#include "library/layers.h"

namespace scree_python {
namespace {

using namespace py::literals;

constexpr int kHost = -1;
constexpr int kSomeGpu = -2;  // the protocol has no index; the library checks the device

/// An array of any protocol.
struct Given {
  void* data = nullptr;
  std::string type;  // numpy's name
  std::vector<int64_t> shape;
  std::vector<int64_t> strides;  // in elements; empty: no gaps
  bool read_only = false;
  int device = kHost;               // or a GPU's index, or kSomeGpu
  std::optional<uintptr_t> stream;  // the stream of the work that fills the array
  py::object owner;
};

/// The attribute, or none; errors other than a missing attribute are raised.
std::optional<py::object> attribute(const py::handle& object, const char* name) {
  PyObject* const found = PyObject_GetAttrString(object.ptr(), name);
  if (found != nullptr) return py::reinterpret_steal<py::object>(found);
  if (PyErr_ExceptionMatches(PyExc_AttributeError) == 0) throw py::error_already_set();
  PyErr_Clear();
  return std::nullopt;
}

std::string type_name(const py::dtype& type) {
  return py::str(static_cast<const py::object&>(type)).cast<std::string>();
}

std::string words(const std::vector<int64_t>& shape) {
  return py::str(py::tuple(py::cast(shape)));
}

/// Strides in elements from strides in bytes. A stride that is no multiple of an element becomes 0, which counts as a
/// gap.
std::vector<int64_t> in_elements(const std::vector<int64_t>& bytes, int64_t item) {
  std::vector<int64_t> out;
  for (const int64_t stride : bytes) out.push_back(item > 0 && stride % item == 0 ? stride / item : 0);
  return out;
}

Given of_numpy(const py::array& array) {
  Given given;
  given.data = const_cast<void*>(array.data());
  given.type = type_name(array.dtype());
  given.shape.assign(array.shape(), array.shape() + array.ndim());
  given.strides = in_elements({array.strides(), array.strides() + array.ndim()}, array.itemsize());
  given.read_only = !array.writeable();
  given.owner = array;
  return given;
}

/// CUDA Array Interface, versions 0 to 3.
Given of_cuda_interface(const py::object& object, const py::dict& interface) {
  Given given;
  const auto data = interface["data"].cast<std::pair<uintptr_t, bool>>();
  given.data = reinterpret_cast<void*>(data.first);
  given.read_only = data.second;
  const py::dtype type = py::dtype::from_args(interface["typestr"]);
  given.type = type_name(type);
  given.shape = interface["shape"].cast<std::vector<int64_t>>();
  if (interface.contains("strides") && !interface["strides"].is_none())
    given.strides = in_elements(interface["strides"].cast<std::vector<int64_t>>(), type.itemsize());
  if (interface.contains("stream") && !interface["stream"].is_none())
    given.stream = interface["stream"].cast<uintptr_t>();
  given.device = kSomeGpu;
  if (const std::optional<py::object> device = attribute(object, "__dlpack_device__"))
    given.device = (*device)().cast<std::pair<int, int>>().second;
  given.owner = object;
  return given;
}

std::string type_name(const DlDataType& type) {
  constexpr std::array<const char*, 7> kNames{"int", "uint", "float", "handle", "bfloat", "complex", "bool"};
  return (type.code < kNames.size() ? kNames[type.code] : "type") + std::to_string(type.bits) +
         (type.lanes == 1 ? "" : "x" + std::to_string(type.lanes));
}

/// The capsule is not renamed, so it still owns the tensor and releases it when it is destroyed.
Given of_dlpack(const py::object& object, const py::object& method, int device, const py::object& stream) {
  py::dict arguments;
  if (device != kHost) arguments["stream"] = stream;
  py::object capsule;
  try {
    capsule = method(**arguments, "max_version"_a = py::make_tuple(1, 0));
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_TypeError)) throw;
    capsule = method(**arguments);  // producer older than DLPack 1.0
  }
  Given given;
  const DlTensor* tensor = nullptr;
  if (PyCapsule_IsValid(capsule.ptr(), "dltensor_versioned") != 0) {
    const auto* const managed =
        static_cast<const DlVersionedTensor*>(PyCapsule_GetPointer(capsule.ptr(), "dltensor_versioned"));
    if (managed->major != 1)
      throw py::buffer_error("DLPack version " + std::to_string(managed->major) + " is not supported");
    given.read_only = (managed->flags & kDlReadOnly) != 0;
    tensor = &managed->tensor;
  } else if (PyCapsule_IsValid(capsule.ptr(), "dltensor") != 0) {
    tensor = &static_cast<const DlManagedTensor*>(PyCapsule_GetPointer(capsule.ptr(), "dltensor"))->tensor;
  } else {
    throw py::type_error("__dlpack__() returned no DLPack capsule");
  }
  given.data = static_cast<std::byte*>(tensor->data) + tensor->byte_offset;
  given.type = type_name(tensor->type);
  given.shape.assign(tensor->shape, tensor->shape + tensor->dimensions);
  if (tensor->strides != nullptr) given.strides.assign(tensor->strides, tensor->strides + tensor->dimensions);
  given.device = device;
  given.owner = py::make_tuple(object, capsule);
  return given;
}

/// `stream`: passed to producers of DLPack, which finish their work before later work on it.
Given describe(const std::string& place, const py::object& object, const py::object& stream) {
  if (py::isinstance<py::array>(object)) return of_numpy(py::reinterpret_borrow<py::array>(object));
  if (const std::optional<py::object> interface = attribute(object, "__cuda_array_interface__"))
    return of_cuda_interface(object, interface->cast<py::dict>());
  const std::optional<py::object> method = attribute(object, "__dlpack__");
  const std::optional<py::object> asked = attribute(object, "__dlpack_device__");
  if (!method || !asked)
    throw py::type_error(place + ": " + std::string(py::str(py::type::handle_of(object).attr("__name__"))) +
                         " is no numpy array and has neither __cuda_array_interface__ nor __dlpack__");
  const auto [type, index] = (*asked)().cast<std::pair<int, int>>();
  if (type == kDlCpu || type == kDlCudaHost) return of_dlpack(object, *method, kHost, stream);
  if (type == kDlCuda || type == kDlCudaManaged) return of_dlpack(object, *method, index, stream);
  throw py::value_error(place + ": its memory is neither the host's nor a CUDA GPU's (DLPack device " +
                        std::to_string(type) + ")");
}

bool has_gaps(const Given& given) {
  if (given.strides.empty()) return false;
  int64_t expected = 1;
  for (size_t i = given.shape.size(); i-- > 0;) {
    if (given.shape[i] != 1 && given.strides[i] != expected) return true;
    expected *= given.shape[i];
  }
  return false;
}

std::string memory_name(int device) {
  if (device == kHost) return "host memory";
  return device == kSomeGpu ? "GPU memory" : "the memory of GPU " + std::to_string(device);
}

void check_memory(const std::string& place, const Given& given, int gpu) {
  if (has_gaps(given)) throw py::value_error(place + ": not contiguous: rows follow each other without gaps (C order)");
  if (given.read_only) throw py::value_error(place + ": read-only");
  if (reinterpret_cast<uintptr_t>(given.data) % 16 != 0)
    throw py::value_error(place + ": its memory does not begin at a multiple of 16 bytes");
  if (given.device != gpu && (given.device != kSomeGpu || gpu < 0))
    throw py::value_error(place + ": it lies in " + memory_name(given.device) + ", but " +
                          (gpu < 0 ? "the CPU draws" : "GPU " + std::to_string(gpu) + " draws"));
}

/// Checks `stream`: None, or a number as in the array API (1: the default stream, 2: the calling thread's own).
py::object checked_stream(const py::object& stream) {
  if (stream.is_none()) return stream;
  if (!PyLong_Check(stream.ptr()))
    throw py::type_error(
        "stream: expected None or a cudaStream_t as an int, such as torch.cuda.current_stream().cuda_stream");
  if (stream < py::int_(0) || stream > py::int_(INT64_MAX))
    throw py::value_error("stream: " + py::str(stream).cast<std::string>() + " is no cudaStream_t");
  return stream;
}

}  // namespace

Targets take_targets(const py::dict& arrays, size_t cameras, int gpu, const py::object& stream) {
  Targets out{};
  if (arrays.empty()) throw py::value_error("targets: a batch needs at least one layer");
  const py::object number = checked_stream(stream);
  // DLPack forbids 0 on CUDA, because it does not distinguish the two default streams.
  const py::object ordered = number.is_none() || number.equal(py::int_(0)) ? py::int_(1) : number;
  std::optional<uintptr_t> named;
  std::string first;
  for (const auto& [key, value] : arrays) {
    if (!py::isinstance<py::str>(key))
      throw py::type_error("targets: the key " + py::repr(key).cast<std::string>() + " is no name of a layer");
    const auto name = key.cast<std::string>();
    const std::string place = "targets['" + name + "']";
    const scree_layer layer = layer_of(name);
    if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) throw py::value_error(place + ": a batch has no such layer");
    const scree::library::LayerKind kind = scree::library::kLayerKinds[static_cast<size_t>(layer)];
    const Given given = describe(place, py::reinterpret_borrow<py::object>(value), ordered);
    const auto type = type_name(numpy_type(kind.type));
    if (given.type != type) throw py::type_error(place + ": dtype " + given.type + ", expected " + type);
    const std::vector<int64_t>& shape = given.shape;
    if (shape.size() != (kind.channels == 0 ? 3u : 4u) || shape[0] != static_cast<int64_t>(cameras) ||
        (kind.channels != 0 && shape[3] != kind.channels))
      throw py::value_error(place + ": shape " + words(shape) + ", expected (" + std::to_string(cameras) +
                            ", height, width" + (kind.channels == 0 ? "" : ", " + std::to_string(kind.channels)) +
                            ") for " + std::to_string(cameras) + " cameras");
    // The library refuses UINT32_MAX too, so clamping changes no result.
    const auto height = static_cast<uint32_t>(std::clamp<int64_t>(shape[1], 0, UINT32_MAX));
    const auto width = static_cast<uint32_t>(std::clamp<int64_t>(shape[2], 0, UINT32_MAX));
    if (width == 0 || height == 0) throw py::value_error(place + ": shape " + words(shape) + " has no pixels");
    if (!first.empty() && (height != out.height || width != out.width))
      throw py::value_error(place + ": " + std::to_string(height) + " x " + std::to_string(width) + " pixels, but " +
                            first + " has " + std::to_string(out.height) + " x " + std::to_string(out.width));
    check_memory(place, given, gpu);
    if (number.is_none() && given.stream) {
      if (named && *named != *given.stream)
        throw py::value_error(
            place + ": its work is on another CUDA stream than the other arrays' work: choose one with `stream`");
      named = given.stream;
    }
    if (first.empty()) first = place;
    out.height = height;
    out.width = width;
    scree_target target = scree::make<scree_target>();
    target.layer = layer;
    target.data = given.data;
    target.bytes = static_cast<uint64_t>(py::ssize_t{numpy_type(kind.type).itemsize()}) *
                   std::max<uint64_t>(kind.channels, 1) * cameras * width * height;
    out.all.push_back(target);
    out.owners.push_back(given.owner);
  }
  const uintptr_t chosen = number.is_none() ? named.value_or(0) : number.cast<uintptr_t>();
  out.stream = chosen <= 1 ? nullptr : reinterpret_cast<void*>(chosen);
  return out;
}

}  // namespace scree_python
