#include "tests/faults/faults.h"

#include <sys/mman.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace scree::faults {
namespace {

struct Shared {
  std::atomic<bool> is_armed;
  std::atomic<bool> is_counting;  // plan.from has been reached
  std::atomic<bool> has_failed;
  std::atomic_flag lock;  // for the sites
  Plan plan;
  std::atomic<uint64_t> calls, run_number;
  std::atomic<int64_t> live;
  char failed_call[64];
  uint64_t site_count;
  uint64_t sites[kMaxSites];     // in the order of their first calls
  uint64_t seen[2 * kMaxSites];  // hash table of `sites`; 0: empty
};

Shared* shared = nullptr;
thread_local int foreign = 0;

uint64_t hash_of(const char* what, const void* site, uint64_t size) {
  uint64_t hash = reinterpret_cast<uintptr_t>(site) * 0x9e3779b97f4a7c15u ^ size * 0xc2b2ae3d27d4eb4fu;
  for (; *what != 0; ++what) hash = (hash ^ static_cast<unsigned char>(*what)) * 0x100000001b3u;
  hash ^= hash >> 29;
  return hash | 1;
}

void note_site(uint64_t site) {
  while (shared->lock.test_and_set(std::memory_order_acquire)) {
  }
  uint64_t at = site % (2 * kMaxSites);
  while (shared->seen[at] != 0 && shared->seen[at] != site) at = (at + 1) % (2 * kMaxSites);
  if (shared->seen[at] == 0 && shared->site_count < kMaxSites) {
    shared->seen[at] = site;
    shared->sites[shared->site_count++] = site;
  }
  shared->lock.clear(std::memory_order_release);
}

}  // namespace

Foreign::Foreign() {
  ++foreign;
}

Foreign::~Foreign() {
  --foreign;
}

void prepare() {
  void* const memory = ::mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) std::abort();
  shared = static_cast<Shared*>(memory);  // all zeros
}

void arm(const Plan& plan) {
  shared->plan = plan;
  shared->calls = 0;
  ++shared->run_number;
  shared->live = 0;
  shared->is_counting = plan.from[0] == 0;
  shared->has_failed = false;
  shared->failed_call[0] = 0;
  shared->site_count = 0;
  std::memset(shared->seen, 0, sizeof shared->seen);
  shared->is_armed = true;
}

void disarm() {
  shared->is_armed = false;
}

bool fails(Kind kind, const char* what, const void* site, uint64_t size) {
  if (shared == nullptr || !shared->is_armed || foreign != 0) return false;
  if (!shared->is_counting && std::strcmp(what, shared->plan.from) == 0) shared->is_counting = true;
  if (!shared->is_counting || kind != shared->plan.kind) return false;
  const uint64_t number = ++shared->calls;
  const bool is_survey = shared->plan.site == 0 && shared->plan.number == 0 && !shared->plan.every;
  const uint64_t hash = hash_of(what, site, size);
  if (is_survey) {
    note_site(hash);
    return false;
  }
  if (!shared->plan.every && number != shared->plan.number && hash != shared->plan.site) return false;
  if (shared->has_failed.exchange(true)) return shared->plan.every;
  std::snprintf(shared->failed_call, sizeof shared->failed_call, "%s, call %llu", what,
                static_cast<unsigned long long>(number));
  return true;
}

uint64_t call_count() {
  return shared->calls;
}

const char* failed_call() {
  return shared->failed_call;
}

uint64_t run_number() {
  return shared->run_number;
}

void add_live(int by) {
  if (shared != nullptr) shared->live += by;
}

int64_t live_count() {
  return shared->is_armed ? 0 : shared->live.load();
}

std::vector<uint64_t> sites() {
  return {shared->sites, shared->sites + shared->site_count};
}

}  // namespace scree::faults
