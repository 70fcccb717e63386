// Options that scree bench must refuse.
#pragma once

#include <string>

#include "tests/catch.h"
#include "tools/bench/options.h"

namespace scree::tests {

/// What is said of them.
inline std::string refused(const bench::BenchWords& words) {
  const Result<bench::BenchOptions> options = bench::parse_options(words);
  REQUIRE_FALSE(options);
  CHECK(options.error().code == ErrorCode::kUsage);
  return options.error().message;
}

}  // namespace scree::tests
