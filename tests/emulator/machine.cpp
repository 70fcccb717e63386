#include "tests/emulator/machine.h"

#include <sys/mman.h>

#include <array>
#include <boost/context/fiber.hpp>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <forward_list>
#include <map>
#include <memory>
#include <vector>

#if defined(SCREE_LANES_ARE_CHECKED)
#include <sanitizer/asan_interface.h>
#include <sanitizer/common_interface_defs.h>
#endif

namespace scree::emulator {
namespace {

using boost::context::fiber;

constexpr uint32_t kResidentBlocks = 3;  // blocks that take turns
constexpr size_t kStackBytes = size_t{256} * 1024;
// Not a multiple of a large power of two: otherwise the tops of all stacks would share one set of each cache.
constexpr size_t kStackStep = kStackBytes + 1088;
constexpr size_t kFirstFrameBytes = 4096;
constexpr uint64_t kStackEnd = 0x5ca1ab1e5ca1ab1e;  // stored at the far end of each stack

/// A stack for the address sanitizer.
struct Stack {
  const void* begin = nullptr;
  size_t bytes = 0;
  void* fake = nullptr;
};
[[maybe_unused]] thread_local Stack thread_stack;
Stack lane_stacks;  // of all lanes that may run, one behind another

/// The stack of a lane. A page takes memory only when it is used.
std::byte* stack_of_lane(uint32_t number) {
  static std::byte* const stacks = [] {
    const size_t bytes = kResidentBlocks * kMaxThreads * kStackStep;
    void* made = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (made == MAP_FAILED) fail("no memory for the lanes' stacks");
    lane_stacks = {made, bytes};
    return static_cast<std::byte*>(made);
  }();
  return stacks + number * kStackStep;
}

/// A stack allocator for Boost.Context. It keeps the stacks.
struct StackOf {
  std::byte* stack;

  boost::context::stack_context allocate() const {
    boost::context::stack_context context;
    context.size = kStackBytes;
    context.sp = stack + kStackBytes;
    return context;
  }
  void deallocate(boost::context::stack_context&) const noexcept {}
};

/// A barrier for the lanes of a mask in a warp, or for the lanes of a block.
struct Barrier {
  const char* what = nullptr;
  uint32_t mask = 0;
  uint32_t arrived = 0;  // mask of arrived lanes; for a block: their number
  uint64_t ended = 0;    // number of times this barrier was completed
  std::array<Passed, 2> passed{};
};

/// A copy that a lane has requested and not yet waited for.
struct LaterCopy {
  void* to;
  const void* from;
  size_t bytes;
  uint64_t group;
};

struct SharedVariable {
  size_t bytes = 0;
  std::unique_ptr<std::byte[]> memory;
};

struct Block;

struct Warp {
  std::forward_list<Barrier> barriers;  // one per mask that was used
  uint32_t ended = 0;                   // mask of ended lanes
};

struct Lane {
  Block* block;
  Warp* warp;
  uint32_t number;  // in its warp
  uint3 thread;
  std::byte* stack;
  fiber here;  // valid while the lane does not run
  const Barrier* waits = nullptr;
  uint64_t since = 0;  // value of waits->ended when the wait began
  bool has_ended = false;
  std::vector<LaterCopy> copies;
  uint64_t copy_group = 0;
};

/// The order in which the lanes of a block run. Each runs until it waits or ends.
struct Turn {
  uint32_t first;
  bool is_backwards;
  uint32_t visited, ran;
};

struct Block {
  const Grid* grid = nullptr;  // null: ended
  uint3 index;
  Turn turn;
  std::vector<Lane> lanes;
  std::vector<Warp> warps;
  Barrier all;
  uint32_t ended = 0;  // number of ended lanes
  std::map<uint32_t, SharedVariable> shared;
  size_t shared_bytes = 0;  // of all variables, and of the launch's dynamic memory
  std::unique_ptr<std::byte[]> dynamic;
};

thread_local Lane* current = nullptr;   // null: the thread's own code, run(), is running
thread_local Lane* previous = nullptr;  // ran before `current`

thread_local fiber outer;  // the thread's own code while a lane runs

/// Called before a switch from `previous` to `current`. The address sanitizer sees the stacks of all lanes as one, so
/// that only switches to and from the thread's own stack are reported to it. A test has millions of switches between
/// lanes.
void announce() {
#if defined(SCREE_LANES_ARE_CHECKED)
  if (previous == nullptr) {
    __sanitizer_start_switch_fiber(&thread_stack.fake, lane_stacks.begin, lane_stacks.bytes);
  } else if (current == nullptr) {
    __sanitizer_start_switch_fiber(&lane_stacks.fake, thread_stack.begin, thread_stack.bytes);
  }
#endif
}

/// Called by code that continues. `from`: the code that ran before; empty if it has ended.
void arrive(fiber&& from) {
#if defined(SCREE_LANES_ARE_CHECKED)
  if (previous == nullptr) {
    __sanitizer_finish_switch_fiber(lane_stacks.fake, &thread_stack.begin, &thread_stack.bytes);
  } else if (current == nullptr) {
    __sanitizer_finish_switch_fiber(thread_stack.fake, nullptr, nullptr);
  }
#endif
  (previous == nullptr ? outer : previous->here) = std::move(from);
}

std::unique_ptr<std::byte[]> garbage(size_t bytes) {
  auto made = std::make_unique_for_overwrite<std::byte[]>(bytes);
  std::memset(made.get(), kGarbage, bytes);
  return made;
}

bool can_go_on(const Lane& lane) {
  return !lane.has_ended && (lane.waits == nullptr || lane.waits->ended != lane.since);
}

/// The next lane of the block's turn that can run; null: the turn has ended.
Lane* next_of_turn(Block& block) {
  Turn& turn = block.turn;
  const auto count = static_cast<uint32_t>(block.lanes.size());
  while (turn.visited < count) {
    const uint32_t number = turn.first + (turn.is_backwards ? count - turn.visited : turn.visited);
    ++turn.visited;
    Lane& lane = block.lanes[number < count ? number : number - count];
    if (!can_go_on(lane)) continue;
    ++turn.ran;
    lane.waits = nullptr;
    return &lane;
  }
  return nullptr;
}

void end_block_barrier_if_all_came(Block& block) {
  Barrier& all = block.all;
  if (all.arrived == 0 || all.arrived + block.ended != block.lanes.size()) return;
  all.arrived = 0;
  ++all.ended;
}

void end(Lane& lane) {
  if (std::memcmp(lane.stack, &kStackEnd, sizeof kStackEnd) != 0)
    fail("%s: a lane took more than %zu bytes of stack", lane.block->grid->name, kStackBytes);
  lane.has_ended = true;
  lane.warp->ended |= 1u << lane.number;
  ++lane.block->ended;
  end_block_barrier_if_all_came(*lane.block);
}

fiber& code_of(Lane* lane);

fiber run_lane(Lane& lane, fiber&& from) {
  arrive(std::move(from));
  lane.block->grid->lane();
  end(lane);
  previous = &lane;
  current = next_of_turn(*lane.block);
  announce();
  return std::move(code_of(current));
}

/// The code of a lane, or of the thread, that will continue or begin.
fiber& code_of(Lane* lane) {
  if (lane == nullptr) return outer;
  if (!lane->here) {
    lane->here = fiber(std::allocator_arg, StackOf{lane->stack},
                       [lane](fiber&& from) { return run_lane(*lane, std::move(from)); });
  }
  return lane->here;
}

/// Switches from the running code to the next lane of the block's turn, or to the thread's own code if the turn has
/// ended. Returns when its caller may continue.
void switch_to_next(Block& block) {
  Lane* const next = next_of_turn(block);
  if (next == current) return;  // the thread's own code, and no lane can run
  previous = current;
  current = next;
  fiber& code = code_of(next);
  announce();
  arrive(std::move(code).resume());
}

/// Runs each lane of `block` that can run, until it waits or ends. Returns the number of these lanes.
uint32_t take_turn(Block& block) {
  block.turn = {random_below(static_cast<uint32_t>(block.lanes.size())), random_below(2) != 0, 0, 0};
  switch_to_next(block);
  return block.turn.ran;
}

[[noreturn]] void fail_stuck(const Block& block) {
  for (const Lane& lane : block.lanes) {
    if (lane.has_ended) continue;
    fail("%s, block %u, warp %u: lane %u waits in %s(0x%08x); lanes 0x%08x came, 0x%08x have ended", block.grid->name,
         block.index.x, static_cast<uint32_t>(lane.warp - block.warps.data()), lane.number,
         lane.waits->what == nullptr ? "__syncthreads" : lane.waits->what, lane.waits->mask, lane.waits->arrived,
         lane.warp->ended);
  }
  fail("%s: nothing to run", block.grid->name);
}

uint3 place_of(uint64_t number, const dim3& size) {
  return {static_cast<uint32_t>(number % size.x), static_cast<uint32_t>(number / size.x % size.y),
          static_cast<uint32_t>(number / size.x / size.y)};
}

uint64_t count_of(const dim3& size) {
  return uint64_t{size.x} * size.y * size.z;
}

/// Begins block `number` in `block`, which has ended or never begun.
void begin_block(Block& block, const Grid& grid, uint64_t number, uint32_t slot) {
  block.grid = &grid;
  block.index = place_of(number, grid.blocks);
  block.shared.clear();
  block.dynamic = garbage(grid.shared_bytes);
  block.shared_bytes = grid.shared_bytes;
  block.ended = 0;
  const auto threads = static_cast<uint32_t>(count_of(grid.threads));
  block.warps.resize((threads + kWarpLanes - 1) / kWarpLanes);
  for (Warp& warp : block.warps) warp.ended = 0;
  // The last warp may have fewer lanes.
  if (threads % kWarpLanes != 0) block.warps.back().ended = ~0u << threads % kWarpLanes;
  block.lanes.clear();
  block.lanes.resize(threads);
  for (uint32_t i = 0; i < threads; ++i) {
    Lane& lane = block.lanes[i];
    lane.block = &block;
    lane.warp = &block.warps[i / kWarpLanes];
    lane.number = i % kWarpLanes;
    lane.thread = place_of(i, grid.threads);
    lane.stack = stack_of_lane(slot * kMaxThreads + i);
#if defined(SCREE_LANES_ARE_CHECKED)
    // The first frames of the lane that last had this stack never returned, and have left their memory poisoned.
    __asan_unpoison_memory_region(lane.stack + kStackBytes - kFirstFrameBytes, kFirstFrameBytes);
#endif
    std::memcpy(lane.stack, &kStackEnd, sizeof kStackEnd);
  }
}

/// The barrier of `mask`, which moves to the front of the warp's list: most masks are used again soon.
Barrier& barrier_of(Warp& warp, uint32_t mask) {
  std::forward_list<Barrier>& all = warp.barriers;
  auto before = all.before_begin();
  auto place = all.begin();
  while (place != all.end() && place->mask != mask) before = place++;
  if (place == all.end()) {
    all.emplace_front().mask = mask;
  } else {
    all.splice_after(all.before_begin(), all, before);
  }
  return all.front();
}

}  // namespace

const uint3& thread_index() {
  return current->thread;
}
const uint3& block_index() {
  return current->block->index;
}
const dim3& block_size() {
  return current->block->grid->threads;
}
const dim3& grid_size() {
  return current->block->grid->blocks;
}

void* shared_memory(uint32_t declaration, size_t bytes) {
  Block& block = *current->block;
  SharedVariable& variable = block.shared[declaration];
  if (variable.memory == nullptr) {
    variable = {bytes, garbage(bytes)};
    block.shared_bytes += bytes;
    if (block.shared_bytes > kSharedBytes)
      fail("%s: %zu bytes of shared memory, of %zu", block.grid->name, block.shared_bytes, kSharedBytes);
  }
  if (variable.bytes != bytes) fail("%s: one shared variable of two sizes", block.grid->name);
  return variable.memory.get();
}

void* dynamic_shared_memory() {
  return current->block->dynamic.get();
}

const Passed& exchange_in_warp(const char* what, uint32_t mask, uint64_t value) {
  Lane& lane = *current;
  Warp& warp = *lane.warp;
  const char* const kernel = lane.block->grid->name;
  if ((mask >> lane.number & 1u) == 0) fail("%s: lane %u is not of its %s(0x%08x)", kernel, lane.number, what, mask);
  if ((mask & warp.ended) != 0) {
    fail("%s: lane %u in %s(0x%08x) would wait for lanes 0x%08x that have ended", kernel, lane.number, what, mask,
         mask & warp.ended);
  }
  Barrier* const barrier = &barrier_of(warp, mask);
  Passed& passed = barrier->passed[barrier->ended % 2];
  if (barrier->arrived == 0) {
    barrier->what = what;
    passed.odd = 0;
  }
  if (barrier->what != what && std::strcmp(barrier->what, what) != 0)
    fail("%s: of one warp, lane %u is in %s(0x%08x), others in %s", kernel, lane.number, what, mask, barrier->what);
  passed.values[lane.number] = value;
  passed.odd |= static_cast<uint32_t>(value & 1u) << lane.number;
  barrier->arrived |= 1u << lane.number;
  if (barrier->arrived == mask) {
    barrier->arrived = 0;
    ++barrier->ended;
    if (random_below(8) == 0) switch_to_next(*lane.block);
  } else {
    lane.waits = barrier;
    lane.since = barrier->ended;
    switch_to_next(*lane.block);
  }
  return passed;
}

void sync_block() {
  Lane& lane = *current;
  lane.waits = &lane.block->all;
  lane.since = lane.block->all.ended;
  ++lane.block->all.arrived;
  end_block_barrier_if_all_came(*lane.block);
  switch_to_next(*lane.block);
}

void copy_later(void* to, const void* from, size_t bytes) {
  const bool is_aligned = (reinterpret_cast<uintptr_t>(to) | reinterpret_cast<uintptr_t>(from)) % bytes == 0;
  if ((bytes != 4 && bytes != 8 && bytes != 16) || !is_aligned)
    fail("%s: a copy of %zu bytes from %p to %p", current->block->grid->name, bytes, from, to);
  current->copies.push_back({to, from, bytes, current->copy_group});
}

void end_copies() {
  ++current->copy_group;
}

void wait_for_copies(uint32_t groups) {
  std::vector<LaterCopy>& copies = current->copies;
  std::erase_if(copies, [&](const LaterCopy& copy) {
    const bool is_due = copy.group + groups < current->copy_group;
    if (is_due) std::memcpy(copy.to, copy.from, copy.bytes);
    return is_due;
  });
}

void pause_at_atomic() {
  if (current != nullptr && random_below(8) == 0) switch_to_next(*current->block);
}

uint32_t random_below(uint32_t bound) {
  static uint64_t state = [] {
    const char* seed = std::getenv("SCREE_EMULATOR_SEED");
    return (seed == nullptr ? 0 : std::strtoull(seed, nullptr, 10)) * 0x9e3779b97f4a7c15 + 0x853c49e6748fea9b;
  }();
  state ^= state << 13;
  state ^= state >> 7;
  state ^= state << 17;
  return static_cast<uint32_t>((state >> 32) * bound >> 32);
}

void run(const Grid& grid) {
  static std::array<Block, kResidentBlocks> resident;  // their memory is reused for many blocks
  if (current != nullptr) fail("%s: launched by a kernel", grid.name);
  const uint64_t count = count_of(grid.blocks);
  const bool backwards = random_below(2) != 0;
  uint64_t begun = 0;
  for (bool runs = true; runs;) {
    runs = false;
    for (uint32_t slot = 0; slot < kResidentBlocks; ++slot) {
      Block& block = resident[slot];
      if (block.grid == nullptr) {
        if (begun == count) continue;
        begin_block(block, grid, backwards ? count - 1 - begun : begun, slot);
        ++begun;
      }
      runs = true;
      if (take_turn(block) == 0) fail_stuck(block);
      if (block.ended == block.lanes.size()) block.grid = nullptr;
    }
  }
}

void fail(const char* format, ...) {
  std::fflush(stdout);
  std::fputs("emulated GPU: ", stderr);
  va_list parameters;
  va_start(parameters, format);
  std::vfprintf(stderr, format, parameters);
  va_end(parameters);
  std::fputc('\n', stderr);
  std::abort();
}

}  // namespace scree::emulator
