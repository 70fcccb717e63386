#include "tests/faults/experiment.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <utility>

#include "tests/faults/own_commands.h"
#include "tests/tools/temp_folder.h"

int scree_main(int argc, char** argv);  // tools/main.cpp

// Present only with ASan: whether memory has leaked so far.
extern "C" __attribute__((weak)) int __lsan_do_recoverable_leak_check();

// OpenEXR 3.1 leaks if memory runs out while it makes an OutputFile. LeakSanitizer calls these functions by name.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libOpenEXR\n";
}
extern "C" const char* __lsan_default_options();
extern "C" const char* __lsan_default_options() {
  return "print_suppressions=0";
}

namespace scree::faults {
namespace {

constexpr unsigned kHangSeconds = 20;
constexpr const char* kEarlier = "what was there before";

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

}  // namespace

Experiment::Experiment(std::string folder, std::vector<std::vector<std::string>> outputs,
                       std::vector<std::string> words)
    : folder_(std::move(folder)), outputs_(std::move(outputs)), words_(std::move(words)) {}

Run Experiment::run(const Plan& plan) const {
  lay_out();
  return run_in_place(plan);
}

Run Experiment::run_again() const {
  return run_in_place({});
}

std::string Experiment::left_part() const {
  return tests::read_whole(part_path());
}

Run Experiment::run_in_place(const Plan& plan) const {
  if (stays_here_) return run_here(plan);
  std::fflush(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    redirect();
    std::exit(call(plan));  // ASan's build checks for leaks here
  }
  if (child < 0) {
    std::perror("scree_faults: fork");
    std::exit(1);
  }
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return end_of(status);
}

void Experiment::stay_here() {
  redirect();
  stays_here_ = true;
}

void Experiment::redirect() const {
  const int errors = ::open(log().c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND, 0666);
  const int nothing = ::open("/dev/null", O_WRONLY);
  if (errors < 0 || nothing < 0 || ::dup2(errors, STDERR_FILENO) < 0 || ::dup2(nothing, STDOUT_FILENO) < 0 ||
      ::chdir(folder_.c_str()) != 0)
    ::_exit(99);
  (void)::close(errors);
  (void)::close(nothing);
}

Run Experiment::run_here(const Plan& plan) const {
  if (::ftruncate(STDERR_FILENO, 0) != 0) ::_exit(99);
  Run run{.code = call(plan)};
  ::alarm(0);
  std::fflush(nullptr);
  if (__lsan_do_recoverable_leak_check != nullptr) (void)__lsan_do_recoverable_leak_check();
  collect(run);
  return run;
}

Run Experiment::end_of(int status) const {
  Run run;
  if (WIFEXITED(status)) run.code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) run.signal = WTERMSIG(status);
  collect(run);
  return run;
}

std::vector<std::string> Experiment::earlier_outputs() const {
  std::vector<std::string> all;
  for (const auto& group : outputs_) {
    all.emplace_back();
    for (size_t i = 0; i < group.size() && has_earlier(); ++i) all.back() += kEarlier;
  }
  return all;
}

std::set<std::string> Experiment::new_outputs() const {
  std::set<std::string> names;
  for (const auto& group : outputs_)
    if (!has_earlier()) names.insert(group.begin(), group.end());
  return names;
}

bool Experiment::has_earlier() const {
  return own_command(words_[1].c_str()) != nullptr ||
         std::find(words_.begin(), words_.end(), "--force") != words_.end();
}

void Experiment::lay_out() const {
  for (const std::string& name : names_in(folder_))
    if (is_part(name)) std::filesystem::remove(path(name));
  for (const auto& group : outputs_)
    for (const std::string& name : group) {
      std::filesystem::remove(path(name));
      if (has_earlier()) std::ofstream(path(name), std::ios::binary) << kEarlier;
    }
  if (!part_.empty()) std::ofstream(part_path(), std::ios::binary) << part_;
}

void Experiment::collect(Run& run) const {
  run.live = live_count();
  run.errors = tests::read_whole(log());
  for (const auto& group : outputs_) {
    run.outputs.emplace_back();
    for (const std::string& name : group) run.outputs.back() += tests::read_whole(path(name));
  }
  run.names = names_in(folder_);
}

int Experiment::call(const Plan& plan) const {
  std::vector<std::string> words = words_;
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  ::alarm(kHangSeconds);
  arm(plan);
  const Main own = own_command(arguments[1]);
  const int code = (own != nullptr ? own : scree_main)(static_cast<int>(words.size()), arguments.data());
  disarm();
  return code;
}

std::string fault_of(Run run, const Expected& expected, const std::string& failed) {
  if (run.signal == SIGALRM) return "hangs";
  if (run.signal != 0) return "ends by signal " + std::to_string(run.signal);
  if (run.errors.find("Sanitizer") != std::string::npos) return "a sanitizer's report";
  if (run.live != 0) return "leaves " + std::to_string(run.live) + " of what CUDA gave it";
  if ((failed.starts_with("unlink,") || expected.keeps_part) && run.code != 0) std::erase_if(run.names, is_part);
  std::set<std::string> good_names = expected.good.names;
  if (run.code != 0)
    for (const std::string& name : expected.outputs)
      if (!run.names.contains(name)) good_names.erase(name);
  if (run.names != good_names) {
    std::string text = "other files are there:";
    for (const std::string& name : run.names) text += " " + name;
    return text;
  }
  if (run.code == 0) {
    for (size_t i = 0; i < expected.earlier.size(); ++i)
      if (run.outputs[i] != expected.good.outputs[i] && (!expected.may_differ || run.outputs[i] == expected.earlier[i]))
        return "returns 0, but wrote something else";
    return "";
  }
  if (failed.empty() || run.code != expected.code) return "returns " + std::to_string(run.code);
  for (size_t i = 0; i < expected.earlier.size(); ++i)
    if (run.outputs[i] != expected.earlier[i] && run.outputs[i] != expected.good.outputs[i])
      return "returns an error, but spoils an output";
  if (std::count(run.errors.begin(), run.errors.end(), '\n') != 1 || !run.errors.starts_with("scree"))
    return "says not one line";
  return "";
}

}  // namespace scree::faults
