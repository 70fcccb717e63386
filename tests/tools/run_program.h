// Runs the program as a separate process and measures its time.
#pragma once

#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <sstream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "tests/catch.h"
#include "tests/paths.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// The words of a command line, between blanks.
inline std::vector<std::string> words_of(const std::string& line) {
  std::istringstream stream(line);
  return {std::istream_iterator<std::string>(stream), {}};
}

/// Starts `program`. Both of its output streams go to the file `log`.
inline pid_t start_program(const std::vector<std::string>& words, const std::string& log,
                           const char* program = kProgram) {
  std::vector<char*> arguments;
  std::vector<std::string> all{program};
  all.insert(all.end(), words.begin(), words.end());
  for (std::string& word : all) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  posix_spawn_file_actions_adddup2(&files, STDOUT_FILENO, STDERR_FILENO);
  pid_t child = -1;
  REQUIRE(posix_spawn(&child, program, &files, nullptr, arguments.data(), environ) == 0);
  posix_spawn_file_actions_destroy(&files);
  return child;
}

inline int wait_for(pid_t child) {
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  return status;
}

/// Whether a child has ended; its status can still be read.
inline bool has_ended(pid_t child) {
  siginfo_t ended{};
  REQUIRE(waitid(P_PID, static_cast<id_t>(child), &ended, WEXITED | WNOHANG | WNOWAIT) == 0);
  return ended.si_pid != 0;
}

/// Waits until is_so() returns true, at most for the given time. Returns whether it did.
template <class Condition>
bool wait_until(const Condition& is_so, std::chrono::milliseconds longest = std::chrono::seconds(60)) {
  const auto end = std::chrono::steady_clock::now() + longest;
  bool is = is_so();
  for (; !is && std::chrono::steady_clock::now() < end; is = is_so())
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  return is;
}

struct ProgramRun {
  int exit_code = -1;  // -1: ended by a signal
  double seconds = 0;  // processor time, user and system
  std::string output;  // both streams
};

inline ProgramRun run_program(const std::vector<std::string>& words, const std::string& log,
                              const char* program = kProgram) {
  const pid_t child = start_program(words, log, program);
  int status = 0;
  rusage usage{};
  REQUIRE(wait4(child, &status, 0, &usage) == child);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, seconds(usage.ru_utime) + seconds(usage.ru_stime),
          read_whole(log)};
}

/// The same for a run that must succeed.
inline ProgramRun must_run(const std::vector<std::string>& words, const std::string& log,
                           const char* program = kProgram) {
  ProgramRun run = run_program(words, log, program);
  INFO(run.output);
  REQUIRE(run.exit_code == 0);
  return run;
}

/// The peak memory that convert's last line states, in bytes; 0 if there is none.
inline uint64_t stated_peak(const std::string& output) {
  const size_t at = output.find("peak memory ");
  double value = 0;
  char unit[4] = {};
  if (at == std::string::npos || std::sscanf(output.c_str() + at, "peak memory %lf %3s", &value, unit) != 2) return 0;
  const std::string_view name = unit;
  const int power = name == "GiB" ? 30 : name == "MiB" ? 20 : name == "KiB" ? 10 : 0;
  return static_cast<uint64_t>(std::ldexp(value, power));
}

/// The upper bound of convert's memory in the README.
inline uint64_t convert_memory_bound(uint64_t threads, uint64_t json_bytes) {
  return (uint64_t{256} << 20) + threads * (uint64_t{64} << 20) + 15 * json_bytes;
}

}  // namespace scree::tests
