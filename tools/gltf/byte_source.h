// The bytes of a scene: files, parts of files, and decoded data: URIs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Opens a regular file for pread(). The first few hundred files keep their descriptor; later ones are opened for each
/// read, so that a scene of thousands of .bin files works within the usual limit of 1024. Such a read fails with kFile
/// if the path names another file by then, or if the file's size or time of change differs. Errors kFile.
Result<std::shared_ptr<const ByteSource>> open_file_source(const std::string& path);

/// Error kTruncated if a read of `out` at `offset` passes the end of a source of `size` bytes; `what` names it.
Result<void> check_read(uint64_t offset, std::span<const std::byte> out, uint64_t size, const char* what);

/// Totals of all reads of files and of part_source() since the program began, in all threads.
ReadTotals read_totals();

/// [offset, offset + size) of another source. The caller has checked the range.
std::shared_ptr<const ByteSource> window_source(std::shared_ptr<const ByteSource> whole, uint64_t offset,
                                                uint64_t size);

/// The bytes written to the first `size` bytes of `file`.
std::shared_ptr<const ByteSource> part_source(std::shared_ptr<const format::PartFile> file, uint64_t size);

/// Bytes held in memory.
std::shared_ptr<const ByteSource> memory_source(std::vector<std::byte> bytes);

}  // namespace scree::convert
