// scree: dispatches subcommands, prints errors, sets exit codes.
#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "format/container/part_file.h"
#include "tools/common/options/command.h"
#include "tools/common/options/suggest.h"
#include "tools/common/options/version.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/ranks.h"
#include "tools/common/process/stop_signal.h"

namespace {

/// Prints an error of parsing. For an unknown word the message names the nearest known option or subcommand.
int report_parse_error(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) {  // --help, --version
    app.exit(error);
    const scree::Result<void> printed = scree::tools::finish_output();
    if (!printed) std::fprintf(stderr, "scree: %s\n", printed.error().message.c_str());
    return printed ? 0 : scree::exit_code(printed.error().code);
  }
  const CLI::App* place = &app;
  for (const CLI::App* chosen : app.get_subcommands()) place = chosen;
  const std::string message = scree::tools::describe_parse_error(*place, error);
  const std::string name = place == &app ? "scree" : "scree " + place->get_name();
  std::fprintf(stderr, "%s: %s (see %s --help)\n", name.c_str(), message.c_str(), name.c_str());
  return scree::exit_code(scree::ErrorCode::kUsage);
}

/// Turns `scree` and `scree help` into `scree --help`, and `scree help convert` into `scree convert --help`.
void ask_for_help(const CLI::App& app, std::vector<std::string>& words) {
  if (words.empty()) words = {"--help"};
  if (words.front() != "help") return;
  words.erase(words.begin());
  const auto is_word = [&](const CLI::App* command) { return !words.empty() && command->get_name() == words.front(); };
  const std::vector<const CLI::App*> commands = app.get_subcommands([](const CLI::App*) { return true; });
  if (words.empty() || std::any_of(commands.begin(), commands.end(), is_word)) words.emplace_back("--help");
}

/// `--normals` was a flag of convert before it got values.
void give_normals_a_value(std::vector<std::string>& words) {
  if (words.empty() || words.front() != "convert") return;
  for (size_t i = 1; i < words.size(); ++i) {
    if (words[i] != "--normals") continue;
    const std::string& value = i + 1 < words.size() ? words[i + 1] : "";
    if (value != "auto" && value != "always" && value != "never") words[i] = "--normals=always";
  }
}

/// Turns `--camera=` into `--camera ""`. CLI11 would take the next word, such as `-o`, for the value.
void split_empty_values(std::vector<std::string>& words) {
  for (size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
    if (!words[i].starts_with("--") || words[i].find('=') != words[i].size() - 1) continue;
    words[i].pop_back();
    words.insert(words.begin() + static_cast<std::ptrdiff_t>(i) + 1, "");
  }
}

/// Refuses `--shard ""`, which is usually a variable of a script that is not set. Commands take empty texts for options
/// that are not given.
void check_values(const CLI::App& command) {
  for (const CLI::Option* option : command.get_options())
    if (std::ranges::count(option->results(), "") != 0)
      throw CLI::ParseError(option->get_name() + ": the value is empty", scree::exit_code(scree::ErrorCode::kUsage));
}

int run(int argc, char** argv) {
  CLI::App app("Packs huge glTF scenes, checks them and draws them exactly.", "scree");
  app.set_version_flag("--version", scree::tools::version_text());
  app.require_subcommand(1);
  const std::vector<scree::tools::Command> commands = {scree::tools::add_convert(app), scree::tools::add_merge(app),
                                                       scree::tools::add_inspect(app), scree::tools::add_render(app),
                                                       scree::tools::add_compare(app), scree::tools::add_export(app),
                                                       scree::tools::add_synth(app),   scree::tools::add_bench(app),
                                                       scree::tools::add_devices(app), scree::tools::add_view(app)};
  std::vector<std::string> words(argv + 1, argv + argc);
  ask_for_help(app, words);
  give_normals_a_value(words);
  split_empty_values(words);
  try {
    std::reverse(words.begin(), words.end());  // CLI11 parses words from the last to the first
    app.parse(std::move(words));
    for (const CLI::App* command : app.get_subcommands()) check_values(*command);
  } catch (const CLI::ParseError& error) {
    return report_parse_error(app, error);
  }
  for (const scree::tools::Command& command : commands) {
    if (!command.app->parsed()) continue;
    const std::string name = command.app->get_name();
    if (name != "inspect") scree::tools::end_on_signal(name);  // inspect writes no file
    const scree::Result<void> result = command.run();
    if (result) return 0;
    scree::tools::end_where_signalled();
    std::fprintf(stderr, "scree %s: %s\n", name.c_str(), result.error().message.c_str());
    scree::tools::end_all_ranks(scree::exit_code(result.error().code));
    return scree::exit_code(result.error().code);
  }
  return 0;
}

/// Runs if memory is exhausted in a destructor or at a thread's start, where no code can catch the exception. Any other
/// cause is a bug, and leaves a core. Unfinished files are removed in both cases.
[[noreturn]] void on_terminate() {
  scree::format::remove_open_parts();
  try {
    if (const std::exception_ptr current = std::current_exception()) std::rethrow_exception(current);
  } catch (const std::bad_alloc&) {
    std::fputs("scree: out of memory\n", stderr);
    std::_Exit(scree::exit_code(scree::ErrorCode::kMemory));
  } catch (...) {
  }
  std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  std::set_terminate(on_terminate);
  std::signal(SIGXFSZ, SIG_IGN);  // a file past the size limit is an error of write(), not the end of the program
  try {
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "scree: out of memory\n");
    return scree::exit_code(scree::ErrorCode::kMemory);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scree: unexpected: %s\n", error.what());
    return scree::exit_code(scree::ErrorCode::kFile);
  }
}
