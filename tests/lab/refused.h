// Options that scree-lab must refuse.
#pragma once

#include <string>

#include "lab/options.h"
#include "tests/catch.h"

namespace scree::tests {

/// The error for options that must be refused.
template <class Options>
std::string refusal(const Result<Options>& options) {
  REQUIRE_FALSE(options);
  CHECK(options.error().code == ErrorCode::kUsage);
  return options.error().message;
}

inline std::string refused(const lab::LabWords& words) {
  return refusal(lab::parse_options(words));
}

}  // namespace scree::tests
