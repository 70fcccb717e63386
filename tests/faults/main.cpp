// Runs a command of scree repeatedly, each time with another failing call, and checks the results:
//   scree_faults [-j N] [-p] [-s N] [-r] KIND WHICH FOLDER OUTPUTS -- CONVERT|INSPECT|... ARGUMENTS
// - KIND: file, memory, device, short.
// - WHICH: all; sites: one failure per call site in the program (for memory: and size). A suffix /N selects every N-th
//   of them. call/N: only the N-th call. every: all calls in one run. A suffix @NAME counts calls from the first of
//   that name on.
// - OUTPUTS: files in FOLDER, separated by commas. A + joins outputs that belong together. A leading ~ means that
//   successful runs may differ.
// - -j N: number of parallel runs, each in a copy of FOLDER.
// - -p: many runs in one process, which takes less time than a process per run. A call site that a run did not reach,
//   because a process reaches it only once, is tested again in a process of its own.
// - -s N: number of runs without a failure that find the call sites.
// - -r: each run begins with the .part of the interrupted run that got farthest, and may leave a .part when it fails.
//   Then the command runs again, and has to write the output of a run without a failure.
// Prints the errors and a line of counts. Exits with 0 if there are no errors.
//
// A run may succeed in spite of the failure. Its output must then equal the output of a run without a failure.
// Otherwise it must print one line, return its exit code, and leave no leak (memory in ASan's build, CUDA resources in
// any build). It may leave no new file, with two exceptions: an empty .part, if the file system does not even give the
// file's type, and a .part that could not be removed. Outputs must then be unchanged, or complete (the first of
// several; an output whose folder cannot be synced). Outputs that belong together must be unchanged or complete as a
// whole. For KIND short, where a call transfers half of the bytes and reports that, every run must succeed.
//
// With several threads the order of calls varies: the n-th call differs from run to run, and a run may have fewer
// calls. A run in which no call failed must be a good one, and its calls are counted like those of the first runs. The
// test tries all numbers up to the most calls of any run without a failure. The sites are the union over the first
// runs.
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/faults/experiment.h"

namespace {

namespace faults = scree::faults;

constexpr uint64_t kMostShown = 40;

struct Options {
  size_t jobs = 1;
  bool one_process = false;
  size_t surveys = 1;
  bool resumes = false;
  faults::Plan plan;
  std::string which;
  size_t step = 1;
  std::string folder;
  std::vector<std::vector<std::string>> outputs;
  bool may_differ = false;
  std::vector<std::string> words = {"scree"};
};

std::vector<std::string> split(const std::string& list, char mark) {
  std::vector<std::string> parts;
  std::stringstream stream(list);
  for (std::string part; std::getline(stream, part, mark);) parts.push_back(part);
  return parts;
}

std::optional<Options> parse(int argc, char** argv) {
  Options options;
  int option = 0;
  while ((option = ::getopt(argc, argv, "+j:prs:")) != -1) {
    if (option == 'j') options.jobs = std::strtoul(optarg, nullptr, 10);
    if (option == 's') options.surveys = std::strtoul(optarg, nullptr, 10);
    if (option == 'p') options.one_process = true;
    if (option == 'r') options.resumes = true;
    if (option == '?') return std::nullopt;
  }
  const int count = argc - optind;
  char** const words = argv + optind;
  if (count < 6 || std::string_view(words[4]) != "--" || options.jobs == 0 || options.surveys == 0) return std::nullopt;
  const std::string_view kind = words[0];
  if (kind == "memory") options.plan.kind = faults::Kind::kMemory;
  if (kind == "device") options.plan.kind = faults::Kind::kDevice;
  if (kind == "short") options.plan.kind = faults::Kind::kShort;
  std::string_view which = words[1];
  if (const size_t at = which.find('@'); at != std::string_view::npos) {
    if (which.substr(at + 1).size() >= sizeof options.plan.from) return std::nullopt;
    which.substr(at + 1).copy(options.plan.from, sizeof options.plan.from - 1);
    which = which.substr(0, at);
  }
  if (const size_t slash = which.find('/'); slash != std::string_view::npos) {
    options.step = std::max(1ul, std::strtoul(which.data() + slash + 1, nullptr, 10));
    which = which.substr(0, slash);
  }
  options.which = which;
  options.folder = words[2];
  options.may_differ = words[3][0] == '~';
  for (const std::string& group : split(words[3] + (options.may_differ ? 1 : 0), ','))
    options.outputs.push_back(split(group, '+'));
  options.words.insert(options.words.end(), words + 5, words + count);
  return options;
}

/// The state that all processes share. Each run takes the next number.
struct Progress {
  std::atomic<uint64_t> next;
  std::atomic<uint64_t> most;  // most calls of any run without a failure
  std::atomic<uint64_t> refused, borne;
  std::atomic<uint64_t> missed, wrong;
  std::atomic<uint64_t> missed_sites;
  uint64_t missed_site[faults::kMaxSites];  // the first `missed_sites`
};

template <class T>
T& shared_memory() {
  void* const memory = ::mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) std::abort();
  return *new (memory) T();
}

/// Makes runs in its own folder until all numbers are taken.
class Worker {
 public:
  Worker(const Options& options, const std::vector<uint64_t>& sites, const faults::Expected& expected,
         Progress& progress, const std::string& folder, const std::string& part)
      : options_(options),
        sites_(sites),
        expected_(expected),
        progress_(progress),
        experiment_(folder, options.outputs, options.words),
        out_(::fdopen(::dup(STDOUT_FILENO), "w")) {
    experiment_.find_part(part);
    if (out_ == nullptr) std::abort();
  }

  /// Makes runs until none is left; the only task of a process.
  void work() {
    if (options_.one_process) experiment_.stay_here();
    while (const std::optional<faults::Plan> plan = next_plan()) {
      const faults::Run run = experiment_.run(*plan);
      const std::string failed = faults::failed_call();
      // The state that a failed run left in this process must not affect further runs.
      if (!judge(run) && options_.one_process) return;
      if (failed.empty() && plan->site != 0) miss(plan->site);
      if (!options_.resumes || run.code == 0) continue;
      const faults::Run again = experiment_.run_again();
      const std::string fault = fault_of(again, expected_, "");
      if (fault.empty()) continue;
      print_failure(failed + " failed before, and then", fault, again);
      if (options_.one_process) return;
    }
  }

  /// Checks the run in which the process ended.
  void judge_end(int status) { judge(experiment_.end_of(status)); }

 private:
  std::optional<faults::Plan> next_plan() {
    faults::Plan plan = options_.plan;
    uint64_t number = progress_.next;
    do {
      if (number >= progress_.most) return std::nullopt;
    } while (!progress_.next.compare_exchange_weak(number, number + options_.step));
    if (options_.which == "sites") {
      plan.site = sites_[number];
    } else if (options_.which == "every") {
      plan.every = true;
    } else {
      plan.number = number + 1;
    }
    return plan;
  }

  void miss(uint64_t site) {
    const uint64_t place = progress_.missed_sites++;
    if (place < faults::kMaxSites) progress_.missed_site[place] = site;
  }

  bool judge(const faults::Run& run) {
    const std::string failed = faults::failed_call();
    const std::string fault = fault_of(run, expected_, failed);
    if (failed.empty()) {
      ++progress_.missed;
      uint64_t most = progress_.most;
      while (options_.which == "all" && fault.empty() && most < faults::call_count() &&
             !progress_.most.compare_exchange_weak(most, faults::call_count())) {
      }
    } else {
      ++(run.code == 0 ? progress_.borne : progress_.refused);
    }
    if (fault.empty()) return true;
    print_failure(
        (failed.empty() ? "nothing" : failed) + (options_.plan.kind == faults::Kind::kShort ? " stops" : " fails"),
        fault, run);
    return false;
  }

  void print_failure(const std::string& when, const std::string& fault, const faults::Run& run) {
    if (++progress_.wrong > kMostShown) return;
    std::fprintf(out_, "%s: %s %s: %s\n", when.c_str(), options_.words[1].c_str(), fault.c_str(),
                 run.errors.substr(0, run.errors.find("    #14")).c_str());
    std::fflush(out_);
  }

  const Options& options_;
  const std::vector<uint64_t>& sites_;
  const faults::Expected& expected_;
  Progress& progress_;
  faults::Experiment experiment_;
  std::FILE* out_;
};

/// Keeps `jobs` processes at work, each in its own folder. Replaces a process that ends early.
void run_all(const Options& options, const std::vector<uint64_t>& sites, const faults::Expected& expected,
             Progress& progress, const std::string& part) {
  std::vector<pid_t> processes(options.jobs, -1);
  const auto start = [&](size_t job) {
    const std::string folder = options.jobs == 1 ? options.folder : options.folder + "." + std::to_string(job);
    if (!std::filesystem::exists(folder))
      std::filesystem::copy(options.folder, folder, std::filesystem::copy_options::recursive);
    std::fflush(nullptr);
    const pid_t watcher = ::fork();
    if (watcher != 0) return watcher;
    faults::prepare();
    Worker worker(options, sites, expected, progress, folder, part);
    const pid_t process = options.one_process ? ::fork() : 0;
    if (process == 0) {
      worker.work();
      ::_exit(0);
    }
    int status = 0;
    while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
    }
    if (status != 0) worker.judge_end(status);
    if (process < 0 || faults::run_number() == 0) ::_exit(1);
    ::_exit(0);
  };
  for (;;) {
    bool any = false;
    for (size_t job = 0; job < options.jobs; ++job) {
      if (processes[job] < 0 && progress.next < progress.most) processes[job] = start(job);
      any = any || processes[job] >= 0;
    }
    if (!any) break;
    int status = 0;
    const pid_t ended = ::wait(&status);
    std::replace(processes.begin(), processes.end(), ended, -1);
    if (status == 0) continue;
    ++progress.wrong;
    progress.next = progress.most.load();
    std::printf("scree_faults: a process that makes runs did not begin or has ended\n");
  }
  if (options.jobs == 1) return;
  for (size_t job = 0; job < options.jobs; ++job)
    std::filesystem::remove_all(options.folder + "." + std::to_string(job));
}

/// The .part of the run whose failing file call is the last one after which all pages can still be resumed. Nullopt if
/// there is no such call.
std::optional<std::string> make_part(faults::Experiment& experiment) {
  const faults::Run good = experiment.run({});
  for (uint64_t number = faults::call_count(); good.code == 0 && number > 0; --number) {
    const faults::Plan plan{.number = number};
    if (experiment.run(plan).code == 0) continue;
    const std::string part = experiment.left_part();
    if (part.empty()) continue;
    const faults::Run again = experiment.run_again();
    if (again.code != 0 || again.outputs != good.outputs || again.errors.find("starts afresh") != std::string::npos)
      continue;
    experiment.find_part(part);
    return part;
  }
  return std::nullopt;
}

}  // namespace

int main(int argc, char** argv) {
  const std::optional<Options> parsed = parse(argc, argv);
  if (!parsed) {
    std::fprintf(
        stderr,
        "scree_faults [-j N] [-p] [-s N] [-r] file|memory|device|short all[/N][@NAME]|sites[/N][@NAME]|call/N[@NAME]|"
        "every[@NAME] FOLDER OUTPUTS -- ARGUMENTS\n");
    return 1;
  }
  const Options& options = *parsed;
  const char* const command = options.words[1].c_str();
  faults::prepare();
  faults::Experiment experiment(options.folder, options.outputs, options.words);
  faults::Expected expected;
  const bool all_succeed = options.plan.kind == faults::Kind::kShort;
  expected.code = all_succeed ? 0 : options.plan.kind == faults::Kind::kDevice ? 4 : 2;
  expected.may_differ = options.may_differ;
  expected.earlier = experiment.earlier_outputs();
  expected.outputs = experiment.new_outputs();
  expected.keeps_part = options.resumes;
  std::string part;
  if (options.resumes) {
    std::optional<std::string> made = make_part(experiment);
    if (!made) {
      std::fprintf(stderr, "scree_faults: no run that fails leaves a .part to go on with\n");
      return 1;
    }
    part = std::move(*made);
  }
  uint64_t calls = 0;
  std::vector<uint64_t> sites;
  for (size_t i = 0; i < options.surveys; ++i) {
    const faults::Run run = experiment.run(options.plan);
    if (i == 0) expected.good = run;
    const std::string fault = fault_of(run, expected, "");
    if (!fault.empty() || (!options.outputs.empty() && run.outputs == expected.earlier)) {
      std::fprintf(stderr, "scree_faults: %s, where nothing fails: %s\n", fault.c_str(), run.errors.c_str());
      return 1;
    }
    calls = std::max(calls, faults::call_count());
    for (const uint64_t site : faults::sites())
      if (std::find(sites.begin(), sites.end(), site) == sites.end()) sites.push_back(site);
  }

  Progress& progress = shared_memory<Progress>();
  progress.next = options.which == "call" ? options.step - 1 : 0;
  progress.most = options.which == "call"    ? options.step
                  : options.which == "every" ? 1
                  : options.which == "all"   ? calls
                                             : sites.size();
  run_all(options, sites, expected, progress, part);
  if (options.one_process && progress.missed_sites != 0) {
    Options alone = options;
    alone.one_process = false;
    alone.step = 1;
    const uint64_t count = std::min(progress.missed_sites.load(), faults::kMaxSites);
    const std::vector<uint64_t> missed(progress.missed_site, progress.missed_site + count);
    progress.missed = progress.next = 0;
    progress.most = missed.size();
    run_all(alone, missed, expected, progress, part);
  }
  const auto count = [](const std::atomic<uint64_t>& value) { return static_cast<unsigned long long>(value); };
  std::printf("%s: %llu calls from %zu sites; %llu failed: %llu refused, %llu borne, %llu not met, %llu wrong\n",
              command, static_cast<unsigned long long>(calls), sites.size(), count(progress.refused + progress.borne),
              count(progress.refused), count(progress.borne), count(progress.missed), count(progress.wrong));
  // A share of a command that makes few calls may have only calls whose failure is borne.
  const bool is_small_share = options.step > 1 && options.which == "all" && progress.refused + progress.borne < 16;
  const bool any_told = (all_succeed ? progress.borne : progress.refused) > 0 || is_small_share;
  if (!any_told) std::printf("%s: nothing was %s\n", command, all_succeed ? "borne" : "refused");
  return progress.wrong > 0 || !any_told ? 1 : 0;
}
