#include "runtime/images/jpeg_writer.h"

#include <cstdlib>
#include <utility>

#include "runtime/images/jpeg_errors.h"

namespace scree::runtime {

struct JpegWriter::Impl {
  JpegErrors errors{};
  jpeg_compress_struct jpeg{};
  unsigned char* out = nullptr;
  unsigned long out_bytes = 0;

  Impl() { jpeg.err = errors.set_up(); }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    jpeg_destroy_compress(&jpeg);  // does nothing if nothing was created
    std::free(out);
  }

  template <class Body>
  Result<void> guarded(const Body& body) {
    if (errors.guarded(body)) return {};
    return errors.error(ErrorCode::kUnsupported);
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
