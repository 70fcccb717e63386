// Ranks with MPI.
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <string>

#include <mpi.h>

#include "tools/common/process/ranks.h"

namespace scree::tools {
namespace {

/// Whether mpirun or srun started this process. Only then is MPI initialised, because that takes a second.
bool is_launched() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "MPI_LOCALNRANKS"})
    if (std::getenv(name) != nullptr) return true;
  return false;
}

Result<void> checked(int code, const char* call) {
  if (code == MPI_SUCCESS) return {};
  char text[MPI_MAX_ERROR_STRING] = {};
  int length = 0;
  MPI_Error_string(code, text, &length);
  return Error{ErrorCode::kFile, std::string("MPI: ") + call + ": " + text};
}

bool is_running() {
  int begun = 0, ended = 0;
  MPI_Initialized(&begun);
  MPI_Finalized(&ended);
  return begun != 0 && ended == 0;
}

/// The ranks of this host, and the memory of words_of_host(), while there are several ranks.
MPI_Comm host = MPI_COMM_NULL;
MPI_Win words = MPI_WIN_NULL;

std::string host_name() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "a host without a name";
}

}  // namespace

Result<Ranks> Ranks::join() {
  Ranks ranks;
  if (!is_launched()) return ranks;
  int provided = 0, rank = 0, count = 1, rank_on_host = 0, count_on_host = 1;
  if (!is_running()) SCREE_TRY(checked(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided), "MPI_Init"));
  MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &count);
  SCREE_TRY(checked(MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, rank, MPI_INFO_NULL, &host),
                    "MPI_Comm_split_type"));
  MPI_Comm_set_errhandler(host, MPI_ERRORS_RETURN);
  MPI_Comm_rank(host, &rank_on_host);
  MPI_Comm_size(host, &count_on_host);
  ranks.first_on_host_ = static_cast<uint32_t>(rank);
  SCREE_TRY(checked(MPI_Bcast(&ranks.first_on_host_, 1, MPI_UINT32_T, 0, host), "MPI_Bcast"));
  if (count == 1) ranks.leave();
  ranks.rank_ = static_cast<uint32_t>(rank);
  ranks.count_ = static_cast<uint32_t>(count);
  ranks.rank_on_host_ = static_cast<uint32_t>(rank_on_host);
  ranks.count_on_host_ = static_cast<uint32_t>(count_on_host);
  return ranks;
}

Result<void> Ranks::agree(Result<void> own) {
  if (count_ == 1) return own;
  const uint32_t mine = own ? count_ : rank_;
  uint32_t lowest = count_;
  SCREE_TRY(checked(MPI_Allreduce(&mine, &lowest, 1, MPI_UINT32_T, MPI_MIN, MPI_COMM_WORLD), "MPI_Allreduce"));
  if (lowest == count_ || lowest == rank_) return own;
  return checked(MPI_Barrier(MPI_COMM_WORLD), "MPI_Barrier");  // the lowest rank ends the program meanwhile
}

void Ranks::leave() {
  if (!is_running()) return;
  if (words != MPI_WIN_NULL) MPI_Win_free(&words);
  if (host != MPI_COMM_NULL) MPI_Comm_free(&host);
  MPI_Finalize();
}

Result<std::span<std::atomic<uint64_t>>> Ranks::words_of_host(size_t count) {
  if (count_ == 1) return own_words(count);
  constexpr int kWordBytes = sizeof(std::atomic<uint64_t>);
  const auto bytes = static_cast<MPI_Aint>(rank_on_host_ == 0 ? count * kWordBytes : 0);
  void* memory = nullptr;
  SCREE_TRY(checked(MPI_Win_allocate_shared(bytes, kWordBytes, MPI_INFO_NULL, host, &memory, &words),
                    "MPI_Win_allocate_shared"));
  MPI_Aint size = 0;
  int unit = 0;
  SCREE_TRY(checked(MPI_Win_shared_query(words, 0, &size, &unit, &memory), "MPI_Win_shared_query"));
  auto* const first = static_cast<std::atomic<uint64_t>*>(memory);
  if (rank_on_host_ == 0) std::uninitialized_value_construct_n(first, count);
  SCREE_TRY(checked(MPI_Barrier(host), "MPI_Barrier"));
  return std::span(first, count);
}

Result<std::vector<std::byte>> Ranks::share(std::span<const std::byte> own) {
  std::vector<std::byte> all(own.begin(), own.end());
  if (count_ == 1) return all;
  all.resize(own.size() * count_);
  const auto bytes = static_cast<int>(own.size());
  SCREE_TRY(checked(MPI_Allgather(own.data(), bytes, MPI_BYTE, all.data(), bytes, MPI_BYTE, MPI_COMM_WORLD),
                    "MPI_Allgather"));
  return all;
}

Result<void> Ranks::sum(std::span<double> values) {
  if (count_ == 1) return {};
  return checked(
      MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD),
      "MPI_Allreduce");
}

/// Exchanges values in bands, because MPI counts elements with int.
template <class T, class Exchange>
Result<void> in_bands(std::span<T> values, const Exchange& exchange) {
  constexpr size_t kBandBytes = size_t{16} << 20;
  constexpr size_t kBand = kBandBytes / sizeof(T);
  for (size_t first = 0; first < values.size(); first += kBand) {
    const std::span<T> band = values.subspan(first, std::min(kBand, values.size() - first));
    SCREE_TRY(exchange(band.data(), static_cast<int>(band.size())));
  }
  return {};
}

Result<void> Ranks::least(std::span<uint64_t> words) {
  if (count_ == 1) return {};
  return in_bands(words, [](uint64_t* band, int count) {
    return checked(MPI_Allreduce(MPI_IN_PLACE, band, count, MPI_UINT64_T, MPI_MIN, MPI_COMM_WORLD), "MPI_Allreduce");
  });
}

Result<void> Ranks::gather(std::span<float> values, uint32_t root) {
  if (count_ == 1) return {};
  return in_bands(values, [&](float* band, int count) {
    const void* const own = rank_ == root ? MPI_IN_PLACE : band;
    return checked(MPI_Reduce(own, band, count, MPI_UINT32_T, MPI_BOR, static_cast<int>(root), MPI_COMM_WORLD),
                   "MPI_Reduce");
  });
}

Error Ranks::named(Error error) const {
  if (count_ > 1)
    error.message =
        "rank " + std::to_string(rank_) + " of " + std::to_string(count_) + " on " + host_name() + ": " + error.message;
  return error;
}

void end_all_ranks(int exit_code) {
  if (is_running()) MPI_Abort(MPI_COMM_WORLD, exit_code);
}

}  // namespace scree::tools
