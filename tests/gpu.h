// Whether what needs a GPU can be tested here.
#pragma once

namespace scree::tests {

/// Says with WARN why where it cannot; that has to be the device's error.
bool has_gpu();

}  // namespace scree::tests
