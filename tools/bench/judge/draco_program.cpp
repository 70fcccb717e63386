#include "tools/bench/judge/draco_program.h"

#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>

namespace scree::bench {
namespace {

constexpr int kRuns = 3;  // the fastest counts

/// Processor time of the programs that were started and have ended.
double children_s() {
  rusage usage{};
  ::getrusage(RUSAGE_CHILDREN, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

/// Runs a command of the shell that prints "(N ms to ...": at most how long that took. Its wall time counts what others
/// do on the machine, the program's processor time the files it reads and writes: the smaller is nearer.
Result<double> seconds_of(const std::string& command, const std::string& words) {
  struct Close {
    void operator()(std::FILE* pipe) const { ::pclose(pipe); }
  };
  const double before = children_s();
  std::unique_ptr<std::FILE, Close> pipe(::popen((command + " 2>&1").c_str(), "r"));
  if (!pipe) return Error{ErrorCode::kFile, command + ": cannot be run"};
  std::string text;
  char part[512];
  while (const size_t bytes = std::fread(part, 1, sizeof part, pipe.get())) text.append(part, bytes);
  if (::pclose(pipe.release()) != 0) return Error{ErrorCode::kFile, command + ": " + text.substr(0, text.find('\n'))};
  const double cpu_s = children_s() - before;
  const size_t end = text.find(words);
  const size_t begin = text.rfind('(', end);
  if (end == std::string::npos || begin == std::string::npos) return cpu_s;
  return std::min(cpu_s, std::strtod(text.c_str() + begin + 1, nullptr) * 1e-3);
}

}  // namespace

bool draco_is_there() {
  static const bool is_there =
      std::system("command -v draco_encoder >/dev/null && command -v draco_decoder >/dev/null") == 0;
  return is_there;
}

Result<DracoRun> run_draco(const std::string& input, const std::string& packed, const std::string& output,
                           uint32_t position_bits, int level) {
  DracoRun run;
  for (int i = 0; i < kRuns; ++i) {
    const auto encode_s = seconds_of("draco_encoder -i '" + input + "' -o '" + packed + "' -qp " +
                                         std::to_string(position_bits) + " -qn 12 -cl " + std::to_string(level),
                                     " ms to encode");
    if (!encode_s) return encode_s.error();
    const auto decode_s = seconds_of("draco_decoder -i '" + packed + "' -o '" + output + "'", " ms to decode");
    if (!decode_s) return decode_s.error();
    run.encode_s = std::min(run.encode_s, *encode_s);
    run.decode_s = std::min(run.decode_s, *decode_s);
  }
  std::error_code failed;
  run.bytes = std::filesystem::file_size(packed, failed);
  if (failed) return Error{ErrorCode::kFile, packed + ": " + failed.message()};
  return run;
}

}  // namespace scree::bench
