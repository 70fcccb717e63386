// Handles a mapped file that is truncated, or whose disk fails, while a tool reads it.
#pragma once

#include <string>
#include <string_view>

#include "format/result.h"
#include "runtime/files/mapped_file.h"

namespace scree::tools {

/// From now on SIGBUS ends the process with exit code 2 and the line "scree COMMAND: FILE: ..." on stderr, once for all
/// threads. The kernel raises SIGBUS for a read of a mapped page that the file no longer has. Unfinished output never
/// has its final name, since files get it only when complete. Called by a subcommand before it maps `file`; libraries
/// leave signals alone. A later call replaces the line.
void report_sigbus(std::string_view command, std::string_view file);

/// Checks that all bytes read so far from a mapped file existed: truncation within the last page raises no signal.
/// Called after a file was read for an output, before the output is written. Error kFile: the line of report_sigbus, as
/// main() completes it.
Result<void> check_not_cut(const runtime::MappedFile& map);

}  // namespace scree::tools
