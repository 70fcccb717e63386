// Writes JSON as text, piece by piece.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace scree::tools {

/// Appends to `text`, which the caller may drain at any time. Commas are placed by the writer; the caller keeps the
/// pairs of begin and end, and a key before every value of an object (asserted nowhere: the tests parse what comes
/// out).
class JsonWriter {
 public:
  explicit JsonWriter(std::string& text) : text_(text) {}

  void begin_object() { open('{'); }
  void end_object() { close('}'); }
  void begin_array() { open('['); }
  void end_array() { close(']'); }
  void key(std::string_view name);
  void value(std::string_view text);
  void value(const char* text) { value(std::string_view(text)); }
  void value(uint64_t number);
  void value(uint32_t number) { value(uint64_t{number}); }
  void value(bool truth);
  /// The shortest text that reads back as the same double. A number JSON cannot say becomes 0 and is remembered.
  void value(double number);
  template <class T>
  void member(std::string_view name, const T& content) {
    key(name);
    value(content);
  }
  /// A line break, for people who look into the file; allowed between any two values.
  void line() { text_ += '\n'; }
  bool met_non_finite() const { return met_non_finite_; }

 private:
  void separate();
  void open(char bracket);
  void close(char bracket);

  std::string& text_;
  bool first_ = true;  // no comma before the next value
  bool after_key_ = false;
  bool met_non_finite_ = false;
};

/// `text` with what JSON strings must not hold escaped, and bytes that are not UTF-8 replaced by U+FFFD.
std::string json_escaped(std::string_view text);

}  // namespace scree::tools
