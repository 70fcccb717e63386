// ConvertOptions: which go together, and how they are said.
#pragma once

#include <string>

#include "format/result.h"
#include "tools/convert/convert.h"

namespace scree::convert {

/// Whether the error is chosen, and not the bits.
bool bounds_error(const ConvertOptions& options);

/// Errors kUsage: options that exclude each other or are out of range.
Result<void> check_options(const ConvertOptions& options);

/// The options that shape the bytes, as they are typed.
std::string describe_options(const ConvertOptions& options);

}  // namespace scree::convert
