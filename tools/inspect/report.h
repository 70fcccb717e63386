// The output of inspect: tables for people, or JSON.
#pragma once

#include <cstdio>
#include <string>

#include "format/container/container.h"
#include "tools/compare/geometry.h"
#include "tools/inspect/stats.h"
#include "tools/inspect/verify.h"

namespace scree::inspect {

/// Bytes of each kind of content in the source glTF; 0 if the file does not record it. Images have no entry:
/// they are compared with their bytes before compression.
struct SourceBytes {
  uint64_t indices = 0;
  uint64_t positions = 0;
  uint64_t attributes = 0;
  uint64_t total = 0;  // of the source's files
};
SourceBytes source_bytes(const format::Container& file);

/// The tables, with footnotes. `path`: printed in the first line.
std::string text_report(const format::Container& file, const Stats& stats, const std::string& path);

/// The checks and findings of --verify.
std::string text_verify(const VerifyReport& report);

/// One row per chunk, written to `out` one by one.
void print_chunks(const format::Container& file, std::FILE* out);

/// One JSON object, written to `out`. Names are stable, amounts are bytes, ratios plain numbers, and members without a
/// value are absent. `verify`, `against_source` (a member "geometry"): null if not requested. `with_chunks`: adds a
/// member "chunk_rows" with one object per chunk.
void print_json(const format::Container& file, const Stats& stats, const std::string& path, const VerifyReport* verify,
                const compare::GeometryReport* against_source, bool with_chunks, std::FILE* out);

}  // namespace scree::inspect
