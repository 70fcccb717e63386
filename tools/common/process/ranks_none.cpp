// Ranks without MPI: the process must be the only one.
#include <cstdlib>
#include <string>

#include "tools/common/process/ranks.h"

namespace scree::tools {

Result<Ranks> Ranks::join() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS"}) {
    const char* const size = std::getenv(name);
    if (size != nullptr && std::atoi(size) > 1)
      return Error{ErrorCode::kUsage, "a launcher started " + std::string(size) +
                                          " of these, but this program was built without MPI (libopenmpi-dev; "
                                          "scripts/setup mpi installs it, then build again)"};
  }
  return Ranks();
}

Result<void> Ranks::agree(Result<void> own) {
  return own;
}
void Ranks::leave() {}
Result<std::span<std::atomic<uint64_t>>> Ranks::words_of_host(size_t count) {
  return own_words(count);
}
Result<std::vector<std::byte>> Ranks::share(std::span<const std::byte> own) {
  return std::vector<std::byte>(own.begin(), own.end());
}
Result<void> Ranks::sum(std::span<double>) {
  return {};
}
Result<void> Ranks::least(std::span<uint64_t>) {
  return {};
}
Result<void> Ranks::gather(std::span<float>, uint32_t) {
  return {};
}
Error Ranks::named(Error error) const {
  return error;
}
void end_all_ranks(int) {}

}  // namespace scree::tools
