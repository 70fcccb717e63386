// scree render under mpirun: one picture of a scene whose geometry the ranks have between them.
#pragma once

#include <cstdint>
#include <vector>

#include "format/result.h"
#include "runtime/scene/pages.h"
#include "tools/common/ranks.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// The rank of each of `pages`, by the file's tables alone: in the file's order each goes to the rank that has the
/// fewest raw bytes by then, so that all hold as much, and of every view some.
std::vector<uint32_t> owners_of_pages(const runtime::DrawnPages& pages, uint32_t ranks);

/// Draws on the CPUs of all ranks: each reads and draws its own pages; samples become the least word of all ranks, each
/// rank shades those of its own pages, and rank 0 gathers the colours and writes. Every output has the bytes of one
/// process's: a sample is the minimum over fragments, whoever draws them. Called by all. Errors as one process's, of
/// the rank that met them; kUsage: an option that is not for several ranks.
Result<void> render_ranks(const RenderOptions& options, Ranks& ranks);

}  // namespace scree::tools
