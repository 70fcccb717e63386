// For the tests of the container's rules: each test breaks one rule in a file whose checksums fit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>

#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/format/container/container_fixture.h"
#include "tests/results.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::tests {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Opens a file with one change, and expects exactly the given message.
class Breaker {
 public:
  explicit Breaker(const Parts& parts) : file_(file_of(parts)) {
    const auto error = verify_copy(file_);
    if (error) FAIL(error->message);
  }

  /// Breaks rules of one table: changes record `index`, and expects the given message.
  template <class Record>
  class Records {
   public:
    using Change = std::function<void(Record&)>;

    Records(const Bytes& file, format::TableKind kind) : file_(file), kind_(kind) {}
    void operator()(uint64_t index, ErrorCode code, const std::string& message, const Change& change) const {
      expect(patched<Record>(file_, kind_, index, change), message, code);
    }
    void operator()(uint64_t index, const std::string& message, const Change& change) const {
      (*this)(index, ErrorCode::kRange, message, change);
    }

   private:
    const Bytes& file_;
    format::TableKind kind_;
  };
  template <class Record>
  Records<Record> records(format::TableKind kind) const {
    return {file_, kind};
  }

  /// Changes the file's header and updates its checksum, unless `seal` is false.
  void header(ErrorCode code, const std::string& message, const std::function<void(format::FileHeader&)>& change,
              bool seal = true) const {
    Bytes file = file_;
    auto header = format::load<format::FileHeader>(file.data());
    change(header);
    if (seal) header.checksum = XXH3_64bits(&header, offsetof(format::FileHeader, checksum));
    format::store(file.data(), header);
    expect(file, message, code);
  }

  using TocChange = std::function<void(format::TocEntry&)>;
  void toc(format::TableKind kind, ErrorCode code, const std::string& message, const TocChange& change) const {
    Bytes file = file_;
    const size_t offset = toc_entry_offset(file, kind);
    auto entry = format::load<format::TocEntry>(file.data() + offset);
    change(entry);
    format::store(file.data() + offset, entry);
    reseal(file);
    expect(file, message, code);
  }
  void toc(format::TableKind kind, const std::string& message, const TocChange& change) const {
    toc(kind, ErrorCode::kRange, message, change);
  }

  /// The bytes of the string table, and the message about a name that lies `at` a byte past its end.
  uint32_t string_bytes() const {
    const size_t entry = toc_entry_offset(file_, format::TableKind::kStrings);
    return static_cast<uint32_t>(format::load<format::TocEntry>(file_.data() + entry).record_count);
  }
  std::string bad_string(const std::string& place, uint32_t at) const {
    return place + ": string at " + std::to_string(at) + ", but the strings take " + std::to_string(string_bytes()) +
           " bytes";
  }

  static void expect(const Bytes& file, const std::string& message, ErrorCode code) {
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
