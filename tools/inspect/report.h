// What inspect prints: tables for people, or JSON.
#pragma once

#include <cstdio>
#include <string>

#include "format/container/container.h"
#include "tools/compare/geometry.h"
#include "tools/inspect/stats.h"
#include "tools/inspect/verify.h"

namespace scree::inspect {

/// Bytes of the source glTF that a kind of content stands against; 0 where the file does not know. Images are carried
/// over as they came, so what they take in the source is what they take here before compression.
struct SourceBytes {
  uint64_t indices = 0;
  uint64_t positions = 0;
  uint64_t attributes = 0;
  uint64_t total = 0;  // of its files
};
SourceBytes source_bytes(const format::Container& file);

/// The tables, with footnotes. `path`: of the file, for the first line.
std::string text_report(const format::Container& file, const Stats& stats, const std::string& path);

/// What --verify checked and found.
std::string text_verify(const VerifyReport& report);

/// One row a chunk, to `out` as they come.
void print_chunks(const format::Container& file, std::FILE* out);

/// One JSON object, to `out`: names are stable, amounts are bytes, ratios plain numbers, and what has no value is
/// absent. `verify`, `against_source` (a member "geometry"): null where they were not asked for. `with_chunks`: a
/// member "chunk_rows" with an object a chunk.
void print_json(const format::Container& file, const Stats& stats, const std::string& path, const VerifyReport* verify,
                const compare::GeometryReport* against_source, bool with_chunks, std::FILE* out);

}  // namespace scree::inspect
