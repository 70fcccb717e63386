#include "tools/common/output/output_file.h"

#include <sys/stat.h>

namespace scree::tools {

Result<void> check_output_file(const std::string& path, format::Existing existing) {
  if (path == "-")
    return Error{ErrorCode::kUsage, "the output '-': scree writes files, not standard output (./- is a file called -)"};
  if (path.empty() || existing == format::Existing::kReplace) return {};
  struct stat status;
  if (::lstat(path.c_str(), &status) != 0) return {};
  if (S_ISDIR(status.st_mode)) return Error{ErrorCode::kFile, path + ": is a folder"};
  return Error{ErrorCode::kFile, path + ": exists already; --force replaces it"};
}

}  // namespace scree::tools
