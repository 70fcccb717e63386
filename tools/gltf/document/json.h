// Splits the JSON text of a glTF file into its top-level members and array elements, before any parser reads it.
//
// tinygltf parses pieces of the document, never all of it. Its DOM takes about 12.6 bytes per byte of JSON, and its
// model as much again. It would read every buffer and image into memory, and deep nesting would overflow its stack. The
// scanner here is iterative, allocates nothing that grows with the text, and recognises only strings, brackets and
// commas. The parsers check the rest (schema.h, tinygltf).
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

inline constexpr uint32_t kMaxJsonDepth = 128;  // nested brackets; real documents stay below 20

/// Reads bytes [offset, offset + bytes) of a source into memory that may be changed. They are read, not mapped: a file
/// that shrinks under a map ends the program with a signal, while a failed read is an error. Errors kTruncated, kFile,
/// kMemory.
Result<std::vector<char>> read_json_text(const ByteSource& source, uint64_t offset, uint64_t bytes,
                                         const ImportOptions& options = {});

/// A piece of the text: bytes [begin, end).
struct JsonRange {
  uint64_t begin = 0;
  uint64_t end = 0;
};

struct JsonMember {
  std::string key;  // escapes decoded
  JsonRange value;
};

/// Splits the document into its top-level members. Also empties every object or array called "extras" in place: it is
/// never used, and tinygltf turns each value into some 150 bytes. Errors kFormat: not an object, unbalanced, nested
/// deeper than kMaxJsonDepth, a repeated member, text after the end. Each error names its byte.
Result<std::vector<JsonMember>> split_document(std::span<char> text);

/// Splits an object within a document that split_document() has split. Errors as there.
Result<std::vector<JsonMember>> split_object(std::span<const char> text, JsonRange object);

/// Yields whole elements of a JSON array, a batch at a time.
class JsonElements {
 public:
  /// `array`: the value of a member, starting with '['.
  JsonElements(std::span<const char> text, JsonRange array) : text_(text), at_(array.begin + 1), end_(array.end - 1) {}

  struct Batch {
    JsonRange elements;  // separated by commas
    uint64_t first = 0;  // number of the first element
    uint64_t count = 0;  // 0: no more
  };

  /// The next elements: as many as fit into `max_bytes`, at least one. Errors kFormat: a missing element.
  Result<Batch> next(uint64_t max_bytes);

 private:
  std::span<const char> text_;
  uint64_t at_;
  uint64_t end_;
  uint64_t index_ = 0;
};

/// Renames the key "indices" of every glTF mesh primitive to "Indices" in a batch document {"meshes": [...]}
/// (document.cpp gives the reason).
void hide_primitive_indices(std::string& batch);

}  // namespace scree::convert
