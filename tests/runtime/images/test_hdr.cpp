// Radiance pictures: run-length coded rows, rows of plain pixels, and invalid files of every kind.
#include "runtime/images/hdr.h"

#include <string>
#include <vector>

#include "tests/format/geometry/guarded_bytes.h"
#include "tests/results.h"

using namespace scree;
using namespace scree::runtime;

namespace {

std::string header(const std::string& size) {
  return "#?RADIANCE\nEXPOSURE=1\nFORMAT=32-bit_rle_rgbe\n\n" + size + "\n";
}

std::span<const std::byte> bytes_of(const std::string& text) {
  return std::as_bytes(std::span(text));
}

Result<std::vector<float>> read_all(std::span<const std::byte> file) {
  std::vector<float> out;
  const Result<void> read =
      read_hdr(file, [&](uint32_t, std::span<const float> row) { out.insert(out.end(), row.begin(), row.end()); });
  if (!read) return read.error();
  return out;
}

ErrorCode code_of(const std::string& file) {
  return refusal(read_all(bytes_of(file))).code;
}

/// A row of 8 pixels. The first channel has 3 plain bytes and a run of 5; each other channel is one run.
const std::string kRow = std::string("\2\2\0\x8", 4) + std::string("\3\1\2\3\x85\7", 6) + "\x88\x10" + "\x88\x20" +
                         std::string("\x88\x81", 2);

}  // namespace

TEST_CASE("hdr: run-length coded rows and rows of plain pixels are read", "[hdr]") {
  const auto runs = must(read_all(bytes_of(header("-Y 2 +X 8") + kRow + kRow)));
  REQUIRE(runs.size() == 48);
  // (mantissa + 0.5) / 256 * 2^(exponent - 128).
  CHECK(runs[0] == 1.5f / 128);
  CHECK(runs[3 * 7] == 7.5f / 128);
  CHECK(runs[3 * 7 + 1] == 16.5f / 128);
  CHECK(runs[24 + 2] == 32.5f / 128);
  // 2 pixels, then repetitions of the second.
  std::string old = header("-Y 1 +X 4");
  old += std::string("\4\5\6\x80\x08\x09\x0a\x80\1\1\1\2", 12);
  const auto pixels = must(read_all(bytes_of(old)));
  CHECK(pixels[0] == 4.5f / 256);
  for (size_t x = 1; x < 4; ++x) CHECK(pixels[3 * x] == 8.5f / 256);
  // Exponent 0 is black for any mantissa.
  CHECK(read_all(bytes_of(header("-Y 1 +X 1") + std::string("\7\7\7\0", 4))).value() == std::vector<float>{0, 0, 0});
}

TEST_CASE("hdr: other files and every prefix are refused", "[hdr]") {
  CHECK(code_of("") == ErrorCode::kFormat);
  CHECK(code_of("P6 1 1 255") == ErrorCode::kFormat);
  CHECK(code_of("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n") == ErrorCode::kUnsupported);
  CHECK(code_of(header("+Y 1 +X 1")) == ErrorCode::kUnsupported);
  CHECK(code_of(header("-Y 1 -X 1")) == ErrorCode::kUnsupported);
  CHECK(code_of(header("-Y 1 +X 1x")) == ErrorCode::kUnsupported);
  CHECK(code_of(header("-Y 0 +X 1")) == ErrorCode::kRange);
  CHECK(code_of(header("-Y 65536 +X 65536")) == ErrorCode::kRange);
  CHECK(code_of(header("-Y 1 +X 65537")) == ErrorCode::kRange);
  CHECK(code_of(header("-Y 99999999999 +X 1")) == ErrorCode::kUnsupported);
  CHECK(code_of(header("-Y 1 +X 4") + std::string("\1\1\1\2", 4)) == ErrorCode::kFormat);  // nothing to repeat
  CHECK(code_of(header("-Y 1 +X 8") + std::string("\2\2\0\x8\x89\7", 6)) == ErrorCode::kFormat);
  CHECK(code_of(header("-Y 1 +X 8") + std::string("\2\2\0\x8\0\7", 6)) == ErrorCode::kFormat);
  const std::string head = header("-Y 1 +X 8"), whole = head + kRow;
  for (size_t length = 0; length < whole.size(); ++length) {
    tests::GuardedBytes cut(bytes_of(whole).first(length));
    const Error error = refusal(read_all(cut.bytes()));
    if (length >= head.size()) CHECK(error.code == ErrorCode::kTruncated);
  }
  CHECK(read_all(bytes_of(whole + "more")));
}
