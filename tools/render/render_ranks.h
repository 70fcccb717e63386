// scree render under mpirun: one picture of a scene whose geometry the ranks have between them.
#pragma once

#include "format/result.h"
#include "tools/common/ranks.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Draws on the CPUs of all ranks: each reads and draws its own pages; samples become the least word of all ranks, each
/// rank shades those of its own pages, and rank 0 gathers the colours and writes. Every output has the bytes of one
/// process's: a sample is the minimum over fragments, whoever draws them. Called by all. Errors as one process's, of
/// the rank that met them; kUsage: an option that is not for several ranks.
Result<void> render_ranks(const RenderOptions& options, Ranks& ranks);

}  // namespace scree::tools
