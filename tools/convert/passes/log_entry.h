// Packs values of fixed size one after another, for the log of a .part and for shards.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace scree::convert {

class EntryWriter {
 public:
  /// `value` has no padding, whose bytes would be undefined.
  template <class T>
  void add(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    const auto bytes = std::as_bytes(std::span(&value, 1));
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  template <class T>
  void add_list(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    add(uint64_t{values.size()});
    const auto bytes = std::as_bytes(std::span(values));
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  void add_text(std::string_view text) { add_list(std::vector<char>(text.begin(), text.end())); }
  std::span<const std::byte> bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

/// Safe on any bytes: a value that is missing stays unchanged, and failed() is true from then on.
class EntryReader {
 public:
  explicit EntryReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  void take(T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    if (failed_ || bytes_.size() < sizeof value) {
      failed_ = true;
      return;
    }
    std::memcpy(&value, bytes_.data(), sizeof value);
    bytes_ = bytes_.subspan(sizeof value);
  }
  template <class T>
  void take_list(std::vector<T>& values) {
    const uint64_t count = take_count(sizeof(T));
    if (failed_) return;
    values.resize(count);
    if (count > 0) std::memcpy(values.data(), bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
  }
  void take_text(std::string& text) {
    std::vector<char> letters;
    take_list(letters);
    text.assign(letters.begin(), letters.end());
  }
  /// The number of items that follow, of at least `least_bytes` each; 0 after a failure.
  uint64_t take_count(size_t least_bytes) {
    uint64_t count = 0;
    take(count);
    if (count > bytes_.size() / least_bytes) failed_ = true;
    return failed_ ? 0 : count;
  }
  bool more() const { return !failed_ && !bytes_.empty(); }
  bool failed() const { return failed_; }

 private:
  std::span<const std::byte> bytes_;
  bool failed_ = false;
};

}  // namespace scree::convert
