#include "tools/gltf/document/check.h"

#include <optional>
#include <string>

#include "format/bytes.h"
#include "format/fail.h"
#include "tools/gltf/meshopt/source.h"

namespace scree::convert {
namespace {

using format::range_within;

Result<void> check_present(const char* what, int32_t index, size_t count) {
  if (index == kAbsent || (index >= 0 && static_cast<size_t>(index) < count)) return {};
  return fail(ErrorCode::kRange, what, " ", index, " does not exist, the document has ", count);
}

Result<void> check_in_buffer(const GltfDocument& document, int32_t buffer, uint64_t offset, uint64_t bytes) {
  SCREE_TRY(check_present("buffer", buffer, document.buffers.size()));
  const uint64_t limit = document.buffers[static_cast<size_t>(buffer)].bytes;
  if (range_within(offset, bytes, limit)) return {};
  return fail(ErrorCode::kRange, bytes, " bytes at ", offset, ", but buffer ", buffer, " has ", limit);
}

Result<void> check_view(const GltfDocument& document, const DocBufferView& view) {
  SCREE_TRY(check_in_buffer(document, view.buffer, view.offset, view.bytes));
  if (view.meshopt == kAbsent) return {};
  const DocMeshopt& stated = document.meshopt[static_cast<size_t>(view.meshopt)];
  auto checked = check_in_buffer(document, stated.buffer, stated.offset, stated.bytes);
  if (checked) checked = check_meshopt(stated, view.bytes, view.stride);
  return checked ? checked : Result<void>(at(stated.extension(), checked.error()));
}

Result<void> check_sparse(const GltfDocument& document, const DocSparse& sparse, uint64_t count, uint64_t element) {
  if (sparse.index_type != 5121 && sparse.index_type != 5123 && sparse.index_type != 5125) {
    return fail(ErrorCode::kFormat, "indices componentType is ", sparse.index_type, ", expected 5121, 5123 or 5125");
  }
  if (sparse.count > count)
    return fail(ErrorCode::kRange, sparse.count, " values, but the accessor has ", count, " elements");
  for (const int32_t view : {sparse.index_view, sparse.value_view}) {
    SCREE_TRY(check_present("buffer view", view, document.views.size()));
  }
  // Below 2^31 elements of at most 64 bytes, so nothing overflows.
  const uint64_t index_limit = document.views[static_cast<size_t>(sparse.index_view)].bytes;
  const uint64_t value_limit = document.views[static_cast<size_t>(sparse.value_view)].bytes;
  if (!range_within(sparse.index_offset, uint64_t{sparse.count} * component_bytes(sparse.index_type), index_limit)) {
    return fail(ErrorCode::kRange, sparse.count, " indices pass the end of buffer view ", sparse.index_view, " (",
                index_limit, " bytes)");
  }
  if (!range_within(sparse.value_offset, sparse.count * element, value_limit)) {
    return fail(ErrorCode::kRange, sparse.count, " values pass the end of buffer view ", sparse.value_view, " (",
                value_limit, " bytes)");
  }
  return {};
}

Result<void> check_accessor(const GltfDocument& document, const DocAccessor& accessor) {
  if (component_bytes(accessor.type) == 0) {
    return fail(ErrorCode::kFormat, "componentType is ", accessor.type, ", expected 5120 to 5123, 5125 or 5126");
  }
  SCREE_TRY(check_present("buffer view", accessor.view, document.views.size()));
  // Matrices are not checked: their columns are padded, and nothing that is drawn uses them.
  if (accessor.components == 0 || accessor.components > 4) return {};
  const uint64_t element = uint64_t{component_bytes(accessor.type)} * accessor.components;
  if (accessor.view == kAbsent) {
    const bool is_elsewhere = accessor.is_draco && accessor.sparse == kAbsent;  // checked by the importer
    SCREE_TRY(check_zeros(is_elsewhere ? 0 : accessor.count));
  } else {
    const DocBufferView& view = document.views[static_cast<size_t>(accessor.view)];
    const uint64_t stride = view.stride == 0 ? element : view.stride;
    if (stride < element) {
      return fail(ErrorCode::kRange, "elements of ", element, " bytes overlap, byteStride is ", stride);
    }
    const auto last =
        accessor.count == 0 ? std::optional<uint64_t>(0) : format::checked_mul(accessor.count - 1, stride);
    const auto bytes = last ? format::checked_add(*last, accessor.count == 0 ? 0 : element) : std::nullopt;
    if (!bytes || !range_within(accessor.offset, *bytes, view.bytes)) {
      return fail(ErrorCode::kRange, accessor.count, " elements of ", element, " bytes at ", accessor.offset,
                  ", stride ", stride, ", pass the end of buffer view ", accessor.view, " (", view.bytes, " bytes)");
    }
  }
  if (accessor.sparse == kAbsent) return {};
  auto checked = check_sparse(document, document.sparse[static_cast<size_t>(accessor.sparse)], accessor.count, element);
  return checked ? checked : Result<void>(at("sparse", checked.error()));
}

Result<void> check_primitive(const GltfDocument& document, const DocPrimitive& primitive) {
  if (primitive.mode < 0 || primitive.mode > 6)
    return fail(ErrorCode::kRange, "mode is ", primitive.mode, ", expected 0 to 6");
  SCREE_TRY(check_present("material", primitive.material, document.materials.size()));
  SCREE_TRY(check_present("indices: accessor", primitive.indices, document.accessors.size()));
  for (const auto& [name, accessor] : primitive.attributes) {
    SCREE_TRY_AT(name.substr(0, 40), check_present("accessor", accessor, document.accessors.size()));
  }
  if (primitive.draco != kAbsent) {
    const int32_t view = document.draco[static_cast<size_t>(primitive.draco)].view;
    SCREE_TRY_AT("KHR_draco_mesh_compression", check_present("buffer view", view, document.views.size()));
  }
  for (const int32_t accessor : primitive.target_accessors) {
    SCREE_TRY_AT("morph target", check_present("accessor", accessor, document.accessors.size()));
  }
  return {};
}

Result<void> check_texture(const GltfDocument& document, const DocTexture& texture) {
  SCREE_TRY(check_present("sampler", texture.sampler, document.samplers.size()));
  for (const int32_t image : texture.sources) SCREE_TRY(check_present("image", image, document.images.size()));
  return {};
}

Result<void> check_image(const GltfDocument& document, const DocImage& image) {
  const bool has_uri = image.is_data || !image.uri.empty();
  if (has_uri && image.view != kAbsent) return Error{ErrorCode::kFormat, "has both a uri and a bufferView"};
  return check_present("buffer view", image.view, document.views.size());
}

Result<void> check_node(const GltfDocument& document, const DocNode& node) {
  SCREE_TRY(check_present("light", node.light, document.lights.size()));
  for (const auto& [name, accessor] : node.instancing) {
    SCREE_TRY_AT("EXT_mesh_gpu_instancing: " + name.substr(0, 40),
                 check_present("accessor", accessor, document.accessors.size()));
  }
  return {};
}

// Runs a check over all records of a kind, and names the record that fails.
template <class Record, class Check>
Result<void> check_all(const char* kind, const GltfDocument& document, const std::vector<Record>& records,
                       Check check) {
  for (size_t i = 0; i < records.size(); ++i) {
    SCREE_TRY_AT(std::string(kind) + " " + std::to_string(i), check(document, records[i]));
  }
  return {};
}

}  // namespace

uint32_t component_bytes(int32_t type) {
  constexpr uint32_t kBytes[] = {1, 1, 2, 2, 0, 4, 4};  // from 5120 on
  return type >= 5120 && type <= 5126 ? kBytes[type - 5120] : 0;
}

Result<void> check_zeros(uint64_t count) {
  if (count <= kMaxZeroElements) return {};
  return fail(ErrorCode::kRange, count, " elements without a buffer view, at most ", kMaxZeroElements, " are read");
}

Result<void> check_document(const GltfDocument& document) {
  SCREE_TRY(check_all("buffer view", document, document.views, check_view));
  SCREE_TRY(check_all("accessor", document, document.accessors, check_accessor));
  for (size_t m = 0; m < document.meshes.size(); ++m) {
    const std::string kind = "mesh " + std::to_string(m) + " primitive";
    SCREE_TRY(check_all(kind.c_str(), document, document.meshes[m].primitives, check_primitive));
  }
  for (size_t i = 0; i < document.materials.size(); ++i) {
    const DocMaterial& material = document.materials[i];
    const auto check_use = [&](const DocTextureUse& use) {
      return check_present("texture", use.texture, document.textures.size());
    };
    Result<void> present = check_use(material.base_texture);
    for (const DocTextureUse& use : material.textures)
      if (present) present = check_use(use);
    if (!present) return at("material " + std::to_string(i), present.error());
  }
  SCREE_TRY(check_all("texture", document, document.textures, check_texture));
  SCREE_TRY(check_all("image", document, document.images, check_image));
  return check_all("node", document, document.nodes, check_node);
}

}  // namespace scree::convert
