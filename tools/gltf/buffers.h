// Finds the bytes of a document's buffers, buffer views and accessors. Each is checked when it is first used. Files
// that a scene does not use are never opened.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/draco/source.h"
#include "tools/gltf/meshopt/source.h"
#include "tools/gltf/source.h"

namespace scree::convert {

class GltfBuffers {
 public:
  /// `folder`: of the scene's file. `chunks`: the chunks of a .glb by index; null for chunks that are not binary.
  /// `document` has passed check_document() and outlives this. Indices passed to the functions below must be in range.
  /// `options` outlives this; its kept_view_bytes are for MeshoptCache, which takes half of them if no primitive is
  /// compressed by Draco.
  GltfBuffers(const GltfDocument& document, std::string folder, std::vector<std::shared_ptr<const ByteSource>> chunks,
              const ImportOptions& options);

  Result<void> check_stop() const { return options_.check_stop(); }

  /// Memory of the compressed buffer views that were used.
  PackedViewMemory view_memory() const;

  struct View {
    std::shared_ptr<const ByteSource> source;
    uint64_t offset = 0;
    uint64_t bytes = 0;
  };

  /// A buffer view. Its buffer is at least as long as the document states. A compressed view is unpacked when its
  /// source is read. Errors kTruncated, kFile, kUnsupported, kFormat, and kUsage for a data: URI that exceeds the
  /// memory. accessor() and image() also end with kFile if the import is stopped.
  Result<View> view(int32_t index);

  /// An accessor of scalars or vectors, with its sparse indices read and checked. Errors as view(), and kRange.
  Result<Accessor> accessor(int32_t index);

  /// A primitive of the Draco stream in a buffer view; equal primitives share one source. Errors as view(), and kUsage
  /// if unpacking it exceeds the memory.
  Result<std::shared_ptr<const ByteSource>> draco(int32_t view, const DracoPrimitive& primitive);

  /// The bytes of an image: from its view, file or data: URI. Errors as view().
  Result<View> image(const DocImage& image);

  /// Bytes of an accessor's elements, by count and type in the document (sparse elements are not counted twice); 0 if
  /// the index is invalid or the product exceeds 64 bits.
  uint64_t stated_bytes(int32_t accessor) const;

  /// The number of an accessor's elements; 0 if the index is invalid.
  uint64_t stated_count(int32_t accessor) const;

 private:
  Result<std::shared_ptr<const ByteSource>> buffer(int32_t index);
  void count(const PackedViewMemory& memory);
  Result<std::shared_ptr<const ByteSource>> open_buffer(int32_t index);
  Result<void> read_sparse(size_t slot, Accessor& accessor);

  const GltfDocument& document_;
  std::string folder_;
  const ImportOptions& options_;
  std::vector<std::shared_ptr<const ByteSource>> chunks_;
  std::vector<std::shared_ptr<const ByteSource>> buffers_;
  MeshoptCache meshopt_;
  std::vector<std::shared_ptr<const ByteSource>> unpacked_;  // by index in GltfDocument::meshopt
  std::multimap<int32_t, std::pair<DracoPrimitive, std::shared_ptr<const ByteSource>>> draco_;  // by view
  std::vector<bool> sparse_checked_;
  PackedViewMemory view_memory_;
};

}  // namespace scree::convert
