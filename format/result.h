// The result of a function that handles bytes from outside: a value or an Error, never an exception.
#pragma once

#include <cassert>
#include <string>
#include <utility>
#include <variant>

namespace scree {

/// The kind of failure. The first four have exit codes of their own (exit_code); the rest are kinds of bad data.
enum class ErrorCode {
  kUsage,        // the caller's options make no sense
  kFile,         // the operating system refused: missing, unreadable, full disk, I/O error
  kDevice,       // no GPU, no driver, out of device memory
  kMemory,       // more memory needed than allowed or available
  kFormat,       // another kind of file than expected, or malformed
  kVersion,      // a newer major version than this program can read
  kTruncated,    // ends before its data is complete
  kTrailing,     // bytes left over after the data
  kChecksum,     // bytes differ from the written ones
  kRange,        // an index, count, offset or size outside its limits
  kReserved,     // a reserved bit or field is set
  kUnsupported,  // valid, but needs a feature that this program lacks
};

struct Error {
  ErrorCode code;
  std::string message;  // one line: place, found, expected; no trailing period or newline
};

/// Exit code of a tool: 1 usage, 2 file, 3 bad data, 4 device.
inline int exit_code(ErrorCode code) {
  switch (code) {
    case ErrorCode::kUsage:
      return 1;
    case ErrorCode::kFile:
      return 2;
    case ErrorCode::kMemory:
      return 2;
    case ErrorCode::kDevice:
      return 4;
    default:
      return 3;
  }
}

/// A T or an Error. Test it before use: value() of an error is a programming mistake (assert).
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

  explicit operator bool() const { return state_.index() == 0; }
  T& value() & {
    assert(*this);
    return *std::get_if<0>(&state_);
  }
  const T& value() const& {
    assert(*this);
    return *std::get_if<0>(&state_);
  }
  T&& value() && {
    assert(*this);
    return std::move(*std::get_if<0>(&state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }
  const Error& error() const {
    assert(!*this);
    return *std::get_if<1>(&state_);
  }

 private:
  std::variant<T, Error> state_;
};

template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : failed_(true), error_(std::move(error)) {}

  explicit operator bool() const { return !failed_; }
  const Error& error() const {
    assert(failed_);
    return error_;
  }

 private:
  bool failed_ = false;
  Error error_{ErrorCode::kFormat, {}};
};

/// Puts `place` and ": " before the error's message.
inline Error at(const std::string& place, const Error& error) {
  return {error.code, place + ": " + error.message};
}

}  // namespace scree

/// The value of a Result. If it is an Error, the function that contains this returns it: `const auto map =
/// SCREE_TRY(open(path));`, or `SCREE_TRY(check(map));` for a Result<void>. Not within another SCREE_TRY, nor within a
/// try block of a .cu file, on which nvcc 13.0 crashes. Uses statement expressions, which GCC and Clang have.
#define SCREE_TRY(...) SCREE_TRY_OR_RETURN(scree_result.error(), __VA_ARGS__)

/// The same; the returned Error begins with `place`, which is evaluated only then.
#define SCREE_TRY_AT(place, ...) SCREE_TRY_OR_RETURN(::scree::at(place, scree_result.error()), __VA_ARGS__)

#define SCREE_TRY_OR_RETURN(failure, ...)                                                     \
  __extension__({                                                                             \
    auto scree_result = (__VA_ARGS__);                                                        \
    if (!scree_result) return failure;                                                        \
    [](auto& scree_taken) {                                                                   \
      if constexpr (requires { scree_taken.value(); }) return std::move(scree_taken).value(); \
    }(scree_result);                                                                          \
  })
