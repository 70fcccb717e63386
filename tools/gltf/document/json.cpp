#include "tools/gltf/document/json.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <new>
#include <nlohmann/json.hpp>
#include <utility>

#include "format/fail.h"

namespace scree::convert {
namespace {

bool is_space(char c) {
  return c == ' ' || c == '\n' || c == '\r' || c == '\t';
}

Error error_at(uint64_t byte, const std::string& what) {
  return {ErrorCode::kFormat, "JSON byte " + std::to_string(byte) + ": " + what};
}

// The index after the closing quote of the string whose opening quote is at `at`; 0 if it is not closed.
uint64_t string_end(std::span<const char> text, uint64_t at) {
  uint64_t from = at + 1;
  while (from < text.size()) {
    const void* found = std::memchr(text.data() + from, '"', text.size() - from);
    if (found == nullptr) return 0;
    const uint64_t quote = static_cast<uint64_t>(static_cast<const char*>(found) - text.data());
    uint64_t backslashes = 0;
    while (quote - backslashes > from && text[quote - backslashes - 1] == '\\') ++backslashes;
    if (backslashes % 2 == 0) return quote + 1;
    from = quote + 1;
  }
  return 0;
}

// Tracks the open brackets of a text. The caller passes every character outside strings.
class Nesting {
 public:
  uint32_t depth() const { return depth_; }
  bool in_object() const { return depth_ > 0 && objects_[depth_ - 1]; }

  Result<void> open(char bracket, uint64_t byte) {
    if (depth_ == kMaxJsonDepth)
      return error_at(byte, "nested deeper than " + std::to_string(kMaxJsonDepth) + " levels");
    objects_[depth_++] = bracket == '{';
    return {};
  }

  Result<void> close(char bracket, uint64_t byte) {
    if (depth_ == 0 || objects_[depth_ - 1] != (bracket == '}'))
      return error_at(byte, std::string("'") + bracket + "' without an opening bracket");
    --depth_;
    return {};
  }

 private:
  std::array<bool, kMaxJsonDepth> objects_{};
  uint32_t depth_ = 0;
};

// The end of the value that starts at `at`: a string, a bracketed value or a bare word.
Result<uint64_t> value_end(std::span<const char> text, uint64_t at, uint64_t limit) {
  const std::span<const char> bounded = text.first(limit);
  if (bounded[at] == '"') {
    const uint64_t end = string_end(bounded, at);
    if (end == 0) return error_at(at, "a string without end");
    return end;
  }
  if (bounded[at] != '{' && bounded[at] != '[') {
    uint64_t end = at;
    while (end < limit && !is_space(bounded[end]) && std::strchr(",:]}[{\"", bounded[end]) == nullptr) ++end;
    if (end == at) return error_at(at, "expected a value");
    return end;
  }
  Nesting nesting;
  for (uint64_t i = at; i < limit; ++i) {
    const char c = bounded[i];
    if (c == '"') {
      const uint64_t end = string_end(bounded, i);
      if (end == 0) return error_at(i, "a string without end");
      i = end - 1;
    } else if (c == '{' || c == '[') {
      SCREE_TRY(nesting.open(c, i));
    } else if (c == '}' || c == ']') {
      SCREE_TRY(nesting.close(c, i));
      if (nesting.depth() == 0) return i + 1;
    }
  }
  return error_at(at, std::string("'") + bounded[at] + "' is never closed");
}

uint64_t skip_space(std::span<const char> text, uint64_t at) {
  while (at < text.size() && is_space(text[at])) ++at;
  return at;
}

// Calls on_key(key range with quotes, depth, in) for every key of every object within `range`. on_key returns the index
// to continue from, at or after the end of the key.
template <class OnKey>
void for_each_key(std::span<const char> text, JsonRange range, OnKey on_key) {
  Nesting nesting;
  bool expect_key = false;
  for (uint64_t i = range.begin; i < range.end; ++i) {
    const char c = text[i];
    if (c == '"') {
      uint64_t end = string_end(text.first(range.end), i);
      if (end == 0) return;
      if (expect_key) end = on_key(JsonRange{i, end}, nesting.depth());
      expect_key = false;
      i = end - 1;
    } else if (c == '{' || c == '[') {
      if (!nesting.open(c, i)) return;
      expect_key = c == '{';
    } else if (c == '}' || c == ']') {
      if (!nesting.close(c, i)) return;
      expect_key = false;
    } else if (c == ',') {
      expect_key = nesting.in_object();
    }
  }
}

std::string_view view(std::span<const char> text, JsonRange range) {
  return {text.data() + range.begin, static_cast<size_t>(range.end - range.begin)};
}

Result<void> empty_extras(std::span<char> text, JsonRange range) {
  Result<void> result;
  for_each_key(text, range, [&](JsonRange key, uint32_t) {
    if (view(text, key) != "\"extras\"") return key.end;
    uint64_t at = skip_space(text, key.end);
    if (at >= range.end || text[at] != ':') return key.end;
    at = skip_space(text, at + 1);
    if (at >= range.end || (text[at] != '{' && text[at] != '[')) return key.end;
    const auto end = value_end(text, at, range.end);
    if (!end) return key.end;
    if (result && !nlohmann::json::accept(text.data() + at, text.data() + *end))
      result = error_at(at, "extras are malformed");
    std::fill(text.begin() + static_cast<std::ptrdiff_t>(at + 1), text.begin() + static_cast<std::ptrdiff_t>(*end - 1),
              ' ');
    return *end;
  });
  return result;
}

Result<std::string> decoded_key(std::span<const char> text, JsonRange range) {
  const std::string_view quoted = view(text, range);
  if (quoted.find('\\') == std::string_view::npos) return std::string(quoted.substr(1, quoted.size() - 2));
  const auto parsed = nlohmann::json::parse(quoted.begin(), quoted.end(), nullptr, false);
  if (!parsed.is_string()) return error_at(range.begin, "bad escape in a key");
  return parsed.get<std::string>();
}

}  // namespace

Result<std::vector<char>> read_json_text(const ByteSource& source, uint64_t offset, uint64_t bytes,
                                         const ImportOptions& options) try {
  constexpr uint64_t kReadBytes = 16 << 20;
  std::vector<char> text(bytes);
  for (uint64_t done = 0; done < bytes; done += kReadBytes) {
    SCREE_TRY(options.check_stop());
    const auto part = std::span(text).subspan(done, std::min(kReadBytes, bytes - done));
    SCREE_TRY(source.read(offset + done, std::as_writable_bytes(part)));
  }
  return text;
} catch (const std::bad_alloc&) {
  return fail(ErrorCode::kMemory, "no memory for ", bytes, " bytes of JSON");
}

Result<std::vector<JsonMember>> split_document(std::span<char> text) {
  uint64_t at = skip_space(text, 0);
  if (at == text.size()) return Error{ErrorCode::kFormat, "JSON is empty"};
  if (text[at] != '{') return error_at(at, "expected '{', a glTF document is an object");
  const auto end = SCREE_TRY(value_end(text, at, text.size()));
  const uint64_t rest = skip_space(text, end);
  if (rest != text.size()) {
    return fail(ErrorCode::kTrailing, "JSON byte ", rest, ": ", text.size() - rest,
                " bytes after the end of the document");
  }
  SCREE_TRY(empty_extras(text, {at, end}));
  return split_object(text, {at, end});
}

Result<std::vector<JsonMember>> split_object(std::span<const char> text, JsonRange object) {
  std::vector<JsonMember> members;
  const uint64_t last = object.end - 1;  // the closing brace
  uint64_t at = skip_space(text, object.begin + 1);
  while (at < last) {
    if (text[at] != '"') return error_at(at, "expected a member name in quotes");
    const uint64_t key_end = string_end(text, at);
    auto key = SCREE_TRY(decoded_key(text, {at, key_end}));
    for (const JsonMember& member : members) {
      if (member.key == key) return error_at(at, "member \"" + key.substr(0, 80) + "\" appears twice");
    }
    at = skip_space(text, key_end);
    if (at >= last || text[at] != ':') return error_at(at, "expected ':'");
    at = skip_space(text, at + 1);
    if (at >= last) return error_at(at, "expected a value");
    const auto member_end = SCREE_TRY(value_end(text, at, last));
    members.push_back({std::move(key), {at, member_end}});
    if (members.size() > 4096) return error_at(at, "more than 4096 members in an object");
    at = skip_space(text, member_end);
    if (at == last) break;
    if (text[at] != ',') return error_at(at, "expected ',' or '}'");
    at = skip_space(text, at + 1);
    if (at == last) return error_at(at, "expected a member after ','");
  }
  return members;
}

Result<JsonElements::Batch> JsonElements::next(uint64_t max_bytes) {
  Batch batch{.first = index_};
  uint64_t at = skip_space(text_.first(end_), at_);
  if (at >= end_) return batch;
  batch.elements.begin = at;
  while (true) {
    const auto element_end = SCREE_TRY(value_end(text_, at, end_));
    if (batch.count > 0 && element_end - batch.elements.begin > max_bytes) break;
    batch.elements.end = element_end;
    ++batch.count;
    at = skip_space(text_.first(end_), element_end);
    if (at < end_) {
      if (text_[at] != ',') return error_at(at, "expected ',' or ']'");
      at = skip_space(text_.first(end_), at + 1);
      if (at >= end_) return error_at(at, "expected an element after ','");
    }
    at_ = at;
    if (at >= end_) break;
  }
  index_ += batch.count;
  return batch;
}

void hide_primitive_indices(std::string& batch) {
  // {"meshes": [{"primitives": [{"indices": ... is five brackets deep.
  constexpr uint32_t kPrimitiveDepth = 5;
  for_each_key(batch, {0, batch.size()}, [&](JsonRange key, uint32_t depth) {
    if (depth == kPrimitiveDepth && view(batch, key) == "\"indices\"") batch[key.begin + 1] = 'I';
    return key.end;
  });
}

}  // namespace scree::convert
