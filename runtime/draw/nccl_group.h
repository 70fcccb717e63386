// Processes that each have a GPU of their own exchange the words of a picture in device memory by NVIDIA's NCCL. Its
// library, libnccl.so.2, is opened at run time, so that neither a build nor a single process needs it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "format/result.h"

namespace scree::runtime {

/// One process of the group. Used by one thread at a time, with one current device from connect() on.
class NcclGroup {
 public:
  /// Names a group. The processes pass it to each other.
  using Id = std::array<char, 128>;

  /// Opens the library. Error kUnsupported: there is no library, it lacks a function that is needed, or the program is
  /// built without CUDA.
  static Result<NcclGroup> open();
  NcclGroup(NcclGroup&&) noexcept;
  NcclGroup& operator=(NcclGroup&&) noexcept;
  /// Ends the connections without waiting for the other processes. No exchange may be under way.
  ~NcclGroup();

  /// An id for a new group, made by one of its processes. Error kDevice.
  Result<Id> make_id() const;

  /// Connects the current device to those of the other processes. Called by all `count` processes, each with another
  /// number below `count` and another GPU; waits for all. Then exchanges `words` words once with each of the functions
  /// below, because NCCL connects for a kind of exchange only when it is first made. Error kDevice: NCCL's or CUDA's.
  /// The other processes may then wait forever.
  Result<void> connect(const Id& id, uint32_t number, uint32_t count, uint64_t words);

  // The next functions are called by all processes in the same order, with device memory for the same number of words.
  // They queue the exchange on `stream`, a cudaStream_t. Error kDevice.

  /// Each word becomes the minimum over all processes, in every process.
  Result<void> least(uint64_t* words, uint64_t count, void* stream);
  /// Each word becomes the maximum over all processes, in process `root` alone.
  Result<void> most(uint32_t* words, uint64_t count, uint32_t root, void* stream);

  /// Waits for the work that is queued on `stream`. Error kDevice, also if NCCL no longer reaches another process.
  Result<void> wait(void* stream);

 private:
  struct Impl;
  explicit NcclGroup(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::runtime
