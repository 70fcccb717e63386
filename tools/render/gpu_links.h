// How ranks that draw one picture exchange its samples: from GPU to GPU, or through host memory by MPI.
#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <optional>

#include "format/result.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/nccl_group.h"
#include "tools/common/process/ranks.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Connects the GPUs of all ranks if each has one of its own and NCCL. Otherwise there is no group, at any rank.
class GpuLinks {
 public:
  /// The fewest frames for which Exchange::kAuto connects. Connecting takes a second (docs/scale.md). A frame
  /// of 3840x2160 takes a tenth of a second longer by MPI than by NCCL.
  static constexpr uint64_t kLeastFrames = 16;

  /// Called by all ranks, which begin to connect on a thread. `gpu`: the current device of this rank; nullopt if its
  /// CPU draws. `words`: of a picture. Errors kDevice (only for Exchange::kNccl: the GPUs cannot be connected; the
  /// message gives the reason), kFile (MPI's).
  Result<void> begin(Ranks& ranks, const std::optional<runtime::Gpu>& gpu, Exchange exchange, uint64_t words,
                     uint64_t frames);

  /// Called by all ranks after begin(); between the two they may do other work. Waits until all are connected or one
  /// has failed. A rank that failed prints a warning unless `quiet`. Errors as begin().
  Result<void> finish(Ranks& ranks, Exchange exchange, bool quiet);

  /// Null: the ranks exchange by MPI.
  runtime::NcclGroup* group() const { return group_.get(); }

 private:
  std::shared_ptr<runtime::NcclGroup> group_;  // the connecting thread's too, in case that thread never ends
  std::future<Result<void>> connected_;
};

}  // namespace scree::tools
