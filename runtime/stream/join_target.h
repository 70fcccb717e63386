// A device that joins split pages while a scene is uploaded or streamed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "format/result.h"
#include "runtime/stream/join_plan.h"

namespace scree::runtime {

/// Slots of host memory, and a device that copies them and joins their pages. Thread-safe. A thread may hold one slot
/// at a time.
class JoinTarget {
 public:
  struct Slot {
    uint32_t number;
    std::span<std::byte> memory;  // aligned to format::kPageAlignment
  };

  virtual uint32_t slot_count() const = 0;
  /// Bytes of pages that a slot holds. Its memory may be larger, for the tasks.
  virtual uint64_t slot_bytes() const = 0;
  /// A slot that is no longer read. Waits until there is one. Errors kDevice.
  virtual Result<Slot> take() = 0;
  /// Gives back a slot that join() has not taken.
  virtual void give_back(const Slot& slot) = 0;
  /// Takes the slot and starts the plan's tasks, whose sources are in its first `bytes`. Returns false if they need too
  /// much memory, and leaves the slot to the caller then, as after an error. Errors kDevice.
  virtual Result<bool> join(const Slot& slot, uint64_t bytes, const JoinPlan& plan) = 0;

 protected:
  ~JoinTarget() = default;
};

}  // namespace scree::runtime
