// For the tests of the container's rules: each test breaks one rule, with matching checksums.
#pragma once

#include <cstddef>
#include <limits>

#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/catch.h"
#include "tests/format/container/container_fixture.h"
#include "tests/results.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::tests {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Opens a file with one change, and expects exactly that message.
class Breaker {
 public:
  explicit Breaker(const Parts& parts) : file_(file_of(parts)) {
    const auto error = verify_copy(file_);
    if (error) FAIL(error->message);
  }

  template <class Record, class Change>
  void record(format::TableKind kind, uint64_t index, Change change, const char* message,
              ErrorCode code = ErrorCode::kRange) const {
    expect(patched<Record>(file_, kind, index, change), message, code);
  }

  /// Changes the file's header and updates its checksum, unless `seal` is false.
  template <class Change>
  void header(Change change, const char* message, ErrorCode code, bool seal = true) const {
    Bytes file = file_;
    auto header = format::load<format::FileHeader>(file.data());
    change(header);
    if (seal) header.checksum = XXH3_64bits(&header, offsetof(format::FileHeader, checksum));
    format::store(file.data(), header);
    expect(file, message, code);
  }

  template <class Change>
  void toc(format::TableKind kind, Change change, const char* message, ErrorCode code = ErrorCode::kRange) const {
    Bytes file = file_;
    const size_t offset = toc_entry_offset(file, kind);
    auto entry = format::load<format::TocEntry>(file.data() + offset);
    change(entry);
    format::store(file.data() + offset, entry);
    reseal(file);
    expect(file, message, code);
  }

  static void expect(const Bytes& file, const char* message, ErrorCode code) {
    INFO("expected: " << message);
    const auto error = must(verify_copy(file));
    CHECK(error.message == message);
    CHECK(error.code == code);
    CHECK(error.message.find('\n') == std::string::npos);
  }

  const Bytes& file() const { return file_; }

 private:
  Bytes file_;
};

}  // namespace scree::tests
