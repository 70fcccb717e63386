#pragma once

#include "format/jpeg/mcu.h"

namespace scree::tests {

using namespace scree::format;

/// Decodes MCU `mcu` from its group's anchor and discards the values of the group's earlier MCUs. Sink and result as
/// for decode_jpeg_mcu_at(). Reentrant.
template <class Sink>
bool decode_jpeg_mcu(const JpegView& view, uint32_t mcu, Sink&& sink) {
  if (mcu >= view.mcu_count) return false;
  JpegCursor cursor = jpeg_anchor(view, mcu / view.group_mcus);
  while (cursor.mcu < mcu)
    if (!decode_jpeg_mcu_at(view, cursor, [](uint32_t, uint32_t, int32_t) {})) return false;
  return decode_jpeg_mcu_at(view, cursor, sink);
}

}  // namespace scree::tests
