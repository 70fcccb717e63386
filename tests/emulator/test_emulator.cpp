// Checks that the emulated GPU gives a GPU's results, and ends the program where a GPU's behaviour is undefined.
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <string>
#include <utility>

#include "tests/catch.h"
#include "tests/emulator/cases.h"
#include "tests/gpu.h"
#include "tests/sanitized.h"

namespace emulator = scree::emulator;
using emulator::Mistake;

namespace {

/// The last output of a child process that makes the mistake.
std::string last_words(Mistake mistake) {
  int ends[2];
  REQUIRE(pipe(ends) == 0);
  const pid_t child = fork();
  if (child == 0) {
    dup2(ends[1], STDERR_FILENO);
    close(STDOUT_FILENO);
    std::signal(SIGABRT, SIG_DFL);  // otherwise Catch2 would report it
    emulator::make(mistake);
    _exit(0);
  }
  close(ends[1]);
  std::string said;
  char piece[256];
  for (ssize_t count; (count = read(ends[0], piece, sizeof piece)) > 0;) said.append(piece, static_cast<size_t>(count));
  close(ends[0]);
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(!(WIFEXITED(status) && WEXITSTATUS(status) == 0));
  return said;
}

}  // namespace

TEST_CASE("the emulated GPU has a GPU's collectives, atomics, shared memory and streams", "[cuda][emulator]") {
  if (!scree::tests::has_gpu()) return;
  CHECK(emulator::check_intrinsics() == "");
  CHECK(emulator::check_shared_memory() == "");
  CHECK(emulator::check_streams() == "");
}

TEST_CASE("the emulated GPU reports where a kernel breaks a rule", "[cuda][emulator]") {
  if (!scree::tests::has_gpu()) return;
  const std::pair<Mistake, const char*> mistakes[] = {{Mistake::kEndedLane, "lanes 0x00000008 that have ended"},
                                                      {Mistake::kOtherCollective, "of one warp, lane"},
                                                      {Mistake::kForeignLane, "asks lane 9, which is not in it"},
                                                      {Mistake::kNotOfMask, "is not of its __syncwarp(0x0000000f)"},
                                                      {Mistake::kStuck, "stuck, block 0, warp 0: lane"},
                                                      {Mistake::kCopyTooLong, "5 bytes at 0 of an allocation of 4"},
                                                      {Mistake::kSharedTooLong, "invalid configuration"}};
  if (scree::tests::kIsSanitized)
    CHECK(last_words(Mistake::kOverrun).find("heap-buffer-overflow") != std::string::npos);
  for (const auto& [mistake, words] : mistakes) {
    const std::string said = last_words(mistake);
    INFO(words << " | " << said);
    CHECK(said.find("emulated GPU: ") != std::string::npos);
    CHECK(said.find(words) != std::string::npos);
  }
}
