#include "runtime/textures/srgb.h"

namespace scree::runtime {

const Srgb& Srgb::tables() {
  static const Srgb made;
  return made;
}

}  // namespace scree::runtime
