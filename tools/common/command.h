// What main.cpp asks of each subcommand.
#pragma once

#include <functional>

#include <CLI/CLI.hpp>

#include "format/result.h"

namespace scree::tools {

/// A subcommand: its options on `app`, and what to run once they are parsed. run() returns an Error for main to print
/// as "scree NAME: message" and to turn into an exit code; nothing in it calls exit() or throws past it.
struct Command {
  CLI::App* app = nullptr;
  std::function<Result<void>()> run;
};

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
