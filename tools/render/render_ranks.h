// scree render under mpirun: one picture of a scene whose geometry is divided among the ranks.
#pragma once

#include "format/result.h"
#include "tools/common/process/ranks.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Each rank reads its own pages and draws them, on its GPU or its CPU. The samples become the minimum of all ranks'
/// samples. Each rank shades the samples of its own pages, and rank 0 gathers the colours and writes. The outputs equal
/// those of one process, because a sample is the minimum over fragments, whichever rank draws them. Called by all
/// ranks. Errors as for one process, at the rank that failed; kUsage: an option that several ranks do not support.
Result<void> render_ranks(const RenderOptions& options, Ranks& ranks);

}  // namespace scree::tools
