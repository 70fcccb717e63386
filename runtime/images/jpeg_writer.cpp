#include "runtime/images/jpeg_writer.h"

#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include <jpeglib.h>

#include <jerror.h>  // behind jpeglib.h: which codes it has depends on what libjpeg was built with

namespace scree::runtime {

struct JpegWriter::Impl {
  jpeg_error_mgr manager{};  // first: libjpeg passes on a pointer to it
  std::jmp_buf escape{};
  char fatal[JMSG_LENGTH_MAX]{};
  jpeg_compress_struct jpeg{};
  unsigned char* out = nullptr;
  unsigned long out_bytes = 0;

  Impl() {
    jpeg.err = jpeg_std_error(&manager);
    manager.error_exit = on_error;
    manager.emit_message = [](j_common_ptr, int) {};
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    jpeg_destroy_compress(&jpeg);  // does nothing if nothing was created
    std::free(out);
  }

  [[noreturn]] static void on_error(j_common_ptr info) {
    auto& impl = *reinterpret_cast<Impl*>(info->err);
    info->err->format_message(info, impl.fatal);
    std::longjmp(impl.escape, 1);
  }

  /// Runs `body`, whose frame must own nothing.
  template <class Body>
  Result<void> guarded(const Body& body) {
    if (setjmp(escape) == 0) {
      body();
      return {};
    }
    const bool out_of_memory = manager.msg_code == JERR_OUT_OF_MEMORY;
    return Error{out_of_memory ? ErrorCode::kMemory : ErrorCode::kUnsupported, std::string("JPEG: ") + fatal};
  }

  void start(const JpegCoding& coding) {
    const bool is_grey = coding.colour == format::JpegColour::kGrey;
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &out, &out_bytes);
    jpeg.image_width = coding.width;
    jpeg.image_height = coding.height;
    jpeg.input_components = is_grey ? 1 : 3;
    jpeg.in_color_space = is_grey ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(&jpeg);
    if (coding.colour == format::JpegColour::kRgb) jpeg_set_colorspace(&jpeg, JCS_RGB);
    jpeg_set_quality(&jpeg, coding.quality, TRUE);
    for (int table = 0; table < static_cast<int>(coding.quant.size()); ++table) {
      unsigned values[DCTSIZE2];
      for (size_t k = 0; k < DCTSIZE2; ++k)
        values[format::kJpegNaturalOrder[k]] = coding.quant[static_cast<size_t>(table)][k];
      jpeg_add_quant_table(&jpeg, table, values, 100, FALSE);
    }
    for (int i = 0; i < jpeg.num_components; ++i) {
      const format::JpegComponent& from = coding.components[static_cast<size_t>(i)];
      jpeg.comp_info[i].h_samp_factor = from.h;
      jpeg.comp_info[i].v_samp_factor = from.v;
      if (!coding.quant.empty()) jpeg.comp_info[i].quant_tbl_no = from.quant;
    }
    const bool is_small = uint64_t{coding.width} * coding.height <= kOptimisedJpegPixels;
    jpeg.optimize_coding = coding.has_own_tables && is_small ? TRUE : FALSE;
    jpeg_start_compress(&jpeg, TRUE);
  }
};

JpegWriter::JpegWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
JpegWriter::JpegWriter(JpegWriter&&) noexcept = default;
JpegWriter& JpegWriter::operator=(JpegWriter&&) noexcept = default;
JpegWriter::~JpegWriter() = default;

Result<JpegWriter> JpegWriter::create(const JpegCoding& coding) {
  auto impl = std::make_unique<Impl>();
  if (const Result<void> started = impl->guarded([&] { impl->start(coding); }); !started) return started.error();
  return JpegWriter(std::move(impl));
}

Result<void> JpegWriter::row(std::span<const uint8_t> samples) {
  return impl_->guarded([&] {
    auto* row = const_cast<JSAMPROW>(samples.data());  // libjpeg only reads it
    jpeg_write_scanlines(&impl_->jpeg, &row, 1);
  });
}

Result<std::vector<std::byte>> JpegWriter::finish() {
  if (const Result<void> done = impl_->guarded([&] { jpeg_finish_compress(&impl_->jpeg); }); !done) return done.error();
  const auto* const bytes = reinterpret_cast<const std::byte*>(impl_->out);
  return std::vector<std::byte>(bytes, bytes + impl_->out_bytes);
}

}  // namespace scree::runtime
