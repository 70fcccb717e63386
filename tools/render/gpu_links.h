// The way in which ranks that draw one picture exchange its samples: from GPU to GPU, or through host memory by MPI.
#pragma once

#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "format/result.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/nccl_group.h"
#include "tools/common/ranks.h"
#include "tools/render/render_options.h"

namespace scree::tools {

/// Connects the GPUs of all ranks if each has one of its own and NCCL. Otherwise there is no group, at any rank.
class GpuLinks {
 public:
  /// The fewest frames for which Exchange::kAuto connects. Connecting takes a second longer (docs/scale.md). A frame of
  /// 3840x2160 takes a tenth of a second longer by MPI.
  static constexpr uint64_t kLeastFrames = 16;

  /// Called by all ranks. `gpu`: the current device of this rank; nothing if its CPU draws. `words`: of a picture. The
  /// ranks begin to connect on a thread. Error kDevice, for Exchange::kNccl: the GPUs cannot be connected, and why;
  /// kFile: MPI's.
  Result<void> begin(Ranks& ranks, const std::optional<runtime::Gpu>& gpu, Exchange exchange, uint64_t words,
                     uint64_t frames);

  /// Called by all ranks after begin(), until which they did other work. Waits until all are connected, or until one
  /// has failed. Prints a warning then unless `quiet`, at the ranks that failed. Errors as begin().
  Result<void> finish(Ranks& ranks, Exchange exchange, bool quiet);

  /// Null: the ranks exchange by MPI.
  runtime::NcclGroup* group() const { return group_.get(); }

 private:
  std::shared_ptr<runtime::NcclGroup> group_;  // the connecting thread's too, in case that thread never ends
  std::future<Result<void>> connected_;
};

}  // namespace scree::tools
