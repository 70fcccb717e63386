// Runs a command of scree over and over, each time with another call failing, and looks at what is left:
//   scree_faults KIND WHICH FOLDER OUTPUTS -- CONVERT|INSPECT|... ARGUMENTS
// KIND: file, memory, device. WHICH: all, or sites: one failure a place in the program (memory: and a size); with /N
// behind it every N-th of them; call/N: the N-th call alone; with @NAME at the end, of the calls from the first of that
// name on. OUTPUTS: files in FOLDER, with commas between, with + between those that belong together, ~ before all where
// they may come out otherwise. Prints what went wrong, and a line of counts; exits 0 where nothing did.
//
// A run may come to its end all the same, and then has to write what it writes without a failure. Else it has to say
// one line, to return its code, and to leave no leak (ASan's build) and no other file but an empty .part, where the
// file system does not even say what it is, and a .part that could not be removed. Outputs are then what they were
// before, or whole (the first of several; one whose folder cannot be synced), those that belong together all the same.
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/faults/faults.h"

int scree_main(int argc, char** argv);  // tools/main.cpp

namespace {

namespace faults = scree::faults;

constexpr unsigned kHangSeconds = 20;
constexpr const char* kEarlier = "what was there before";

std::string read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool is_part(const std::string& name) {
  return name.ends_with(".part");
}

std::set<std::string> names_in(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (is_part(entry.path().filename()) && entry.file_size() == 0) {
      std::filesystem::remove(entry.path());
    } else {
      names.insert(entry.path().filename().string());
    }
  }
  return names;
}

struct Run {
  int code = -1;  // -1: ended by `signal`
  int signal = 0;
  std::string errors;                // stderr
  std::vector<std::string> outputs;  // of those that belong together, one after the other
  std::set<std::string> names;
};

class Experiment {
 public:
  Experiment(std::string folder, std::vector<std::vector<std::string>> outputs, std::vector<std::string> words)
      : folder_(std::move(folder)), outputs_(std::move(outputs)), words_(std::move(words)) {}

  Run run(const faults::Plan& plan) const {
    for (const std::string& name : names_in(folder_))
      if (is_part(name)) std::filesystem::remove(path(name));
    for (const auto& group : outputs_)
      for (const std::string& name : group) std::ofstream(path(name), std::ios::binary) << kEarlier;
    std::fflush(nullptr);
    const pid_t child = ::fork();
    if (child == 0) run_child(plan);
    if (child < 0) {
      std::perror("scree_faults: fork");
      std::exit(1);
    }
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    Run run;
    if (WIFEXITED(status)) run.code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) run.signal = WTERMSIG(status);
    run.errors = read_file(log());
    std::filesystem::remove(log());
    for (const auto& group : outputs_) {
      run.outputs.emplace_back();
      for (const std::string& name : group) run.outputs.back() += read_file(path(name));
    }
    run.names = names_in(folder_);
    return run;
  }

  std::vector<std::string> earlier_outputs() const {
    std::vector<std::string> all;
    for (const auto& group : outputs_) {
      all.emplace_back();
      for (size_t i = 0; i < group.size(); ++i) all.back() += kEarlier;
    }
    return all;
  }

 private:
  std::string path(const std::string& name) const { return folder_ + "/" + name; }
  std::string log() const { return path("stderr.txt"); }

  [[noreturn]] void run_child(const faults::Plan& plan) const {
    ::alarm(kHangSeconds);
    const int errors = ::open(log().c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    const int nothing = ::open("/dev/null", O_WRONLY);
    if (errors < 0 || nothing < 0 || ::dup2(errors, STDERR_FILENO) < 0 || ::dup2(nothing, STDOUT_FILENO) < 0)
      ::_exit(99);
    if (::chdir(folder_.c_str()) != 0) ::_exit(99);
    std::vector<std::string> words = words_;
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    faults::arm(plan);
    const int code = scree_main(static_cast<int>(words.size()), arguments.data());
    faults::disarm();
    std::exit(code);  // where ASan's build looks for leaks
  }

  std::string folder_;
  std::vector<std::vector<std::string>> outputs_;
  std::vector<std::string> words_;
};

/// What is wrong with a run in which a call failed; empty where nothing is.
std::string fault_of(Run run, const Run& good, const std::vector<std::string>& earlier, int expected_code,
                     bool may_differ, const std::string& failed) {
  if (run.signal == SIGALRM) return "hangs";
  if (run.signal != 0) return "ends by signal " + std::to_string(run.signal);
  if (run.errors.find("Sanitizer") != std::string::npos) return "a sanitizer's report";
  if (failed.starts_with("unlink,") && run.code != 0) std::erase_if(run.names, is_part);
  if (run.names != good.names) {
    std::string text = "other files are there:";
    for (const std::string& name : run.names) text += " " + name;
    return text;
  }
  if (run.code == 0) {
    for (size_t i = 0; i < earlier.size(); ++i)
      if (run.outputs[i] != good.outputs[i] && (!may_differ || run.outputs[i] == earlier[i]))
        return "returns 0, but wrote something else";
    return "";
  }
  if (run.code != expected_code) return "returns " + std::to_string(run.code);
  for (size_t i = 0; i < earlier.size(); ++i)
    if (run.outputs[i] != earlier[i] && run.outputs[i] != good.outputs[i])
      return "returns an error, but spoils an output";
  if (std::count(run.errors.begin(), run.errors.end(), '\n') != 1 || !run.errors.starts_with("scree"))
    return "says not one line";
  return "";
}

}  // namespace

int main(int argc, char** argv) {
  const auto usage = [] {
    std::fprintf(
        stderr,
        "scree_faults file|memory|device all[/N][@NAME]|sites[/N][@NAME]|call/N[@NAME] FOLDER OUTPUTS -- ARGUMENTS\n");
    return 1;
  };
  if (argc < 7 || std::string_view(argv[5]) != "--") return usage();
  const std::string_view kind = argv[1];
  std::string_view which = argv[2];
  faults::Plan plan;
  if (kind == "memory") plan.kind = faults::Kind::kMemory;
  if (kind == "device") plan.kind = faults::Kind::kDevice;
  if (const size_t at = which.find('@'); at != std::string_view::npos) {
    if (which.substr(at + 1).size() >= sizeof plan.from) return usage();
    which.substr(at + 1).copy(plan.from, sizeof plan.from - 1);
    which = which.substr(0, at);
  }
  size_t step = 1;
  if (const size_t slash = which.find('/'); slash != std::string_view::npos) {
    step = std::max(1ul, std::strtoul(which.data() + slash + 1, nullptr, 10));
    which = which.substr(0, slash);
  }
  const auto split = [](const std::string& list, char mark) {
    std::vector<std::string> parts;
    std::stringstream stream(list);
    for (std::string part; std::getline(stream, part, mark);) parts.push_back(part);
    return parts;
  };
  std::vector<std::vector<std::string>> outputs;
  const bool may_differ = argv[4][0] == '~';
  for (const std::string& group : split(argv[4] + (may_differ ? 1 : 0), ',')) outputs.push_back(split(group, '+'));
  std::vector<std::string> words = {"scree"};
  words.insert(words.end(), argv + 6, argv + argc);

  faults::prepare();
  const Experiment experiment(argv[3], outputs, words);
  const Run good = experiment.run(plan);
  const std::vector<std::string> earlier = experiment.earlier_outputs();
  if (good.code != 0 || (!outputs.empty() && good.outputs == earlier)) {
    std::fprintf(stderr, "scree_faults: returns %d where nothing fails: %s\n", good.code, good.errors.c_str());
    return 1;
  }
  const uint64_t calls = faults::call_count();
  const std::vector<uint64_t> sites = faults::sites();
  const uint64_t count = which == "call" ? step : which == "all" ? calls : sites.size();
  uint64_t refused = 0, borne = 0, missed = 0, wrong = 0;
  for (uint64_t i = which == "call" ? step - 1 : 0; i < count; i += step) {
    if (which == "sites") {
      plan.site = sites[i];
    } else {
      plan.number = i + 1;
    }
    const Run run = experiment.run(plan);
    const std::string failed = faults::failed_call();
    if (failed.empty()) {  // threads take turns as they like
      ++missed;
      continue;
    }
    const std::string fault =
        fault_of(run, good, earlier, plan.kind == faults::Kind::kDevice ? 4 : 2, may_differ, failed);
    (run.code == 0 ? borne : refused) += 1;
    if (fault.empty()) continue;
    ++wrong;
    if (wrong <= 40)
      std::printf("%s fails: %s %s: %s\n", failed.c_str(), words[1].c_str(), fault.c_str(),
                  run.errors.substr(0, run.errors.find("    #14")).c_str());
  }
  std::printf("%s: %llu calls from %zu sites; %llu failed: %llu refused, %llu borne, %llu not met, %llu wrong\n",
              words[1].c_str(), static_cast<unsigned long long>(calls), sites.size(),
              static_cast<unsigned long long>(refused + borne), static_cast<unsigned long long>(refused),
              static_cast<unsigned long long>(borne), static_cast<unsigned long long>(missed),
              static_cast<unsigned long long>(wrong));
  if (refused == 0) std::printf("%s: nothing was refused\n", words[1].c_str());
  return wrong > 0 || refused == 0 ? 1 : 0;
}
