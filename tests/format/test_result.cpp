#include "format/result.h"

#include "tests/catch.h"

using scree::Error;
using scree::ErrorCode;
using scree::Result;

TEST_CASE("a Result holds a value or an error", "[result]") {
  const Result<int> good(7);
  REQUIRE(good);
  CHECK(*good == 7);
  const Result<int> bad(Error{ErrorCode::kRange, "index 9, but 4 vertices"});
  REQUIRE_FALSE(bad);
  CHECK(at("mesh 2", bad.error()).message == "mesh 2: index 9, but 4 vertices");
}

TEST_CASE("exit codes distinguish usage, file, data and device", "[result]") {
  CHECK(scree::exit_code(ErrorCode::kUsage) == 1);
  CHECK(scree::exit_code(ErrorCode::kFile) == 2);
  CHECK(scree::exit_code(ErrorCode::kChecksum) == 3);
  CHECK(scree::exit_code(ErrorCode::kDevice) == 4);
}
