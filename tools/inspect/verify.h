// Checks every byte of a .scree file, including the pages that opening it does not read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"

namespace scree::inspect {

/// A detected error.
struct Failure {
  uint64_t offset = 0;  // bytes from the start of the file: of the page, table or padding
  Error error;          // the message names the page or chunk and the offset
};

/// The numbers of checked items, and the errors found.
struct VerifyReport {
  uint64_t tables = 0;
  uint64_t pages = 0;
  uint64_t page_bytes = 0;  // stored
  uint64_t raw_bytes = 0;   // after decompression
  uint64_t padding_bytes = 0;
  uint64_t chunks = 0;
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t meshes = 0;  // meshes whose box was compared with the decoded positions
  uint64_t images = 0;
  uint64_t pixels = 0;
  std::vector<Failure> failures;  // by offset in the file; at most kMaxFailures
  uint64_t failure_count = 0;
  std::vector<std::string> warnings;  // images whose damage the decoder tolerates
  bool is_shard = false;              // of a conversion: its chunks are listed in a page of its own
};

inline constexpr size_t kMaxFailures = 100;

/// Functions that verify() calls while it works. Either may be empty.
struct VerifyHooks {
  std::function<void(uint64_t triangles, uint64_t bytes)> progress;   // done so far; called on the caller's thread
  std::function<void(uint64_t offset, uint64_t bytes)> is_done_with;  // a part that was read; called on any thread
};

/// Checks, beyond Container::open: the checksum of every table and page; that every page decompresses to its size; that
/// every chunk decodes, with indices below its vertex count, positions inside its lattice and unused bits zero; that
/// all bytes between and after chunks, tables and pages are zero; that no two parts overlap; that the box and the
/// vertex count of every mesh equal those of its decoded chunks; that every image decodes to the size in its record.
/// A shard of a conversion has no list of chunks, so only its checksums and tables are checked.
/// `bytes`: the whole file that `file` was opened on. `threads`: 0 means one per core; the report is the same for any
/// number. Memory: a page, its decoded chunks and a decoded image per thread, 8 bytes per chunk, 25 per mesh.
VerifyReport verify(const format::Container& file, std::span<const std::byte> bytes, uint32_t threads,
                    const VerifyHooks& hooks = {});

}  // namespace scree::inspect
