// Alpha masks: which of a source's are masks in fact, and their levels in the file (spec/container.md 5.11).
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/ordered_pool.h"
#include "tools/convert/images/images.h"
#include "tools/gltf/source.h"

namespace scree::convert {

enum class MaskKind : uint8_t {
  kOpaque,  // every place passes
  kClear,   // none does
  kMixed
};

/// Of one of SourceScene::materials.
struct PlannedMask {
  MaskKind plain = MaskKind::kOpaque;     // of triangles without texture coordinates
  MaskKind textured = MaskKind::kOpaque;  // of triangles that have them
  uint32_t threshold = 0;                 // where that is kMixed: MaskRecord::threshold
  uint32_t width = 0;                     // likewise
  uint32_t height = 0;
};

struct MaskPlan {
  std::vector<PlannedMask> materials;  // by SourceScene::materials; without a mask all is opaque

  MaskKind kind(const Primitive& primitive) const;
  /// Of the masks' levels, as if no two shared them.
  uint64_t bytes() const;
};

/// The smallest sum of alpha that passes, in 1 / 65536 of a code of 8 bits: what `factor` times it has to reach.
/// 0: all do; more than format::kMaxMaskThreshold: none does.
uint32_t mask_threshold(float factor, float cutoff);

/// The levels of a mask down to a longer side of 16 texels, one after the other. Each level below level 0 (`alpha`) is
/// its box filter, scaled so that as large a share of its texels reaches the threshold: with alpha alone leaves would
/// thin out or close up with distance. Throws std::bad_alloc.
std::vector<std::byte> make_mask_levels(std::span<const uint8_t> alpha, uint32_t width, uint32_t height,
                                        uint32_t threshold);
/// How many those are.
uint32_t mask_level_count(uint32_t width, uint32_t height);

/// Plans the masks of the materials that primitives of `wanted` (flags) have: looks at the alpha of every texture that
/// such a primitive has coordinates for. Decodes as many pictures at a
/// time as fit into ImageOptions::memory, one always. Errors as runtime::decode_image, the image named; those that
/// ImageOptions::keep_going replaces are opaque.
Result<MaskPlan> plan_masks(const SourceScene& scene, const std::vector<bool>& wanted, const ImageOptions& options,
                            WorkerPool& pool, const std::function<void(uint64_t images)>& progress);

/// What planning or writing one mask takes at most, bytes.
uint64_t largest_mask_bytes(const SourceScene& scene);

/// The levels of a material's mask, where that is mixed. Errors as plan_masks; kFile: the image is another than then.
Result<std::vector<std::byte>> load_mask_levels(const SourceScene& scene, const MaskPlan& plan, size_t material,
                                                bool keep_going);

/// The place on the mask of texture coordinates (u, v, 1): KHR_texture_transform.
void mask_place(const format::MaterialRecord& material, double place[2][3]);

/// Appends a page per mask, equal ones once, and fills the masks of `tables`. `materials`: the record of each of
/// SourceScene::materials, or kNone. Errors as plan_masks and ContainerWriter::append.
Result<void> write_masks(const SourceScene& scene, const MaskPlan& plan, const std::vector<uint32_t>& materials,
                         const ImageOptions& options, WorkerPool& pool, format::ContainerWriter& writer,
                         format::TableSet& tables);

}  // namespace scree::convert
