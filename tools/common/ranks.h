// The processes that mpirun or srun start of one command line, and that share its work.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::tools {

/// This process among the others; alone, where no launcher started several. Used by one thread.
class Ranks {
 public:
  /// Finds the others. Errors kUsage: a launcher has started several, but this program was built without MPI; kFile:
  /// what MPI says.
  static Result<Ranks> join();

  uint32_t rank() const { return rank_; }
  uint32_t count() const { return count_; }
  uint32_t rank_on_host() const { return rank_on_host_; }
  bool is_first() const { return rank_ == 0; }

  /// Called by all: whether all go on. The lowest of those that met an error gets it back and is to end the program,
  /// which ends the others, who wait here for that: so one line says what all of them met.
  Result<void> agree(Result<void> own);

  /// Called by all when their work is done: the end of this process's part. One that fails calls end_all_ranks()
  /// instead.
  void leave();

  /// Called by all: `values` become their sums over all ranks, at rank 0. Errors kFile.
  Result<void> sum(std::span<double> values);

  /// Called by all, with as many words: each becomes the least of all ranks', at every rank. Errors kFile.
  Result<void> least(std::span<uint64_t> words);

  /// Called by all, with as many values: at rank 0 each becomes the sum of all ranks'. Errors kFile.
  Result<void> sum(std::span<float> values);

  /// `error`, and where there are several ranks which one met it, on which host.
  Error named(Error error) const;

 private:
  Ranks() = default;

  uint32_t rank_ = 0;
  uint32_t count_ = 1;
  uint32_t rank_on_host_ = 0;
};

/// Ends all ranks with this code, where there are others: a rank that fails may not let them wait. Called by main once
/// the error is printed.
void end_all_ranks(int exit_code);

}  // namespace scree::tools
