// The C++ module of the Python package: it wraps scree.hpp, with numpy arrays on the CPU and DLPack on the GPU.
// python/scree/__init__.py is the public interface, and python/scree/__init__.pyi has its types.
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <scree/scree.hpp>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cameras.h"
#include "dlpack.h"
#include "gil.h"
#include "layers.h"
#include "library/layers.h"
#include "records.h"
#include "targets.h"
#include "words.h"

using namespace scree_python;
using namespace py::literals;

namespace {

DlDataType dl_type(scree_type type) {
  if (type == SCREE_UINT8) return {1, 8, 1};
  if (type == SCREE_FLOAT32) return {2, 32, 1};
  if (type == SCREE_INT64) return {0, 64, 1};
  if (type == SCREE_INT32) return {0, 32, 1};
  return {1, 64, 1};
}

std::vector<py::ssize_t> shape_of(const scree_array& array) {
  return {array.shape, array.shape + array.dimensions};
}

/// The type and shape of a layer, computed from the frame's size without making the layer.
scree_array describe(const scree::View& view, scree_layer layer) {
  const scree_frame_stats stats = without_gil([&] { return view.stats(); });
  return scree::library::array_of(layer, stats.cameras, stats.height, stats.width, stats.samples);
}

py::array read(const scree::View& view, scree_layer layer) {
  const scree_array array = describe(view, layer);
  py::array out(numpy_type(array.type), shape_of(array));
  void* const data = out.mutable_data();
  const auto bytes = static_cast<uint64_t>(out.nbytes());
  const WithoutGil release;
  view.read(layer, data, bytes);
  return out;
}

/// A layer in the memory where it was made, for consumers of DLPack. No copy is made.
struct SharedLayer {
  std::shared_ptr<scree::View> view;
  scree_layer layer;
  int gpu;  // -1: host memory

  std::pair<int, int> device() const {
    return gpu < 0 ? std::pair<int, int>{kDlCpu, 0} : std::pair<int, int>{kDlCuda, gpu};
  }

  /// `stream`: numbered as in the array API: None and 1 are the default stream, 2 is the calling thread's own, -1 is no
  /// stream, and any other number is a cudaStream_t.
  py::capsule dlpack(const py::object& stream, const py::object& version, const py::object& wanted,
                     const py::object& copy) const {
    (void)version;  // the newest version that the consumer supports; capsules without a version work for all
    if (!copy.is_none() && PyObject_IsTrue(copy.ptr()) == 1)
      throw py::buffer_error("a shared layer cannot be a copy: use View.read()");
    if (!wanted.is_none() && !wanted.equal(py::make_tuple(device().first, device().second)))
      throw py::buffer_error("the layer lies on another device than dl_device");
    scree_array array;
    std::shared_ptr<scree_memory> memory;
    if (gpu < 0) {
      const WithoutGil release;
      array = view->host_layer(layer);
      memory = view->hold(array);
    } else {
      const int64_t number = stream.is_none() ? 1 : stream.cast<int64_t>();
      if (number == 0 || number < -1) throw py::value_error("stream: expected None, -1, 1, 2 or a cudaStream_t");
      void* const waits = number <= 1 ? nullptr : reinterpret_cast<void*>(number);
      const WithoutGil release;
      array = view->device_layer(layer, waits);
      memory = view->hold(array);
    }
    struct Shared {
      DlManagedTensor managed;
      std::shared_ptr<scree_memory> memory;
      std::array<int64_t, 4> shape;
    };
    auto shared = std::make_unique<Shared>();
    shared->memory = std::move(memory);
    std::copy(array.shape, array.shape + 4, shared->shape.begin());
    DlTensor& tensor = shared->managed.tensor;
    tensor.data = const_cast<void*>(array.data);
    tensor.device = {device().first, device().second};
    tensor.dimensions = static_cast<int32_t>(array.dimensions);
    tensor.type = dl_type(array.type);
    tensor.shape = shared->shape.data();
    tensor.strides = nullptr;
    tensor.byte_offset = 0;
    shared->managed.context = shared.get();
    shared->managed.deleter = [](DlManagedTensor* managed) { end(static_cast<Shared*>(managed->context)); };
    PyObject* const capsule = PyCapsule_New(&shared.get()->managed, "dltensor", [](PyObject* object) {
      if (PyCapsule_IsValid(object, "dltensor") == 0) return;  // a consumer has taken it
      auto* const managed = static_cast<DlManagedTensor*>(PyCapsule_GetPointer(object, "dltensor"));
      managed->deleter(managed);
    });
    if (capsule == nullptr) throw py::error_already_set();
    (void)shared.release();
    return py::reinterpret_steal<py::capsule>(capsule);
  }
};

/// An option of shading and its name in Python.
struct Shading {
  const char* name;
  void (*set)(scree_draw_options&, const py::handle&);
};

void set_flag(scree_draw_options& options, bool is_set, uint32_t bit) {
  options.flags |= is_set ? bit : 0u;
}

template <uint32_t kBit>
void flag(scree_draw_options& options, const py::handle& value) {
  set_flag(options, value.cast<bool>(), kBit);
}

template <auto kMember>
void number(scree_draw_options& options, const py::handle& value) {
  options.*kMember = value.cast<std::decay_t<decltype(options.*kMember)>>();
}

constexpr std::array<Shading, 11> kShading{{
    {"show",
     [](scree_draw_options& options, const py::handle& value) {
       options.show = static_cast<scree_show>(number_of(kShows, value.cast<std::string>(), "show"));
     }},
    {"light",
     [](scree_draw_options& options, const py::handle& value) {
       if (py::isinstance<py::bool_>(value)) return set_flag(options, !value.cast<bool>(), SCREE_NO_LIGHT);
       options.light = static_cast<scree_light>(number_of(kLights, value.cast<std::string>(), "light"));
     }},
    {"exposure", number<&scree_draw_options::exposure>},
    {"blend_layers",
     [](scree_draw_options& options, const py::handle& value) {
       options.blend_layers = value.cast<uint32_t>();
       set_flag(options, options.blend_layers == 0, SCREE_NO_BLEND);
     }},
    {"shadows", flag<SCREE_SHADOWS>},
    {"shadow_size", number<&scree_draw_options::shadow_size>},
    {"ssao", flag<SCREE_SSAO>},
    {"edl", flag<SCREE_EDL>},
    {"edl_strength", number<&scree_draw_options::edl_strength>},
    {"edl_radius", number<&scree_draw_options::edl_radius>},
    {"background",
     [](scree_draw_options& options, const py::handle& value) {
       const auto background = value.cast<std::array<float, 4>>();
       std::copy(background.begin(), background.end(), options.background);
     }},
}};

/// `shading`: all options except sizes, by name. Throws TypeError for an unknown name or a value of another type, and
/// ValueError for a size of 0, or for another number that C takes as the default.
scree_draw_options draw_options(uint32_t width, uint32_t height, uint32_t samples, const py::dict& shading) {
  auto options = scree::make<scree_draw_options>();
  options.width = width;
  options.height = height;
  options.samples = samples;
  if (width == 0 || height == 0 || samples == 0) throw py::value_error("width, height and samples must be at least 1");
  for (const auto& [key, value] : shading) {
    const auto name = key.cast<std::string>();
    const auto* const found =
        std::find_if(kShading.begin(), kShading.end(), [&](const Shading& option) { return name == option.name; });
    if (found == kShading.end()) {
      std::string all;
      for (const Shading& option : kShading) all += (all.empty() ? "" : ", ") + std::string(option.name);
      throw py::type_error("'" + name + "' is not one of " + all);
    }
    try {
      found->set(options, value);
    } catch (const py::cast_error&) {
      throw py::type_error(name + ": " + py::repr(value).cast<std::string>() + " is of another type, or out of range");
    }
  }
  // In C these mean the default.
  if (shading.contains("edl_strength") && options.edl_strength == 0) options.flags &= ~uint32_t{SCREE_EDL};
  if (shading.contains("edl_radius") && options.edl_radius == 0)
    throw py::value_error("edl_radius: 0, expected 1 to 64");
  if (shading.contains("shadow_size") && options.shadow_size == 0)
    throw py::value_error("shadow_size: 0, expected 64 to 16384");
  return options;
}

/// Receives the progress and the warnings of loading and converting.
class Heard {
 public:
  /// `progress`: a Python function as a scree_progress, or None.
  explicit Heard(py::object progress) : progress_(std::move(progress)) {}

  /// Makes `options` report to this object, and calls `call` without the GIL. Throws an exception of `progress` again.
  template <class Options, class Call>
  void listen(Options& options, const Call& call) {
    options.user = this;
    if (!progress_.is_none()) options.progress = &Heard::hear;
    options.warning = &Heard::warn;
    try {
      without_gil(call);
    } catch (const scree::Error&) {
      if (!raised_) throw;
    }
    if (raised_) std::rethrow_exception(raised_);
  }

  py::list warnings() const {
    py::list lines;
    for (const std::string& line : warnings_) lines.append(text_of(line));
    return lines;
  }

 private:
  static int hear(void* user, const char* stage, uint64_t done, uint64_t total) {
    auto& heard = *static_cast<Heard*>(user);
    const WithGil acquire;
    try {
      const py::object answer = heard.progress_(text_of(stage), done, total);
      const int is_true = answer.is_none() ? 1 : PyObject_IsTrue(answer.ptr());
      if (is_true < 0) throw py::error_already_set();
      return is_true == 0 ? 1 : 0;
    } catch (const abi::__forced_unwind&) {  // the interpreter has ended
      sleep_forever();
    } catch (...) {
      heard.raised_ = std::current_exception();
      return 1;
    }
  }
  static void warn(void* user, const char* line) { static_cast<Heard*>(user)->warnings_.emplace_back(line); }

  py::object progress_;
  std::exception_ptr raised_;
  std::vector<std::string> warnings_;
};

std::shared_ptr<scree::Scene> load(const scree::File& file, const std::optional<std::string>& scene,
                                   const std::string& backend, const std::optional<std::string>& gpu, uint32_t threads,
                                   bool textures, uint64_t device_memory, uint64_t host_memory, uint64_t texture_cache,
                                   const std::array<uint32_t, 3>& largest, const py::object& progress,
                                   std::optional<uint32_t> gpus, uint64_t texture_memory,
                                   const std::optional<std::string>& environment, const std::string& light,
                                   const std::string& read, uint64_t largest_shadows, py::list warnings) {
  auto options = scree::make<scree_load_options>();
  options.scene = scene ? scene->c_str() : nullptr;
  options.backend = static_cast<scree_backend>(number_of(kBackends, backend, "backend"));
  options.gpu = gpu ? gpu->c_str() : nullptr;
  options.threads = threads;
  options.no_textures = textures ? 0 : 1;
  options.device_memory = device_memory;
  options.host_memory = host_memory;
  options.texture_cache = texture_cache;
  options.max_width = largest[0];
  options.max_height = largest[1];
  options.max_samples = largest[2];
  options.max_shadow_size = largest_shadows;
  options.gpus = gpus.value_or(SCREE_ALL_GPUS);
  options.texture_memory = texture_memory;
  options.environment = environment ? environment->c_str() : nullptr;
  options.light = static_cast<scree_light>(number_of(kLights, light, "light"));
  options.reading = static_cast<scree_reading>(number_of(kReadings, read, "read"));
  Heard heard(progress);
  std::shared_ptr<scree::Scene> loaded;
  heard.listen(options, [&] {
    loaded = std::shared_ptr<scree::Scene>(new scree::Scene(file.handle(), options), &end<scree::Scene>);
  });
  for (const py::handle line : heard.warnings()) warnings.append(line);
  return loaded;
}

py::dict convert(const std::string& input, const std::optional<std::string>& output, uint32_t position_bits,
                 bool float32, double max_error, const std::string& encoding, int zstd, const std::string& textures,
                 int jpeg_quality, bool normals, bool source_ids, bool replace, bool keep_going, bool drop_nonfinite,
                 bool allow_outside, const std::optional<std::string>& exclude, uint32_t threads, uint64_t memory,
                 const py::object& progress) {
  auto options = scree::make<scree_convert_options>();
  constexpr std::array<const char*, 2> kEncodings{"clustered", "indexed"};
  const auto flag = [&](bool is_set, uint32_t bit) { options.flags |= is_set ? bit : 0u; };
  flag(number_of(kEncodings, encoding, "encoding") == 1, SCREE_CONVERT_INDEXED);
  flag(float32, SCREE_CONVERT_FLOAT32);
  flag(normals, SCREE_CONVERT_NORMALS);
  flag(source_ids, SCREE_CONVERT_SOURCE_IDS);
  flag(replace, SCREE_CONVERT_REPLACE);
  flag(keep_going, SCREE_CONVERT_KEEP_GOING);
  flag(drop_nonfinite, SCREE_CONVERT_DROP_NONFINITE);
  flag(allow_outside, SCREE_CONVERT_ALLOW_OUTSIDE);
  options.position_bits = position_bits;
  options.max_error = max_error;
  options.zstd_level = zstd;
  options.textures = static_cast<scree_textures>(number_of(kTextures, textures, "textures"));
  options.jpeg_quality = jpeg_quality;
  options.exclude = exclude ? exclude->c_str() : nullptr;
  options.threads = threads;
  options.memory = memory;
  Heard heard(progress);
  scree_convert_report report{};
  heard.listen(options, [&] { report = scree::convert(input, output.value_or(""), options); });
  return py::dict("input_bytes"_a = report.input_bytes, "output_bytes"_a = report.output_bytes,
                  "triangles"_a = report.triangles, "meshes"_a = report.meshes,
                  "position_error"_a = report.position_error, "seconds"_a = report.seconds,
                  "warnings"_a = heard.warnings());
}

PyObject* error_class = nullptr;  // lives as long as the interpreter

}  // namespace

PYBIND11_MODULE(_scree, module) {
  error_class = PyErr_NewExceptionWithDoc("scree.Error",
                                          "The reason why a call failed, in one line. `status`: the name of its kind.",
                                          PyExc_RuntimeError, nullptr);
  module.add_object("Error", py::reinterpret_borrow<py::object>(error_class));
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const scree::Error& error) {
      const py::object type = py::reinterpret_borrow<py::object>(error_class);
      const py::object value = type(text_of(error.what()));
      value.attr("status") = scree_status_name(error.status());
      PyErr_SetObject(error_class, value.ptr());
    }
  });
  module.attr("__version__") = scree_version();
  // Loads numpy. pybind11 would do this at its first use, under a lock that other threads then await with the GIL held.
  (void)py::detail::npy_api::get();

  add_cameras(module);

  py::class_<SharedLayer>(module, "SharedLayer",
                          "A layer of View.share(), for from_dlpack() of numpy, torch, cupy or jax: height x width x "
                          "channels, of the types and units of View.read(), on the device that drew it.")
      .def("__dlpack__", &SharedLayer::dlpack, py::kw_only(), "stream"_a = py::none(), "max_version"_a = py::none(),
           "dl_device"_a = py::none(), "copy"_a = py::none(),
           "The layer as a DLPack capsule. `stream`: the CUDA stream that waits until the layer is ready, numbered as "
           "in "
           "the array API. Raises BufferError for a copy or another device.")
      .def("__dlpack_device__", &SharedLayer::device,
           "The DLPack device type (1: the host, 2: a GPU) and the device's index.")
      .def_property_readonly(
          "shape",
          [](const SharedLayer& layer) { return py::tuple(py::cast(shape_of(describe(*layer.view, layer.layer)))); },
          "The array's shape: cameras (for a batch), height, width, channels (if a pixel has several).")
      .def_property_readonly(
          "dtype", [](const SharedLayer& layer) { return numpy_type(describe(*layer.view, layer.layer).type); },
          "The numpy dtype of the elements.");

  py::class_<scree::View, std::shared_ptr<scree::View>>(module, "View")
      .def(
          "draw",
          [](scree::View& view, uint32_t width, uint32_t height, const py::object& camera, uint32_t samples,
             const py::dict& shading) {
            Camera seen = camera_of(camera);
            const scree_draw_options options = draw_options(width, height, samples, shading);
            const WithoutGil release;
            view.draw(seen.get(), options);
          },
          "width"_a, "height"_a, "camera"_a, "samples"_a, "shading"_a)
      .def(
          "draw_batch",
          [](scree::View& view, const std::vector<py::object>& cameras, uint32_t width, uint32_t height,
             const std::vector<std::string>& layers, uint32_t samples, const py::dict& shading) {
            const scree_draw_options options = draw_options(width, height, samples, shading);
            uint32_t made = 0;
            for (const std::string& layer : layers) made |= 1u << layer_of(layer);
            const Cameras seen(cameras);
            const WithoutGil release;
            view.draw_batch(seen.data(), seen.count(), options, made);
          },
          "cameras"_a, "width"_a, "height"_a, "layers"_a, "samples"_a, "shading"_a)
      .def(
          "draw_batch_to",
          [](scree::View& view, const std::vector<py::object>& cameras, const py::dict& arrays, int gpu,
             uint32_t samples, const py::object& stream, const py::dict& shading) {
            const Cameras seen(cameras);
            const Targets targets = take_targets(arrays, cameras.size(), gpu, stream);
            const scree_draw_options options = draw_options(targets.width, targets.height, samples, shading);
            const WithoutGil release;
            view.draw_batch_to(seen.data(), seen.count(), options, targets.all.data(),
                               static_cast<uint32_t>(targets.all.size()), targets.stream);
          },
          "cameras"_a, "targets"_a, "gpu"_a, "samples"_a, "stream"_a, "shading"_a)
      .def(
          "shade",
          [](scree::View& view, const py::dict& shading) {
            const scree_draw_options options = draw_options(1, 1, 1, shading);
            const WithoutGil release;
            view.shade(options);
          },
          "shading"_a)
      .def(
          "read", [](const scree::View& view, const std::string& layer) { return read(view, layer_of(layer)); },
          "layer"_a)
      .def(
          "share",
          [](const std::shared_ptr<scree::View>& view, const std::string& layer, int gpu) {
            (void)without_gil([&] { return view->stats(); });  // throws if there is no frame
            return SharedLayer{view, layer_of(layer), gpu};
          },
          "layer"_a, "gpu"_a)
      .def("pick", &pick_of, "x"_a, "y"_a)
      .def_property_readonly("stats", [](const scree::View& view) { return stats_of(view); });

  py::class_<scree::Scene, std::shared_ptr<scree::Scene>>(module, "Scene")
      .def("view",
           [](const scree::Scene& scene) {
             const WithoutGil release;
             return std::shared_ptr<scree::View>(new scree::View(scene.handle()), &end<scree::View>);
           })
      .def_property_readonly("stats", [](const scree::Scene& scene) { return stats_of(scene); })
      .def("instances", &instances_of);

  py::class_<scree::File, std::shared_ptr<scree::File>>(module, "File")
      .def(py::init<const std::string&>(), "path"_a)
      .def("load", &load, py::kw_only(), "scene"_a, "backend"_a, "gpu"_a, "threads"_a, "textures"_a, "device_memory"_a,
           "host_memory"_a, "texture_cache"_a, "largest"_a, "progress"_a, "gpus"_a, "texture_memory"_a, "environment"_a,
           "light"_a, "read"_a, "largest_shadows"_a, "warnings"_a)
      .def_property_readonly("bytes", [](const scree::File& file) { return file.info().bytes; })
      .def_property_readonly("triangles", [](const scree::File& file) { return file.info().triangles; })
      .def_property_readonly("default_scene", [](const scree::File& file) { return file.info().default_scene; })
      .def_property_readonly("scenes", &scenes_of)
      .def_property_readonly("meshes", &meshes_of)
      .def_property_readonly("materials", &materials_of)
      .def("cameras", &cameras_of, "scene"_a);

  module.def("convert", &convert, "input"_a, "output"_a, py::kw_only(), "position_bits"_a, "float32"_a, "max_error"_a,
             "encoding"_a, "zstd"_a, "textures"_a, "jpeg_quality"_a, "normals"_a, "source_ids"_a, "replace"_a,
             "keep_going"_a, "drop_nonfinite"_a, "allow_outside"_a, "exclude"_a, "threads"_a, "memory"_a, "progress"_a);
}
