// Whether the tests run under the sanitizers: several times slower, so that some do less there, and with more memory.
#pragma once

namespace scree::tests {

#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool kIsSanitized = true;
#else
inline constexpr bool kIsSanitized = false;
#endif

}  // namespace scree::tests
