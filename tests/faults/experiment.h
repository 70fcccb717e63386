// One run of the program under test, in which a call fails or none, and whether what it leaves is as it should be.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/faults/faults.h"

namespace scree::faults {

struct Run {
  int code = -1;  // -1: ended by `signal`
  int signal = 0;
  int64_t live = 0;                  // live_count(), where the command came to its end
  std::string errors;                // stderr
  std::vector<std::string> outputs;  // of those that belong together, one after the other
  std::set<std::string> names;       // of the files that are there
};

/// A command that is run in `folder`, where `outputs` are what it writes; those in one group belong together.
class Experiment {
 public:
  Experiment(std::string folder, std::vector<std::vector<std::string>> outputs, std::vector<std::string> words);

  /// In a process of its own.
  Run run(const Plan& plan) const;
  /// The same once more without a failure, in what the run before left.
  Run run_again() const;

  /// From now on each run finds `bytes` as the .part of its first output, as a run that was killed leaves one.
  void find_part(std::string bytes) { part_ = std::move(bytes); }
  /// What the last run left there; empty where it left none.
  std::string left_part() const;

  /// Runs in this process from now on: what it prints goes where the command's output does.
  void stay_here() const;
  /// After stay_here(). Where the process ends instead of returning, its parent has the rest from end_of().
  Run run_here(const Plan& plan) const;
  Run end_of(int status) const;

  std::vector<std::string> earlier_outputs() const;
  /// Names of outputs that are not there before a run.
  std::set<std::string> new_outputs() const;

 private:
  std::string path(const std::string& name) const { return folder_ + "/" + name; }
  std::string log() const { return path("stderr.txt"); }
  std::string part_path() const { return path(outputs_.front().front() + ".part"); }
  Run run_in_place(const Plan& plan) const;
  void lay_out() const;
  /// A command of the program without --force begins without outputs, which it would refuse.
  bool has_earlier() const;
  void collect(Run& run) const;
  int call(const Plan& plan) const;

  std::string folder_;
  std::vector<std::vector<std::string>> outputs_;
  std::vector<std::string> words_;
  std::string part_;
};

/// What a run is held to.
struct Expected {
  Run good;                          // no call failed
  std::vector<std::string> earlier;  // outputs before a run; empty ones: there were none
  std::set<std::string> outputs;     // their names, where there were none: those of a run that fails may be there
  int code = 2;                      // of an error
  bool may_differ = false;           // outputs of a run that came to its end
  bool keeps_part = false;           // an error may leave a .part
};

/// What is wrong with a run in which `failed`, as failed_call() has it, failed; empty where nothing is.
std::string fault_of(Run run, const Expected& expected, const std::string& failed);

}  // namespace scree::faults
