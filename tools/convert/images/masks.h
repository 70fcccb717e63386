// Alpha masks: finds the source's materials whose mask cuts holes, and writes the masks' levels to the file
// (spec/container.md 5.11).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/convert/images/images.h"
#include "tools/gltf/source.h"

namespace scree::convert {

enum class MaskKind : uint8_t {
  kOpaque,  // every texel reaches the threshold; for blended surfaces: the texture's alpha is 1
  kClear,   // no texel reaches the threshold; for blended surfaces: the alpha is 0
  kMixed
};

/// The mask of one entry of SourceScene::materials.
struct PlannedMask {
  MaskKind plain = MaskKind::kOpaque;     // triangles without texture coordinates
  MaskKind textured = MaskKind::kOpaque;  // triangles with texture coordinates
  bool blends = false;                    // the mask is the alpha of blended surfaces, without a threshold
  bool of_colors = false;  // there is no texture; triangles with vertex colours of four components are kMixed
  uint32_t threshold = 0;  // MaskRecord::threshold, where `textured` is kMixed
  uint32_t width = 0;      // texels of level 0, where `textured` is kMixed
  uint32_t height = 0;
};

struct MaskPlan {
  std::vector<PlannedMask> materials;  // one per entry of SourceScene::materials; kOpaque without a mask

  MaskKind kind(const Primitive& primitive) const;
  /// Bytes of the levels of all mixed masks, counted once per material even where materials share them.
  uint64_t bytes() const;
};

/// The smallest alpha of a texture that passes once multiplied by `factor` (the base colour's alpha) and compared with
/// `cutoff`. Unit: 1 / 65536 of an 8-bit code. With 0 every alpha passes; above format::kMaxMaskThreshold none does.
uint32_t mask_threshold(float factor, float cutoff);

/// Returns the levels of a mask, one after the other, down to a longer side of 16 texels. Level 0 is `alpha` (width x
/// height codes). Each coarser level is the box filter of level 0, scaled so that the share of texels that reach
/// `threshold` stays the same. Without the scale, leaves would thin out or close up with distance. A threshold of 0 is
/// for alpha that blends: its levels are not scaled. Throws std::bad_alloc.
std::vector<std::byte> make_mask_levels(std::span<const uint8_t> alpha, uint32_t width, uint32_t height,
                                        uint32_t threshold);
/// The number of levels that make_mask_levels() returns, at least 1.
uint32_t mask_level_count(uint32_t width, uint32_t height);

/// Plans the masks of all materials that a wanted primitive uses. `wanted` has one flag per entry of
/// SourceScene::primitives. Decodes the alpha of every texture for which such a primitive has coordinates: as many
/// images at a time as fit into ImageOptions::memory, at least one. `progress` receives the number of images done.
/// Errors: those of runtime::decode_image, with the image's name; kUnsupported for a mixed mask with a side above
/// format::kMaxMaskSide. An image that ImageOptions::keep_going replaces is opaque.
Result<MaskPlan> plan_masks(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                            WorkerPool& pool, const std::function<void(uint64_t images)>& progress);

/// The most memory that planning or writing one mask takes, in bytes.
uint64_t largest_mask_bytes(const SourceScene& scene);

/// The levels of a material's mask, which must be mixed. Errors: those of plan_masks; kFile if the image's size has
/// changed since.
Result<std::vector<std::byte>> load_mask_levels(const SourceScene& scene, const MaskPlan& plan, size_t material,
                                                bool keep_going);

/// The matrix of KHR_texture_transform: maps texture coordinates (u, v, 1) to a position on the mask.
void uv_transform(const format::MaterialRecord& material, double matrix[2][3]);

/// Appends one page per distinct mask, compressed at `zstd_level` (0: raw), and fills `tables.masks`, sorted by
/// material. `materials` maps each entry of SourceScene::materials to its record in the file, or kNone. Errors: those
/// of load_mask_levels and ContainerWriter::append.
Result<void> write_masks(const SourceScene& scene, const MaskPlan& plan, const std::vector<uint32_t>& materials,
                         const ImageOptions& options, int zstd_level, WorkerPool& pool, format::ContainerWriter& writer,
                         format::TableSet& tables);

}  // namespace scree::convert
