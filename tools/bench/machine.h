// The machine of a measurement.
#pragma once

#include <string>

#include "runtime/draw/device_list.h"

namespace scree::bench {

struct Machine {
  std::string commit;  // of this program
  std::string device;  // name of the GPU, or of the processor
  std::string driver;  // of the GPU; empty without one
};

Machine gpu_machine(const runtime::Gpu& gpu);
/// The processor by its model's name.
Machine cpu_machine();

}  // namespace scree::bench
