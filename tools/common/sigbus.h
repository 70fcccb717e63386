// What happens when a mapped file is cut short, or its disk fails, while a tool reads it.
#pragma once

#include <string_view>

namespace scree::tools {

/// From now on SIGBUS, which the kernel raises for a read of a mapped page that the file no longer has, ends the
/// process with the line "scree COMMAND: FILE: ..." on stderr, once for all threads, and exit code 2. Nothing that was
/// being written keeps its final name, since files get theirs when they are whole. Called by a subcommand before it
/// maps `file`; libraries leave signals alone. A later call replaces the line.
void report_sigbus(std::string_view command, std::string_view file);

}  // namespace scree::tools
