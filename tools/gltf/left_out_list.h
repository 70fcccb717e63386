// Counts the parts of a document that are left out.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

class LeftOutList {
 public:
  LeftOutList(const GltfDocument& document, const GltfBuffers& buffers)
      : buffers_(buffers), seen_(document.accessors.size(), false) {}

  /// An accessor that is used: its bytes are not counted below.
  void keep(const Accessor& accessor) { seen_[accessor.index] = true; }

  void add(const std::string& what, uint64_t count) { entries_[what].count += count; }

  // Counts an accessor and its bytes, once.
  void add_accessor(const std::string& what, int32_t accessor) {
    if (take(accessor)) ++entries_[what].count;
    add_bytes(what, accessor);
  }

  // Counts only the bytes, if something else is counted.
  void add_accessor_bytes(const std::string& what, int32_t accessor) {
    take(accessor);
    add_bytes(what, accessor);
  }

  uint64_t count(const std::string& what) const {
    const auto found = entries_.find(what);
    return found == entries_.end() ? 0 : found->second.count;
  }

  void move_to(SourceScene& scene) const {
    for (const auto& [what, entry] : entries_) {
      if (entry.count > 0) scene.left_out.push_back({what, entry.count, entry.bytes, entry.elements});
    }
  }

 private:
  struct Entry {
    uint64_t count = 0;
    uint64_t bytes = 0;
    uint64_t elements = 0;
  };

  bool take(int32_t accessor) {
    fresh_ = accessor >= 0 && static_cast<size_t>(accessor) < seen_.size() && !seen_[static_cast<size_t>(accessor)];
    if (fresh_) seen_[static_cast<size_t>(accessor)] = true;
    return fresh_;
  }

  void add_bytes(const std::string& what, int32_t accessor) {
    if (!fresh_) return;
    Entry& entry = entries_[what];
    entry.bytes = format::checked_add(entry.bytes, buffers_.stated_bytes(accessor)).value_or(entry.bytes);
    entry.elements = format::checked_add(entry.elements, buffers_.stated_count(accessor)).value_or(entry.elements);
  }

  const GltfBuffers& buffers_;
  std::vector<bool> seen_;
  bool fresh_ = false;
  std::map<std::string, Entry> entries_;
};

}  // namespace scree::convert
