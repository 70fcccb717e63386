#include "tests/format/jpeg/jpeg_maker.h"

#include <cstdlib>
#include <random>

#include <jpeglib.h>

namespace scree::tests {
namespace {

[[noreturn]] void on_error(j_common_ptr info) {
  info->err->output_message(info);
  std::abort();
}

void on_message(j_common_ptr, int) {}

void set_up(jpeg_error_mgr& errors) {
  jpeg_std_error(&errors);
  errors.error_exit = on_error;
  errors.emit_message = on_message;
}

/// A decompressor that has read `file`'s header.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> file) {
    set_up(errors_);
    jpeg.err = &errors_;
    jpeg_create_decompress(&jpeg);
    jpeg_mem_src(&jpeg, reinterpret_cast<const unsigned char*>(file.data()), file.size());
    jpeg_read_header(&jpeg, TRUE);
  }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { jpeg_destroy_decompress(&jpeg); }

  jpeg_decompress_struct jpeg{};

 private:
  jpeg_error_mgr errors_{};
};

/// Adds the standard Huffman tables again as number 2.
void add_huffman_tables(jpeg_compress_struct& jpeg) {
  jpeg.dc_huff_tbl_ptrs[2] = jpeg_alloc_huff_table(reinterpret_cast<j_common_ptr>(&jpeg));
  jpeg.ac_huff_tbl_ptrs[2] = jpeg_alloc_huff_table(reinterpret_cast<j_common_ptr>(&jpeg));
  *jpeg.dc_huff_tbl_ptrs[2] = *jpeg.dc_huff_tbl_ptrs[0];
  *jpeg.ac_huff_tbl_ptrs[2] = *jpeg.ac_huff_tbl_ptrs[0];
}

void write_segments(jpeg_compress_struct& jpeg) {
  const std::string exif("Exif\0\0II*\0\xff\xd8\xff\xda\0\0", 16);  // some of these bytes look like markers
  const std::string comment = "a comment";
  const std::string photo = "Photoshop 3.0" + std::string(60000, '\xff');
  jpeg_write_marker(&jpeg, JPEG_APP0 + 1, reinterpret_cast<const JOCTET*>(exif.data()), 16);
  jpeg_write_marker(&jpeg, JPEG_APP0 + 13, reinterpret_cast<const JOCTET*>(photo.data()),
                    static_cast<unsigned>(photo.size()));
  jpeg_write_marker(&jpeg, JPEG_COM, reinterpret_cast<const JOCTET*>(comment.data()),
                    static_cast<unsigned>(comment.size()));
}

}  // namespace

std::vector<std::byte> make_jpeg(const JpegRecipe& recipe) {
  const auto components = static_cast<int>(recipe.factors.size());
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  set_up(errors);
  jpeg.err = &errors;
  jpeg_create_compress(&jpeg);
  unsigned char* out = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &out, &size);
  jpeg.image_width = static_cast<JDIMENSION>(recipe.width);
  jpeg.image_height = static_cast<JDIMENSION>(recipe.height);
  jpeg.input_components = components;
  jpeg.in_color_space = components == 1 ? JCS_GRAYSCALE : components == 3 ? JCS_RGB : JCS_CMYK;
  jpeg_set_defaults(&jpeg);
  if (recipe.is_rgb) jpeg_set_colorspace(&jpeg, JCS_RGB);
  jpeg_set_quality(&jpeg, recipe.quality, recipe.has_wide_quant ? FALSE : TRUE);
  for (int i = 0; i < components; ++i) {
    jpeg_component_info& component = jpeg.comp_info[i];
    component.h_samp_factor = recipe.factors[static_cast<size_t>(i)].first;
    component.v_samp_factor = recipe.factors[static_cast<size_t>(i)].second;
    if (recipe.has_three_tables) component.quant_tbl_no = component.dc_tbl_no = component.ac_tbl_no = i;
  }
  if (recipe.has_three_tables) {
    jpeg.quant_tbl_ptrs[2] = jpeg_alloc_quant_table(reinterpret_cast<j_common_ptr>(&jpeg));
    for (unsigned i = 0; i < DCTSIZE2; ++i) jpeg.quant_tbl_ptrs[2]->quantval[i] = static_cast<UINT16>(3 + i);
    add_huffman_tables(jpeg);
  }
  jpeg.optimize_coding = recipe.is_optimised ? TRUE : FALSE;
  jpeg.arith_code = recipe.is_arithmetic ? TRUE : FALSE;
  jpeg.restart_interval = static_cast<unsigned>(recipe.restart);
  if (recipe.is_progressive) jpeg_simple_progression(&jpeg);
  std::vector<jpeg_scan_info> scans;
  if (recipe.has_scan_each) {
    for (int i = 0; i < components; ++i) scans.push_back({1, {i, 0, 0, 0}, 0, 63, 0, 0});
    jpeg.scan_info = scans.data();
    jpeg.num_scans = components;
  }
  jpeg_start_compress(&jpeg, TRUE);
  if (recipe.has_segments) write_segments(jpeg);
  // Ramps with noise, and flat squares, so that all lengths of codes and runs occur.
  std::mt19937 random(static_cast<unsigned>(recipe.width * 7919 + recipe.height));
  std::vector<unsigned char> row(static_cast<size_t>(recipe.width * components));
  while (jpeg.next_scanline < jpeg.image_height) {
    const unsigned y = jpeg.next_scanline;
    for (unsigned x = 0; x < jpeg.image_width; ++x) {
      const bool is_flat = (x / 24 + y / 24) % 3 == 0;
      for (unsigned c = 0; c < static_cast<unsigned>(components); ++c) {
        const unsigned value = is_flat ? 40 * c + 3 * (x / 24) : 2 * x + 3 * y + 50 * c + random() % 64;
        row[x * static_cast<unsigned>(components) + c] = static_cast<unsigned char>(value);
      }
    }
    JSAMPROW rows[1] = {row.data()};
    jpeg_write_scanlines(&jpeg, rows, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  const auto* const bytes = reinterpret_cast<const std::byte*>(out);
  std::vector<std::byte> file(bytes, bytes + size);
  std::free(out);
  return file;
}

std::vector<JpegRecipe> indexable_recipes() {
  using Factors = std::vector<std::pair<int, int>>;
  const std::vector<std::pair<std::string, Factors>> kinds = {
      {"grey", {{1, 1}}},
      {"grey 2x2", {{2, 2}}},
      {"4:4:4", {{1, 1}, {1, 1}, {1, 1}}},
      {"4:2:2", {{2, 1}, {1, 1}, {1, 1}}},
      {"4:4:0", {{1, 2}, {1, 1}, {1, 1}}},
      {"4:2:0", {{2, 2}, {1, 1}, {1, 1}}},
      {"4:1:1", {{4, 1}, {1, 1}, {1, 1}}},
      {"4:1:0", {{4, 2}, {1, 1}, {1, 1}}},
      {"2x2 2x1 1x2", {{2, 2}, {2, 1}, {1, 2}}},
      {"1x1 2x2 1x1", {{1, 1}, {2, 2}, {1, 1}}},
      {"2x4 1x1 1x1", {{2, 4}, {1, 1}, {1, 1}}},
      {"3x1 1x1 1x3", {{3, 1}, {1, 1}, {1, 3}}},
  };
  std::vector<JpegRecipe> recipes;
  for (const auto& [name, factors] : kinds) {
    for (const auto& [width, height] : {std::pair{1, 1}, {16, 16}, {33, 17}, {227, 149}}) {
      recipes.push_back({.name = name + " " + std::to_string(width) + "x" + std::to_string(height),
                         .width = width,
                         .height = height,
                         .factors = factors});
    }
    JpegRecipe restarts = recipes.back();
    restarts.name += " restart 5";
    restarts.restart = 5;
    recipes.push_back(restarts);
  }
  const JpegRecipe base{.width = 151, .height = 103, .factors = kinds[5].second};
  const auto add = [&](const char* name, auto change) {
    JpegRecipe recipe = base;
    recipe.name = name;
    change(recipe);
    recipes.push_back(recipe);
  };
  add("optimised", [](JpegRecipe& r) { r.is_optimised = true; });
  add("restart 1", [](JpegRecipe& r) { r.restart = 1; });
  add("quality 100", [](JpegRecipe& r) { r.quality = 100; });
  add("quality 1, 16-bit tables", [](JpegRecipe& r) { r.quality = 1, r.has_wide_quant = true; });
  add("three tables", [](JpegRecipe& r) { r.has_three_tables = true; });
  add("three tables, optimised", [](JpegRecipe& r) { r.has_three_tables = r.is_optimised = true; });
  add("segments", [](JpegRecipe& r) { r.has_segments = true; });
  add("rgb", [](JpegRecipe& r) { r.is_rgb = true, r.factors = {{1, 1}, {1, 1}, {1, 1}}; });
  add("rgb, 4:2:0, quality 97", [](JpegRecipe& r) { r.is_rgb = true, r.quality = 97; });
  return recipes;
}

std::vector<JpegPlane> read_coefficients(std::span<const std::byte> file) {
  Reader reader(file);
  jvirt_barray_ptr* const arrays = jpeg_read_coefficients(&reader.jpeg);
  std::vector<JpegPlane> planes;
  for (int c = 0; c < reader.jpeg.num_components; ++c) {
    const jpeg_component_info& component = reader.jpeg.comp_info[c];
    JpegPlane plane{component.width_in_blocks, component.height_in_blocks, {}};
    for (JDIMENSION y = 0; y < component.height_in_blocks; ++y) {
      const JBLOCKARRAY rows =
          reader.jpeg.mem->access_virt_barray(reinterpret_cast<j_common_ptr>(&reader.jpeg), arrays[c], y, 1, FALSE);
      const JCOEF* const first = rows[0][0];
      plane.values.insert(plane.values.end(), first, first + size_t{DCTSIZE2} * component.width_in_blocks);
    }
    planes.push_back(std::move(plane));
  }
  return planes;
}

std::vector<std::vector<uint16_t>> read_quant_tables(std::span<const std::byte> file) {
  Reader reader(file);
  jpeg_read_coefficients(&reader.jpeg);  // a component's tables are available once its scan begins
  std::vector<std::vector<uint16_t>> tables;
  for (int c = 0; c < reader.jpeg.num_components; ++c) {
    const UINT16* const values = reader.jpeg.comp_info[c].quant_table->quantval;
    tables.emplace_back(values, values + DCTSIZE2);
  }
  return tables;
}

std::vector<JpegSamples> read_samples(std::span<const std::byte> file) {
  Reader reader(file);
  jpeg_decompress_struct& jpeg = reader.jpeg;
  jpeg.raw_data_out = TRUE;
  jpeg.do_block_smoothing = FALSE;
  jpeg.dct_method = JDCT_ISLOW;
  jpeg.out_color_space = jpeg.jpeg_color_space;
  jpeg_start_decompress(&jpeg);
  std::vector<JpegSamples> planes;
  std::vector<std::vector<uint8_t>> strips;  // of an MCU row, with the width that libjpeg writes
  std::vector<std::vector<JSAMPROW>> rows;
  std::vector<JSAMPARRAY> arrays;
  for (int c = 0; c < jpeg.num_components; ++c) {
    const jpeg_component_info& component = jpeg.comp_info[c];
    planes.push_back({component.downsampled_width, component.downsampled_height, {}});
    const auto height = static_cast<size_t>(DCTSIZE * component.v_samp_factor);
    const size_t stride = size_t{DCTSIZE} * (component.width_in_blocks + 4);
    strips.emplace_back(stride * height);
    rows.emplace_back();
    for (size_t y = 0; y < height; ++y) rows.back().push_back(strips.back().data() + stride * y);
  }
  for (auto& of_component : rows) arrays.push_back(of_component.data());
  while (jpeg.output_scanline < jpeg.output_height) {
    jpeg_read_raw_data(&jpeg, arrays.data(), static_cast<JDIMENSION>(DCTSIZE * jpeg.max_v_samp_factor));
    for (size_t c = 0; c < planes.size(); ++c) {
      JpegSamples& plane = planes[c];
      for (const JSAMPROW row : rows[c])
        if (plane.values.size() < size_t{plane.width} * plane.height)
          plane.values.insert(plane.values.end(), row, row + plane.width);
    }
  }
  return planes;
}

std::vector<uint8_t> read_rgb(std::span<const std::byte> file, bool is_fancy) {
  Reader reader(file);
  jpeg_decompress_struct& jpeg = reader.jpeg;
  jpeg.dct_method = JDCT_ISLOW;
  jpeg.do_block_smoothing = FALSE;
  jpeg.do_fancy_upsampling = is_fancy ? TRUE : FALSE;
  jpeg.out_color_space = JCS_RGB;
  jpeg_start_decompress(&jpeg);
  std::vector<uint8_t> pixels(size_t{3} * jpeg.output_width * jpeg.output_height);
  while (jpeg.output_scanline < jpeg.output_height) {
    JSAMPROW row = pixels.data() + size_t{3} * jpeg.output_width * jpeg.output_scanline;
    jpeg_read_scanlines(&jpeg, &row, 1);
  }
  return pixels;
}

int read_colour_space(std::span<const std::byte> file) {
  return Reader(file).jpeg.jpeg_color_space;
}

}  // namespace scree::tests
