// A .scree file as read by inspect --verify and export.
#include "format/container/container.h"

#include "tests/fuzz/input.h"
#include "tools/export/export.h"
#include "tools/inspect/report.h"
#include "tools/inspect/stats.h"
#include "tools/inspect/verify.h"

namespace scree::fuzz {

void container(Bytes bytes) {
  const ExactCopy copy(bytes);
  const auto file = format::Container::open(copy.bytes());
  if (!file) return;
  uint64_t triangles = 0;  // limited, since chunks of equal values have many triangles and no bytes
  for (uint64_t i = 0; i < file->chunks().size(); ++i) triangles += file->chunks()[i].triangle_count;
  if (triangles > 200000) return;

  const inspect::VerifyReport report = inspect::verify(*file, copy.bytes(), 1);
  must(report.failures.size() == std::min<uint64_t>(report.failure_count, inspect::kMaxFailures), "failures are told");
  (void)inspect::text_report(*file, inspect::gather(*file, copy.bytes(), 10, true), "fuzz.scree");
  (void)inspect::text_verify(report);

  const std::string path = Folder::file("out.glb");
  tools::ExportOptions options{.threads = 1};
  const auto exported = tools::export_gltf(*file, path, options);
  std::error_code ignored;
  const bool is_there = std::filesystem::remove(path, ignored);
  must(is_there == bool(exported), "an export leaves a file where it worked and none where it did not");
}

}  // namespace scree::fuzz
