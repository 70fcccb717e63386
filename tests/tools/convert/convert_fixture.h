// Converts and compares with the source, for the tests of convert().
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>

#include "tests/results.h"
#include "tests/tools/compare/source_compare.h"
#include "tools/convert/convert.h"
#include "tools/inspect/verify.h"

namespace scree::tests {

inline constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
inline constexpr float kInf = std::numeric_limits<float>::infinity();

/// `input`: in the folder, or a whole path.
inline convert::ConvertOptions options_of(const TempFolder& folder, const std::string& input = "in.glb") {
  convert::ConvertOptions options;
  options.input = folder.file(input);
  options.output = folder.file("out.scree");
  options.source_ids = true;
  options.normals = convert::Normals::kNever;  // except in tests of normals
  options.threads = 2;
  return options;
}

inline convert::ConvertReport must_convert(const convert::ConvertOptions& options) {
  return must(convert::convert(options));
}

/// Converts, and returns the bytes of the file.
inline std::string converted_bytes(const convert::ConvertOptions& options) {
  must_convert(options);
  return read_whole(options.output);
}

/// Converts with options.memory = `memory`. If that is refused, converts with the minimum that the error message
/// states. The test program's own memory counts too, including up to 256 MiB of freed memory that sanitizers keep. It
/// may grow between the attempts.
inline convert::ConvertReport must_convert_within(convert::ConvertOptions& options, uint64_t memory) {
  for (int attempt = 0;; ++attempt) {
    options.memory = memory;
    const Result<convert::ConvertReport> made = convert::convert(options);
    if (made) return *made;
    INFO(made.error().message);
    REQUIRE(attempt < 10);
    CHECK(made.error().code == ErrorCode::kUsage);
    const std::string words = " needs at least ";
    const size_t at = made.error().message.find(words);
    REQUIRE(at != std::string::npos);
    const uint64_t least = std::stoull(made.error().message.substr(at + words.size())) << 20;
    REQUIRE(least > memory);
    memory = least;
  }
}

/// Converts and compares with the source.
inline convert::ConvertReport must_match(const convert::ConvertOptions& options) {
  const convert::ConvertReport report = must_convert(options);
  const Comparison comparison = compare_with_source(options.input, options.output, options.exclude);
  REQUIRE(comparison.difference == "");
  REQUIRE(comparison.triangles == report.triangles);
  REQUIRE(comparison.position_error == report.position_error);
  REQUIRE(report.position_error <= report.position_error_bound);
  return report;
}

inline PackedFile must_open(const std::string& path) {
  return must(open_packed(path));
}

/// Checks that the content of every page and image is valid.
inline void must_verify(const PackedFile& packed) {
  const inspect::VerifyReport report = inspect::verify(packed.file, packed.map.bytes(), 2);
  for (const inspect::Failure& failure : report.failures) FAIL_CHECK(failure.error.message);
  CHECK(report.failure_count == 0);
  CHECK(report.images == packed.file.images().size());
}
inline void must_verify(const std::string& path) {
  must_verify(must_open(path));
}

/// The sum of all chunks' bytes.
inline uint64_t chunk_bytes(const format::Container& file) {
  uint64_t sum = 0;
  for (uint64_t i = 0; i < file.chunks().size(); ++i) sum += file.chunks()[i].bytes;
  return sum;
}

/// The counts of left-out data, by name.
inline std::map<std::string, uint64_t> left_out(const format::Container& file) {
  std::map<std::string, uint64_t> out;
  for (uint64_t i = 0; i < file.left_out().size(); ++i)
    out[std::string(file.string(file.left_out()[i].what))] += file.left_out()[i].count;
  return out;
}

/// Requires an error of `code` whose message contains `words`, and no output file.
inline void must_fail(const convert::ConvertOptions& options, ErrorCode code, const std::string& words) {
  check_refusal(convert::convert(options), code, words);
  CHECK_FALSE(std::filesystem::exists(options.output));
  CHECK_FALSE(std::filesystem::exists(options.output + ".part"));
}

}  // namespace scree::tests
