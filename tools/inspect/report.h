// The output of inspect: tables for people, or JSON.
#pragma once

#include <cstdio>
#include <string>

#include "format/container/container.h"
#include "tools/compare/geometry.h"
#include "tools/inspect/stats.h"
#include "tools/inspect/verify.h"

namespace scree::inspect {

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
