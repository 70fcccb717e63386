// Expectations of a Result in tests: must() returns its value, refusal() and check_refusal() its error. If one fails,
// it prints the error and the place of the call.
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "format/result.h"
#include "tests/catch.h"

namespace scree {

template <class T>
T must(Result<T> result, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  INFO(file << ':' << line << ": " << (result ? "" : result.error().message));
  REQUIRE(result);
  return std::move(*result);
}
inline void must(const Result<void>& done, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  INFO(file << ':' << line << ": " << (done ? "" : done.error().message));
  REQUIRE(done);
}
template <class T>
T must(std::optional<T> value, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  INFO(file << ':' << line << ": there is no value");
  REQUIRE(value);
  return std::move(*value);
}

template <class T>
Error refusal(const Result<T>& result, const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  INFO(file << ':' << line << ": there is no error");
  REQUIRE_FALSE(result);
  return result.error();
}

/// Checks that the error has this code, and a message with `words` in it.
inline void check_error(const Error& error, ErrorCode code, const std::string& words,
                        const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  INFO(file << ':' << line << ": " << error.message);
  CHECK(error.code == code);
  CHECK(error.message.find(words) != std::string::npos);
}

/// The same for the error of a result.
template <class T>
void check_refusal(const Result<T>& result, ErrorCode code, const std::string& words,
                   const char* file = __builtin_FILE(), int line = __builtin_LINE()) {
  check_error(refusal(result, file, line), code, words, file, line);
}

/// Checks that the error is `expected`.
template <class T>
void check_refusal(const Result<T>& result, const Error& expected, const char* file = __builtin_FILE(),
                   int line = __builtin_LINE()) {
  const Error error = refusal(result, file, line);
  INFO(file << ':' << line);
  CHECK(error.code == expected.code);
  CHECK(error.message == expected.message);
}

}  // namespace scree
