// The interface between main.cpp and the subcommands.
#pragma once

#include <concepts>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "format/result.h"
#include "tools/common/options/options.h"

namespace scree::tools {

/// A subcommand: its options are registered on `app`, and run() is called after parsing. main prints the Error that
/// run() returns as "scree NAME: message", and turns it into an exit code. run() must not call exit() or throw.
struct Command {
  CLI::App* app = nullptr;
  std::function<Result<void>()> run;
};

/// Adds an option with a value, which the help shows as `value`.
template <class Word>
CLI::Option* add_value(CLI::App& app, const char* names, const char* value, Word& word, const std::string& help) {
  return app.add_option(names, word, help)->type_name(value);
}

/// Adds an option that may be repeated, with one value each: the next word may be a file.
inline CLI::Option* add_repeated(CLI::App& app, const char* names, const char* value, std::vector<std::string>& words,
                                 const std::string& help) {
  CLI::Option* const option = add_value(app, names, value, words, help)->type_size(1)->expected(1);
  return option->allow_extra_args(false)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

/// Adds an option with a whole number from `lowest` to `highest`. `word` holds the default, which the help shows.
template <std::unsigned_integral Number>
CLI::Option* add_whole(CLI::App& app, const std::string& name, Number& word, uint64_t lowest, uint64_t highest,
                       const std::string& help) {
  const auto parse = [&word, name, lowest, highest](const CLI::results_t& words) {
    const Result<uint64_t> value = parse_whole(words.front(), lowest, highest, name);
    if (!value) throw CLI::ParseError(value.error().message, exit_code(value.error().code));
    word = static_cast<Number>(*value);
    return true;
  };
  return app.add_option(name, parse, help)->type_name("N")->default_str(std::to_string(word));
}

Command add_convert(CLI::App& parent);
Command add_merge(CLI::App& parent);
Command add_inspect(CLI::App& parent);
Command add_render(CLI::App& parent);
Command add_compare(CLI::App& parent);
Command add_synth(CLI::App& parent);
Command add_export(CLI::App& parent);
Command add_bench(CLI::App& parent);
Command add_devices(CLI::App& parent);
Command add_view(CLI::App& parent);

}  // namespace scree::tools
