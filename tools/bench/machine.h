// Where something was measured.
#pragma once

#include <string>

#include "runtime/draw/device_list.h"

namespace scree::bench {

struct Machine {
  std::string commit;  // of this program
  std::string device;  // a GPU's name, or a processor's
  std::string driver;  // of a GPU; empty without one
};

Machine gpu_machine(const runtime::Gpu& gpu);
/// The processor by its model's name.
Machine cpu_machine();

}  // namespace scree::bench
