// The rules of glTF 2.0 for the members that scree reads: their types, ranges and lengths, checked on the raw JSON.
// tinygltf drops optional members of the wrong type and truncates integers ("mesh": 4294967296 becomes 0). After this
// check it drops and truncates nothing.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::convert {

struct SchemaOutcome {
  /// "indices" of every primitive of a "meshes" batch, in order; -1 if it has none.
  std::vector<int32_t> primitive_indices;
};

/// Checks a batch document: {"SECTION": [elements ...]}, or {"asset": {...}}. `section` names a top-level array of
/// glTF, or "asset". For messages: `first` is the number of the batch's first element, `json_byte` the offset of its
/// elements in the whole JSON. Errors kFormat (malformed JSON, a wrong type, a missing member), kRange (a number that
/// is not an index, count or finite number; an array of the wrong length): "mesh 3: primitives[0].attributes.POSITION
/// is -1, expected an index".
Result<SchemaOutcome> check_schema(std::string_view section, std::string_view batch, uint64_t first,
                                   uint64_t json_byte);

/// "mesh" for "meshes" and so on.
std::string_view singular(std::string_view section);

/// Checks that a piece of JSON that scree does not use is well-formed.
Result<void> check_json(std::string_view text, uint64_t json_byte);

}  // namespace scree::convert
