// URIs of buffers and images: relative paths inside the scene's folder, and data: URIs (RFC 2397).
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::convert {

/// Help of the option --allow-outside, which the error of resolve_uri() names.
inline constexpr const char* kAllowOutsideHelp =
    "Read buffers and images that lie outside the glTF's folder, by ../ or by a symbolic link";

/// Whether a URI begins with data:, in upper or lower case.
bool is_data_uri(std::string_view uri);

/// The bytes of a data: URI, percent-decoded or base64. Errors kFormat.
Result<std::vector<std::byte>> decode_data_uri(std::string_view uri);

/// The file of a relative URI, percent-decoded, in `folder` (of the scene, as given). Errors kUnsupported: a scheme, an
/// absolute path, or a path that leaves the folder, also through a symbolic link (after resolving links it must lie
/// inside the resolved folder); `allow_outside` permits the last. kFormat: bad percent coding; kFile: no such file.
Result<std::string> resolve_uri(const std::string& folder, std::string_view uri, bool allow_outside);

}  // namespace scree::convert
