// Handles a mapped file that changes, or whose disk fails, while a tool reads it.
#pragma once

#include <string_view>

#include "format/result.h"
#include "runtime/files/mapped_file.h"

namespace scree::tools {

/// From now on SIGBUS ends the process with exit code 2. The line "scree COMMAND: FILE: ..." is printed once on stderr,
/// even if several threads fail. The kernel raises SIGBUS when a mapped page is read that the file no longer has.
/// SIGSEGV ends the process in the same way if the file was overwritten meanwhile, because records that were checked
/// may lead anywhere then. Unfinished output never has its final name, because files get it only when they are
/// complete. Called by a subcommand before it maps `file`; libraries leave signals alone. A later call replaces the
/// line.
void report_sigbus(std::string_view command, std::string_view file);

/// Checks that all bytes read so far from a mapped file are those of the file that was opened: truncation within the
/// last page and overwriting raise no signal. Called after a file was read for an output, before the output is written.
/// Error kFile: main() completes it to the line of report_sigbus().
Result<void> check_unchanged(const runtime::MappedFile& map);

}  // namespace scree::tools
