// The processes (ranks) that mpirun or srun start for one command line. They share its work.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::tools {

/// This process as one rank of several, or the only one if no launcher started several. Used by one thread.
class Ranks {
 public:
  /// Joins the other ranks. Errors kUsage: a launcher has started several, but this program was built without MPI;
  /// kFile: MPI's error.
  static Result<Ranks> join();

  uint32_t rank() const { return rank_; }
  uint32_t count() const { return count_; }
  uint32_t rank_on_host() const { return rank_on_host_; }
  uint32_t count_on_host() const { return count_on_host_; }
  /// The rank that is the first on this rank's host.
  uint32_t first_on_host() const { return first_on_host_; }
  bool is_first() const { return rank_ == 0; }

  /// Called by all ranks, each with its own result: returns success only if all succeeded. The lowest rank with an
  /// error gets this error back, and must end the program. All other ranks wait here until that ends them, so that only
  /// one line is printed for an error of all.
  Result<void> agree(Result<void> own);

  /// Called by all ranks when their work is done. A rank that fails calls end_all_ranks() instead.
  void leave();

  /// Called by all ranks, once. Returns memory that the ranks of a host share, with `count` words, which are 0 when the
  /// first rank gets them. It is valid until leave(). Errors kFile.
  Result<std::span<std::atomic<uint64_t>>> words_of_host(size_t count);

  /// Called by all ranks with the same number of bytes. Returns the bytes of all ranks, rank by rank. Errors kFile.
  Result<std::vector<std::byte>> share(std::span<const std::byte> own);

  /// Called by all ranks. `values` become the sums over all ranks. Errors kFile.
  Result<void> sum(std::span<double> values);

  /// Called by all ranks with the same number of words. At every rank, each word becomes the minimum over all ranks.
  /// Errors kFile.
  Result<void> least(std::span<uint64_t> words);

  /// Called by all ranks with the same number of values. At each place at most one rank has a value other than 0 (all
  /// bits 0). Rank `root` gets these values. Errors kFile.
  Result<void> gather(std::span<float> values, uint32_t root = 0);

  /// `error`; if there are several ranks, with the number and host of this one.
  Error named(Error error) const;

 private:
  Ranks() = default;

  /// words_of_host() of a single rank.
  std::span<std::atomic<uint64_t>> own_words(size_t count) {
    own_words_ = std::vector<std::atomic<uint64_t>>(count);
    return own_words_;
  }

  uint32_t rank_ = 0;
  uint32_t count_ = 1;
  uint32_t rank_on_host_ = 0;
  uint32_t count_on_host_ = 1;
  uint32_t first_on_host_ = 0;
  std::vector<std::atomic<uint64_t>> own_words_;
};

/// Ends all ranks with this code, if there are several, so that they do not wait for a rank that failed. Called by main
/// after the error is printed.
void end_all_ranks(int exit_code);

}  // namespace scree::tools
