// Parsing of sizes, lengths and integers.
#include "tools/common/options/options.h"

#include "tests/results.h"
#include "tools/common/output/progress.h"

using namespace scree;
using namespace scree::tools;

TEST_CASE("sizes are parsed with their units, and bad ones are refused", "[options]") {
  const auto size = [](const char* text) {
    const Result<uint64_t> parsed = parse_size(text);
    return parsed ? *parsed : UINT64_MAX;
  };
  CHECK(size("0") == 0);
  CHECK(size("4096") == 4096);
  CHECK(size("2GiB") == uint64_t{2} << 30);
  CHECK(size("1.5 gib") == uint64_t{3} << 29);
  CHECK(size("64k") == 65536);
  CHECK(size("2GB") == 2000000000);
  CHECK(size("3TiB") == uint64_t{3} << 40);
  for (const char* bad :
       {"", "GiB", "-1", "1 2", "1XB", "nan", "inf", "1e30", "9223372036854775808", "0x10", "2GiBs"}) {
    INFO(bad);
    CHECK(refusal(parse_size(bad)).code == ErrorCode::kUsage);
  }
}

TEST_CASE("lengths are parsed with their units, and bad ones are refused", "[options]") {
  const auto length = [](const char* text) {
    const Result<double> parsed = parse_length(text);
    return parsed ? *parsed : -1;
  };
  CHECK(length("0.5mm") == Approx(0.0005).epsilon(1e-15));
  CHECK(length("1e-3") == 1e-3);
  CHECK(length("2 cm") == 0.02);
  CHECK(length("3um") == Approx(3e-6).epsilon(1e-15));
  CHECK(length("1km") == 1000);
  CHECK(length("1in") == 0.0254);
  CHECK(length("7m") == 7);
  for (const char* bad : {"", "mm", "0", "-1mm", "nan", "inf", "1e999", "1 parsec", "1e-400"}) {
    INFO(bad);
    CHECK_FALSE(parse_length(bad));
  }
}

TEST_CASE("whole numbers are parsed within their limits", "[options]") {
  CHECK(*parse_whole("16", 8, 24, "--bits") == 16);
  CHECK(*parse_whole("18446744073709551615", 0, UINT64_MAX, "--bits") == UINT64_MAX);
  for (const char* bad : {"", "7", "25", "16.0", "-16", "16x", " 16", "99999999999999999999"}) {
    INFO(bad);
    CHECK(refusal(parse_whole(bad, 8, 24, "--bits")).message.find("--bits") != std::string::npos);
  }
}

TEST_CASE("amounts are printed readably", "[options]") {
  CHECK(format_bytes(1023) == "1023 bytes");
  CHECK(format_bytes(1536) == "1.50 KiB");
  CHECK(format_bytes(uint64_t{38800} << 20) == "37.9 GiB");
  CHECK(format_bytes(1023 * 1024 + 1000) == "1.00 MiB");
  CHECK(format_count(999) == "999");
  CHECK(format_count(12345) == "12.3 k");
  CHECK(format_count(1.64e9) == "1.64 G");
  CHECK(format_duration(59.4) == "59 s");
  CHECK(format_duration(200) == "3 min 20 s");
  CHECK(format_duration(7500) == "2 h 05 min");
}
