// One run of the program under test, with or without a failing call, and the check of its results.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/faults/faults.h"

namespace scree::faults {

struct Run {
  int code = -1;  // -1: a signal, `signal`, ended the run
  int signal = 0;
  int64_t live = 0;                  // live_count(), if the command reached its end
  std::string errors;                // stderr
  std::vector<std::string> outputs;  // contents; outputs that belong together are concatenated
  std::set<std::string> names;       // names of existing files
};

/// A command that is run in `folder` and writes `outputs`. Outputs in one group belong together.
class Experiment {
 public:
  Experiment(std::string folder, std::vector<std::vector<std::string>> outputs, std::vector<std::string> words);

  /// Runs in a separate process, or in this one after stay_here().
  Run run(const Plan& plan) const;
  /// Runs the command once more without a failure, on the files that the last run left. Likewise.
  Run run_again() const;

  /// From now on each run begins with `bytes` as the .part of its first output, as if a killed run had left it.
  void find_part(std::string bytes) { part_ = std::move(bytes); }
  /// The .part that the last run left; empty if there is none.
  std::string left_part() const;

  /// From now on, runs happen in this process, with its output in the command's output files. If the process ends
  /// instead of returning from a run, the parent gets the rest of it from end_of().
  void stay_here();
  Run end_of(int status) const;

  std::vector<std::string> earlier_outputs() const;
  /// Names of outputs that do not exist before a run.
  std::set<std::string> new_outputs() const;

 private:
  std::string path(const std::string& name) const { return folder_ + "/" + name; }
  std::string log() const { return path("stderr.txt"); }
  std::string part_path() const { return path(outputs_.front().front() + ".part"); }
  Run run_in_place(const Plan& plan) const;
  Run run_here(const Plan& plan) const;
  void redirect() const;
  void lay_out() const;
  /// Whether outputs exist before a run. False for commands without --force, which would refuse them.
  bool has_earlier() const;
  void collect(Run& run) const;
  int call(const Plan& plan) const;

  std::string folder_;
  std::vector<std::vector<std::string>> outputs_;
  std::vector<std::string> words_;
  std::string part_;
  bool stays_here_ = false;
};

/// The results that a run must have.
struct Expected {
  Run good;                          // a run without a failed call
  std::vector<std::string> earlier;  // contents of outputs before a run; empty if there were none
  std::set<std::string> outputs;     // names of new outputs, which a failed run may leave
  int code = 2;                      // exit code of an error
  bool may_differ = false;           // outputs may differ between successful runs
  bool keeps_part = false;           // an error may leave a .part
};

/// The error of a run in which `failed` (from failed_call()) failed; empty if there is none.
std::string fault_of(Run run, const Expected& expected, const std::string& failed);

}  // namespace scree::faults
