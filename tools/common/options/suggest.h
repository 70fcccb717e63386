// Error text for mistyped options and subcommands.
#pragma once

#include <string>

#include <CLI/CLI.hpp>

namespace scree::tools {

/// One line: the error, and "did you mean --size?" if a known name is at most two edits (a third of its length for
/// long names) away from the unknown word.
std::string describe_parse_error(const CLI::App& app, const CLI::ParseError& error);

}  // namespace scree::tools
