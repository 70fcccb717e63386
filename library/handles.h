// Handles, which are numbers in the form of pointers and never used twice, and the objects behind them.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "library/status.h"
#include "runtime/draw/loaded_scene.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"

namespace scree::library {

struct File {
  explicit File(runtime::SceneFile opened) : file(std::move(opened)) {}

  /// The cameras of a scene, found once: they need the matrices of all nodes. Thread-safe; throws std::bad_alloc.
  const std::vector<runtime::PlacedCamera>& cameras(uint32_t scene) const {
    const std::lock_guard lock(mutex);
    const auto found = found_cameras.find(scene);
    if (found != found_cameras.end()) return found->second;
    return found_cameras.emplace(scene, runtime::placed_cameras(file.container(), scene)).first->second;
  }

  const runtime::SceneFile file;
  mutable std::mutex mutex;
  mutable std::unordered_map<uint32_t, std::vector<runtime::PlacedCamera>> found_cameras;
};

struct LoadedFile {
  std::shared_ptr<runtime::LoadedScene> scene;
  double load_ms = 0;
};

struct DrawnView {
  std::mutex mutex;  // held by a call that uses the renderer
  std::unique_ptr<runtime::ViewRenderer> renderer;
};

struct HeldMemory {
  std::shared_ptr<const void> memory;
};

/// All handles of one kind. The low bits of these handles are kTag. Thread-safe.
template <class Handle, class Object, uint64_t kTag>
class Handles {
 public:
  static Handles& all() {
    static Handles* const handles = new Handles;  // never destroyed: other threads may still call while a program ends
    return *handles;
  }

  Handle* add(std::shared_ptr<Object> object) {
    const std::unique_lock<std::shared_mutex> lock(mutex_);
    const uint64_t number = ++last_ << kTagBits | kTag;
    objects_.emplace(number, std::move(object));
    return reinterpret_cast<Handle*>(number);
  }

  /// Null if the handle was ended, or is no handle of this kind.
  std::shared_ptr<Object> find(const Handle* handle) const {
    const std::shared_lock<std::shared_mutex> lock(mutex_);
    const auto found = objects_.find(reinterpret_cast<uint64_t>(handle));
    return found == objects_.end() ? nullptr : found->second;
  }

  /// Removes a handle. Returns its object, so that the object is destroyed without the lock.
  std::shared_ptr<Object> remove(const Handle* handle) {
    const std::unique_lock<std::shared_mutex> lock(mutex_);
    const auto found = objects_.find(reinterpret_cast<uint64_t>(handle));
    if (found == objects_.end()) return nullptr;
    std::shared_ptr<Object> object = std::move(found->second);
    objects_.erase(found);
    return object;
  }

 private:
  static constexpr uint64_t kTagBits = 4;

  mutable std::shared_mutex mutex_;
  std::unordered_map<uint64_t, std::shared_ptr<Object>> objects_;
  uint64_t last_ = 0;
};

using Files = Handles<scree_file, File, 1>;
using Scenes = Handles<scree_scene, LoadedFile, 2>;
using Views = Handles<scree_view, DrawnView, 3>;
using Memories = Handles<scree_memory, HeldMemory, 4>;

/// Calls body(object) with the object of `handle`. Turns exceptions into a status. `name`: the handle's type, such as
/// "scree_view".
template <class Kind, class Handle, class Body>
scree_status with(const Handle* handle, const char* name, const Body& body) noexcept {
  return guarded([&] {
    if (handle == nullptr) return fail(SCREE_ERROR_ARGUMENT, std::string("the ") + name + " is null");
    const auto object = Kind::all().find(handle);
    if (object == nullptr)
      return fail(SCREE_ERROR_HANDLE, std::string("the handle is not a ") + name + ", or was ended");
    return body(*object);
  });
}

/// Ends a handle. Does nothing for null.
template <class Kind, class Handle>
scree_status end(const Handle* handle, const char* name) noexcept {
  return guarded([&] {
    if (handle == nullptr || Kind::all().remove(handle) != nullptr) return SCREE_OK;
    return fail(SCREE_ERROR_HANDLE, std::string("the handle is not a ") + name + ", or was ended");
  });
}

}  // namespace scree::library
