// Whether the tests run under the sanitizers, which are several times slower and need more memory. In that case some
// tests do less.
#pragma once

namespace scree::tests {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kIsSanitized = true;
#else
inline constexpr bool kIsSanitized = false;
#endif

}  // namespace scree::tests
