#include "tools/bench/csv.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "tools/common/process/stop_signal.h"

namespace scree::bench {
namespace {

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    out += c;
    if (c == '"') out += '"';
  }
  return out + '"';
}

Error file_error(const std::string& path) {
  return {ErrorCode::kFile, path + ": " + std::strerror(errno)};
}

/// Returns whether the file has no first line yet. Error kFormat: it is not `header`.
Result<bool> lacks_header(const std::string& path, const std::string& header) {
  std::ifstream in(path, std::ios::binary);
  std::string line;
  if (!in || !std::getline(in, line)) return true;
  if (line == header) return false;
  return Error{ErrorCode::kFormat, path + ": line 1 is not the header of this version; choose another file"};
}

}  // namespace

std::string csv_columns(const CsvCells& cells) {
  std::string line;
  for (const auto& cell : cells) line += (line.empty() ? "" : ",") + cell.first;
  return line;
}

std::string csv_values(const CsvCells& cells) {
  std::string line;
  bool first = true;
  for (const auto& cell : cells) {
    if (!first) line += ',';
    first = false;
    line += quoted(cell.second);
  }
  return line;
}

void add_times(CsvCells& cells, const std::string& name, const std::optional<Times>& times) {
  cells.emplace_back(name + "_ms", times ? csv_number(times->median) : "");
  cells.emplace_back(name + "_min_ms", times ? csv_number(times->minimum) : "");
  cells.emplace_back(name + "_spread_ms", times ? csv_number(times->spread) : "");
}

std::string csv_number(double value) {
  if (std::isinf(value)) return "inf";
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}
std::string csv_number(uint64_t value) {
  return std::to_string(value);
}

Result<void> append_csv(const std::string& path, const CsvCells& cells) {
  const std::string header = csv_columns(cells);
  // The lock is held from the check of the first line to the end of the write, so that two programs that begin a file
  // write one header and complete rows.
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (file < 0) return file_error(path);
  struct Close {
    int file;
    ~Close() { ::close(file); }
  } const closes{file};
  while (::flock(file, LOCK_EX) != 0 && errno == EINTR) {
  }
  const bool is_new = SCREE_TRY(lacks_header(path, header));
  const off_t before = ::lseek(file, 0, SEEK_END);
  if (before < 0) return file_error(path);
  const std::string text = (is_new ? header + '\n' : std::string()) + csv_values(cells) + '\n';
  for (size_t done = 0; done < text.size();) {
    const ssize_t written = ::write(file, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const Error error = file_error(path);
      [[maybe_unused]] const int cut = ::ftruncate(file, before);  // removes the incomplete row
      return error;
    }
    done += static_cast<size_t>(written);
  }
  tools::note_written(path);
  return {};
}

Result<void> check_csv(const std::string& path, const CsvCells& cells) {
  if (::access(path.c_str(), F_OK) == 0) {
    if (std::filesystem::is_directory(path)) return Error{ErrorCode::kFile, path + ": is a folder"};
    if (::access(path.c_str(), W_OK) != 0) return file_error(path);
    SCREE_TRY(lacks_header(path, csv_columns(cells)));
    return {};
  }
  const std::string folder = std::filesystem::path(path).parent_path().string();
  if (::access(folder.empty() ? "." : folder.c_str(), W_OK) != 0) return file_error(path);
  return {};
}

}  // namespace scree::bench
