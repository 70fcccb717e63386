// What happens when a mapped file is cut short, or its disk fails, while a tool reads it.
#pragma once

#include <string>
#include <string_view>

#include "format/result.h"
#include "runtime/files/mapped_file.h"

namespace scree::tools {

/// From now on SIGBUS, which the kernel raises for a read of a mapped page that the file no longer has, ends the
/// process with the line "scree COMMAND: FILE: ..." on stderr, once for all threads, and exit code 2. Nothing that was
/// being written keeps its final name, since files get theirs when they are whole. Called by a subcommand before it
/// maps `file`; libraries leave signals alone. A later call replaces the line.
void report_sigbus(std::string_view command, std::string_view file);

/// Whether all of a mapped file that was read until now was there: one that is cut within its last page raises no
/// signal. Called once a file was read for an output, before that is written. Error kFile: the line of report_sigbus,
/// as main() completes it.
Result<void> check_not_cut(const runtime::MappedFile& map);

}  // namespace scree::tools
