// Writes JSON as text, piece by piece.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace scree::tools {

/// Appends to `text`, which the caller may drain at any time. The writer places commas. The caller must pair begin and
/// end, and write a key before every value of an object. That is not asserted; the tests parse the output.
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
  /// The shortest text that reads back as the same double. A number that is not finite becomes null and sets
  /// met_non_finite().
  void value(double number);
  template <class T>
  void member(std::string_view name, const T& content) {
    key(name);
    value(content);
  }
  /// An object; `members()` writes the members of it.
  template <class Members>
  void object(const Members& members) {
    begin_object();
    members();
    end_object();
  }
  /// A member that is an object.
  template <class Members>
  void object(std::string_view name, const Members& members) {
    key(name);
    object(members);
  }
  /// An array of numbers or texts.
  template <class Items>
  void array(const Items& items) {
    begin_array();
    for (const auto& item : items) value(item);
    end_array();
  }
  template <class Items>
  void array(std::string_view name, const Items& items) {
    key(name);
    array(items);
  }
  /// A member that is an array; `write(item)` writes one value.
  template <class Items, class Write>
  void array(std::string_view name, const Items& items, const Write& write) {
    key(name);
    begin_array();
    for (const auto& item : items) write(item);
    end_array();
  }
  /// A member that is an array of objects; `members(item)` writes the members of one.
  template <class Items, class Members>
  void objects(std::string_view name, const Items& items, const Members& members) {
    array(name, items, [&](const auto& item) { object([&] { members(item); }); });
  }
  /// A line break for readability; allowed between any two values.
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

/// The text of one object; `members(json)` writes its members.
template <class Members>
std::string json_object(const Members& members) {
  std::string text;
  JsonWriter json(text);
  json.object([&] { members(json); });
  return text;
}

/// `text` with characters escaped that JSON strings must not contain, and bytes that are not UTF-8 replaced by U+FFFD.
std::string json_escaped(std::string_view text);

}  // namespace scree::tools
