#include "tools/render/gpu_links.h"

#include <chrono>
#include <cstdio>
#include <cstring>
#include <span>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace scree::tools {
namespace {

using runtime::NcclGroup;

constexpr std::chrono::seconds kMostWait{60};  // of connecting
constexpr std::chrono::milliseconds kPause{2};

/// A rank's part in the choice. Passed between the ranks as bytes.
struct Introduction {
  char gpu[64];  // its UUID; empty: no GPU or no NCCL
  NcclGroup::Id id;
};

Error not_connected(const std::string& why) {
  return {ErrorCode::kDevice, "--exchange nccl: " + why};
}

/// Why these ranks cannot connect their GPUs; empty if they can.
std::string reason_against(std::span<const Introduction> all) {
  for (size_t i = 0; i < all.size(); ++i) {
    if (all[i].gpu[0] == '\0') return "rank " + std::to_string(i) + " has no GPU or no NCCL";
    for (size_t j = 0; j < i; ++j)
      if (std::strcmp(all[i].gpu, all[j].gpu) == 0)
        return "ranks " + std::to_string(j) + " and " + std::to_string(i) + " share a GPU";
  }
  return {};
}

}  // namespace

Result<void> GpuLinks::begin(Ranks& ranks, const std::optional<runtime::Gpu>& gpu, Exchange exchange, uint64_t words,
                             uint64_t frames) {
  if (exchange == Exchange::kMpi || (exchange == Exchange::kAuto && frames < kLeastFrames)) return {};
  Introduction own{};
  std::string why = "no GPU draws here";
  if (gpu) {
    Result<NcclGroup> opened = NcclGroup::open();
    if (opened && ranks.is_first()) {
      const Result<NcclGroup::Id> id = opened->make_id();
      if (id)
        own.id = *id;
      else
        opened = id.error();
    }
    if (opened) {
      group_ = std::make_shared<NcclGroup>(std::move(*opened));
      gpu->uuid.copy(own.gpu, sizeof own.gpu - 1);
    } else {
      why = opened.error().message;
    }
  }
  const std::vector<std::byte> bytes = SCREE_TRY(ranks.share(std::as_bytes(std::span(&own, 1))));
  std::vector<Introduction> all(ranks.count());
  std::memcpy(all.data(), bytes.data(), bytes.size());
  const std::string against = reason_against(all);
  if (!against.empty()) {
    const bool is_own = group_ == nullptr;
    group_.reset();
    return exchange == Exchange::kNccl ? not_connected(is_own ? why : against) : Result<void>();
  }
  const uint32_t rank = ranks.rank(), count = ranks.count();
  std::packaged_task<Result<void>()> connect([group = group_, id = all[0].id, index = gpu->index, rank, count, words] {
    const Result<void> chosen = runtime::set_current_gpu(index);
    return chosen ? group->connect(id, rank, count, words) : chosen;
  });
  connected_ = connect.get_future();
  try {
    std::thread(std::move(connect)).detach();  // a rank that fails may leave others in connect() forever
  } catch (const std::system_error&) {
    std::promise<Result<void>> none;
    none.set_value(Error{ErrorCode::kMemory, "no thread left to connect the GPUs"});
    connected_ = none.get_future();
  }
  return {};
}

Result<void> GpuLinks::finish(Ranks& ranks, Exchange exchange, bool quiet) {
  if (group_ == nullptr) return {};
  enum State : uint64_t { kFailed, kConnecting, kConnected };
  const auto end = std::chrono::steady_clock::now() + kMostWait;
  std::optional<Result<void>> own;
  for (;; std::this_thread::sleep_for(kPause)) {
    if (!own && connected_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) own = connected_.get();
    if (!own && ranks.is_first() && std::chrono::steady_clock::now() > end)
      own = Error{ErrorCode::kDevice, "NCCL: the ranks' GPUs were not connected in time"};
    uint64_t least = !own ? kConnecting : *own ? kConnected : kFailed;
    SCREE_TRY(ranks.least(std::span(&least, 1)));
    if (least == kConnected) return {};
    if (least == kConnecting) continue;
    group_.reset();
    const bool is_own = own && !*own;
    if (exchange == Exchange::kNccl)
      return not_connected(is_own ? own->error().message : "another rank could not be connected");
    if (is_own && !quiet)
      std::fprintf(stderr, "scree render: warning: the ranks exchange through host memory: %s\n",
                   ranks.named(own->error()).message.c_str());
    return {};
  }
}

}  // namespace scree::tools
