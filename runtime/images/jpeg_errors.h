// libjpeg's errors as results.
#pragma once

#include <csetjmp>
#include <cstdio>
#include <string>

#include <jpeglib.h>

#include <jerror.h>  // must follow jpeglib.h; its codes depend on the build of libjpeg

#include "format/result.h"
#include "runtime/images/codecs.h"

namespace scree::runtime {

/// libjpeg's error manager with a jump target. Trivially destructible, because a jump skips destructors.
struct JpegErrors {
  jpeg_error_mgr manager;  // first: libjpeg passes on a pointer to it
  std::jmp_buf escape;
  char fatal[JMSG_LENGTH_MAX];
  char warning[JMSG_LENGTH_MAX];

  /// Returns the pointer for jpeg.err, in place of jpeg_std_error(). Nothing is printed; the first warning is kept.
  jpeg_error_mgr* set_up() {
    jpeg_std_error(&manager);
    manager.error_exit = [](j_common_ptr info) {
      info->err->format_message(info, of(info).fatal);
      of(info).leave();
    };
    manager.emit_message = [](j_common_ptr info, int level) {
      if (level >= 0) return;  // traces
      if (info->err->num_warnings++ == 0) info->err->format_message(info, of(info).warning);
    };
    return &manager;
  }

  /// For jpeg_progress_mgr::progress_monitor of a decompressor: ends files of more than kMaxJpegScans scans.
  static void limit_scans(j_common_ptr info) {
    if (reinterpret_cast<j_decompress_ptr>(info)->input_scan_number <= kMaxJpegScans) return;
    std::snprintf(of(info).fatal, sizeof of(info).fatal, "more than %d scans", kMaxJpegScans);
    of(info).leave();
  }

  static JpegErrors& of(j_common_ptr info) { return *reinterpret_cast<JpegErrors*>(info->err); }

  [[noreturn]] void leave() { std::longjmp(escape, 1); }

  /// Runs `body`, whose frame must own nothing. Returns false if libjpeg failed: see error().
  template <class Body>
  bool guarded(const Body& body) {
    if (setjmp(escape) != 0) return false;
    body();
    return true;
  }

  /// The error after guarded() returned false: kMemory, kUnsupported (too many blocks for an MCU), else `other`.
  /// `place`: the file, followed by ": ".
  Error error(ErrorCode other = ErrorCode::kFormat, const std::string& place = "") const {
    const ErrorCode code = manager.msg_code == JERR_OUT_OF_MEMORY  ? ErrorCode::kMemory
                           : manager.msg_code == JERR_BAD_MCU_SIZE ? ErrorCode::kUnsupported
                                                                   : other;
    return {code, "JPEG: " + place + fatal};
  }
};

}  // namespace scree::runtime
