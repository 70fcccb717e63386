#include "tools/common/output/output_file.h"

#include <filesystem>

#include <sys/stat.h>

#include "format/text.h"

namespace scree::tools {

Result<void> check_output_file(const std::string& path, format::Existing existing) {
  if (path == "-")
    return Error{ErrorCode::kUsage, "the output '-': scree writes files, not standard output (./- is a file called -)"};
  if (path.empty()) return {};
  struct stat status;
  if (::stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode))
    return Error{ErrorCode::kFile, path + (S_ISDIR(status.st_mode) ? ": is a folder" : ": is not a regular file")};
  if (existing == format::Existing::kReplace || ::lstat(path.c_str(), &status) != 0) return {};
  return Error{ErrorCode::kFile, path + ": exists already; --force replaces it"};
}

Result<void> check_no_gltf(const std::string& path, const char* command) {
  const std::string extension = format::lower_case(std::filesystem::path(path).extension().string());
  if (extension != ".gltf" && extension != ".glb") return {};
  return Error{ErrorCode::kUsage, "--output: '" + path + "' has the extension of a glTF, but " + command +
                                      " writes a scree file (scree export writes a glTF)"};
}

}  // namespace scree::tools
