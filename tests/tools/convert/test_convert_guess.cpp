// A primitive of many windows is encoded while it is measured, because its document is trusted. Bytes and errors equal
// those of measuring everything first, whatever the document states.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cstdio>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/passes/encode_ahead.h"
#include "tools/convert/passes/guessed_mesh.h"
#include "tools/convert/passes/resume.h"
#include "tools/convert/passes/source_files.h"
#include "tools/convert/plan/convert_options.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

GridSpec rectangle_of(uint32_t columns, uint32_t rows, float size = 1) {
  return {.columns = columns, .rows = rows, .size = size};
}

/// Five windows, so that one thread has written some of them to the file before all are measured.
const GridSpec kGiant = rectangle_of(600, 900);
constexpr uint64_t kGiantWindows = 5;

/// Two windows.
const GridSpec kLarge = rectangle_of(370, 370);

/// in.gltf, in which the stated boxes of positions can be changed. Its length and the options stay the same.
class Model {
 public:
  explicit Model(const TempFolder& folder) : folder_(folder), maker_(std::in_place, folder.file("in.gltf")) {}
  /// One grid.
  Model(const TempFolder& folder, const GridSpec& grid) : Model(folder) {
    add("grid", maker().grid(grid));
    finish();
  }

  ModelMaker& maker() { return *maker_; }

  void add(const std::string& name, tools::GltfPrimitive primitive) { maker_->draw(name, {std::move(primitive)}); }

  void finish() {
    maker_->finish();
    maker_.reset();
    text_ = tests::read_whole(folder_.file("in.gltf"));
    text_.append(1000, ' ');
    folder_.write("in.gltf", text_);
    const SourceScene scene = must(import_gltf(folder_.file("in.gltf"), {}));
    for (const Primitive& primitive : scene.primitives) boxes_.push_back(box_of(all_values(primitive.positions)));
  }

  /// The true boxes of the positions, by primitive.
  const std::vector<Box>& boxes() const { return boxes_; }

  /// Writes one box per primitive, or none. `format`: the numbers' printf format.
  void state(const std::vector<Box>& boxes, const char* format = "%.9g") {
    static const std::string kLie = "\"min\":[0,0,0],\"max\":[0,0,0]";
    std::string text = text_;
    size_t at = 0;
    for (size_t i = 0; i < boxes_.size(); ++i) {
      at = text.find(kLie, at);
      REQUIRE(at != std::string::npos);
      const std::string stated =
          boxes.empty() ? "\"extras\":0"
                        : "\"min\":" + numbers(boxes[i].lo, format) + ",\"max\":" + numbers(boxes[i].hi, format);
      text.replace(at, kLie.size(), stated);
    }
    REQUIRE(text.size() < text_.size() + 500);
    const size_t end = text_.size();
    text.resize(std::max(end, text.size()), ' ');
    REQUIRE(text.find_last_not_of(' ') < end);
    text.resize(end);
    folder_.write("in.gltf", text);
  }

 private:
  static std::string numbers(const std::array<float, 3>& values, const char* format) {
    std::string text = "[";
    for (const float value : values) {
      char number[64];
      std::snprintf(number, sizeof number, format, static_cast<double>(value));
      text += (text.size() > 1 ? "," : "") + std::string(number);
    }
    return text + "]";
  }

  const TempFolder& folder_;
  std::optional<ModelMaker> maker_;
  std::string text_;
  std::vector<Box> boxes_;
};

/// Options with as little work per window as possible, for slow tests.
ConvertOptions fast_options_of(const TempFolder& folder) {
  ConvertOptions options = options_of(folder, "in.gltf");
  options.order = Order::kNone;
  options.weld = options.source_ids = false;
  return options;
}

/// Converts to a file of these bytes.
ConvertReport must_equal(const ConvertOptions& options, const std::string& reference) {
  const ConvertReport report = must_convert(options);
  CHECK((tests::read_whole(options.output) == reference));
  return report;
}

/// The file made by measuring everything first.
std::string reference_of(ConvertOptions options) {
  options.resume = true;
  CHECK(must_convert(options).windows_ahead == 0);
  return tests::read_whole(options.output);
}

/// Requires the same error with and without measuring everything first.
void must_fail_alike(ConvertOptions options, const std::string& words) {
  options.resume = true;
  const auto first = refusal(convert::convert(options));
  CHECK(first.message.find(words) != std::string::npos);
  options.resume = false;
  tests::must_fail(options, first.code, first.message);
}

void overwrite(const std::string& path, uint64_t offset, uint32_t value) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  REQUIRE(file >= 0);
  REQUIRE(::pwrite(file, &value, sizeof value, static_cast<off_t>(offset)) == sizeof value);
  ::close(file);
}

/// A source that cannot be read from some byte on. The error comes only when that byte is read.
class ShortSource : public ByteSource {
 public:
  ShortSource(std::shared_ptr<const ByteSource> source, uint64_t end) : source_(std::move(source)), end_(end) {}
  uint64_t size() const override { return source_->size(); }
  Result<void> read(uint64_t offset, std::span<std::byte> out) const override {
    if (offset + out.size() > end_) return Error{ErrorCode::kFile, "nothing there"};
    return source_->read(offset, out);
  }

 private:
  std::shared_ptr<const ByteSource> source_;
  uint64_t end_;
};

constexpr WindowNeeds kAnyWindow{kWindowTriangles, 3 * kWindowTriangles, uint64_t{1} << 32, 0};

/// A conversion up to the point at which everything is measured.
struct Start {
  Start(const ConvertOptions& options, SourceScene& scene, format::ContainerWriter& writer,
        const WindowNeeds& largest = kAnyWindow)
      : pool(1, nullptr),
        ahead(options, scene, pool, writer, {1, 64 << 20, 64 << 20, largest}, times, [](uint64_t) {}),
        measured(measure(scene, {true}, {true, false, false, options.normals, {}},
                         {pool, times, [](uint64_t) {}, 0, &ahead})) {
    REQUIRE(measured);
  }

  StageTimes times;
  WorkerPool pool;
  EncodeAhead ahead;
  Result<Measurement> measured;
};

}  // namespace

TEST_CASE("convert: a giant primitive is encoded by its document's bounds, or by its own if these are wrong",
          "[convert][ahead][guess]") {
  const TempFolder folder;
  Model model(folder, kGiant);
  ConvertOptions options = fast_options_of(folder);
  constexpr uint64_t kEarly = kGiantWindows - 1;  // all except the last window, with which everything is measured
  const std::string reference = reference_of(options);
  const auto check = [&](const char* what, const std::vector<Box>& boxes, uint64_t guessed, uint64_t discarded,
                         const char* format = "%.9g") {
    INFO(what << ", " << options.threads << " threads, " << options.memory << " bytes");
    model.state(boxes, format);
    const ConvertReport report = must_equal(options, reference);
    CHECK(report.windows_guessed == guessed);
    CHECK(report.windows_discarded == discarded);
    return report;
  };
  const Box right = model.boxes()[0];
  Box loose = right, small = right;
  loose.hi[1] += 3;
  small.hi[2] = 0.6f;
  options.threads = 1;
  const ConvertReport report = check("right", {right}, kEarly, 0);
  CHECK(report.windows_ahead > 0);
  CHECK(report.rates.read_bytes < 5 * report.input_bytes / 4);  // read once
  check("rounded", {right}, kEarly, 0, "%.6g");
  check("loose", {loose}, 0, kEarly);
  check("too small", {small}, 0, 2);
  check("missing", {}, 0, 0);
  options.threads = 3;
  check("right", {right}, kEarly, 0);
  check("loose", {loose}, 0, kEarly);
  options.threads = 16;  // the memory is too little for so many threads
  options.memory = uint64_t{1} << 30;
  model.state({loose});
  must_equal(options, reference);
}

TEST_CASE("convert: meshes of floats and of lattices chosen by an error are guessed", "[convert][ahead][guess]") {
  const TempFolder folder;
  Model model(folder, kLarge);
  ConvertOptions options = options_of(folder, "in.gltf");
  const bool is_float = GENERATE(true, false);
  if (is_float) {
    options.float32 = true;
  } else {
    options.max_error = 1e-4;
    options.encoding = Encoding::kClustered;
    options.zstd_level = 1;
  }
  const std::string reference = reference_of(options);
  for (const bool is_right : {true, false}) {
    std::vector<Box> stated = model.boxes();
    if (!is_right) stated[0].lo[0] -= 1;
    model.state(stated);
    const ConvertReport report = must_equal(options, reference);
    CHECK(report.windows_guessed == (is_right ? 1 : 0));
    CHECK(report.windows_discarded == (is_right ? 0 : 1));
  }
}

TEST_CASE("guessed mesh: invalid boxes and boxes without a lattice are not guessed", "[convert][guess]") {
  const TempFolder folder;
  Model model(folder, kLarge);
  ConvertOptions options = options_of(folder, "in.gltf");
  const auto guess = [&](const Box& box, const char* format = "%.9g") {
    model.state({box}, format);
    return guess_mesh(options, must(import_gltf(options.input, {})), 0, convert::Measured{});
  };
  const Box right = model.boxes()[0];
  const PlannedMesh mesh = must(guess(right));
  CHECK(mesh.record.triangle_count == 2 * kLarge.columns * kLarge.rows);
  CHECK(inside(right, mesh.plan.box));
  CHECK_FALSE(guess(right, "1e300"));
  Box turned = right;
  std::swap(turned.lo, turned.hi);
  CHECK_FALSE(guess(turned));
  Box huge = right;
  huge.hi[0] = 3e38f;
  CHECK(guess(huge));
  options.max_error = 1e-4;
  CHECK(guess(right));
  CHECK_FALSE(guess(huge));

  // The two primitives use the same vertices, whose box fits neither primitive.
  ModelMaker maker(folder.file("in.gltf"));
  const tools::GltfPrimitive half = maker.grid(kLarge);
  maker.draw("halves", {half, half});
  maker.finish();
  const SourceScene scene = must(import_gltf(options.input, {}));
  REQUIRE(scene.primitives.size() == 2);
  for (const Primitive& primitive : scene.primitives) CHECK_FALSE(primitive.stated_box);

  // Boxes of integers are stated as the stored integers.
  Accessor accessor{.type = ComponentType::kInt16};
  CHECK(float_of(accessor, -300) == -300);
  accessor.normalized = true;
  CHECK(float_of(accessor, -32768) == -1);
  CHECK(float_of(accessor, 32767) == 1);
  accessor.type = ComponentType::kUint8;
  CHECK(float_of(accessor, 51) == 51.0f / 255.0f);
}

TEST_CASE("convert: errors late in a giant primitive are the same as without guessing", "[convert][ahead][guess]") {
  const TempFolder folder;
  Model model(folder, kLarge);
  ConvertOptions options = options_of(folder, "in.gltf");
  options.threads = 1;
  std::vector<Box> stated = model.boxes();
  stated[0].hi[1] += GENERATE(0.0f, 3.0f);
  model.state(stated);
  const uint64_t vertices = (kLarge.columns + 1) * (kLarge.rows + 1), corners = 6 * kLarge.columns * kLarge.rows;
  const std::string bin = folder.file("in.bin");
  SECTION("a position") {
    overwrite(bin, 12 * (vertices - 5) + 4, std::bit_cast<uint32_t>(std::numeric_limits<float>::quiet_NaN()));
    must_fail_alike(options, "position (");
    options.drop_nonfinite = true;
    const std::string reference = reference_of(options);
    const ConvertReport report = must_equal(options, reference);
    CHECK(report.windows_guessed == 0);
    CHECK(report.windows_discarded == 1);
  }
  SECTION("an index") {
    overwrite(bin, 12 * vertices + 4 * (corners - 7), 0x7fffffff);
    must_fail_alike(options, "index 2147483647 at element " + std::to_string(corners - 7));
  }
}

TEST_CASE("convert: guesses hold for colours that begin white, and for repeated meshes", "[convert][ahead][guess]") {
  const TempFolder folder;
  Model model(folder);
  const uint64_t vertices = uint64_t{kLarge.columns + 1} * (kLarge.rows + 1);
  std::vector<float> colors(4 * vertices, 1.0f);
  const auto colored = [&](float size) {
    tools::GltfPrimitive primitive = model.maker().grid(rectangle_of(kLarge.columns, kLarge.rows, size));
    primitive.attributes.emplace_back("COLOR_0", model.maker().floats(colors, tools::GltfType::kVec4));
    return primitive;
  };
  model.add("white", colored(1));
  colors[1] = 0.5f;
  model.add("coloured", colored(2));
  model.add("coloured again", colored(2));
  colors[1] = 1.0f;
  colors[4 * vertices - 2] = 0.5f;
  model.add("nearly white", colored(3));
  model.add("after one that was lost", colored(4));
  model.finish();
  ConvertOptions options = options_of(folder, "in.gltf");
  const std::string reference = reference_of(options);
  model.state(model.boxes());
  const ConvertReport report = must_equal(options, reference);
  CHECK(report.meshes == 4);
  CHECK(report.windows_guessed == 2);  // one window of each except the last, and of none that may repeat another
  CHECK(report.windows_discarded == 1);
}

TEST_CASE("convert: sorting a primitive discards its guesses", "[convert][ahead][guess][sort]") {
  const TempFolder folder;
  Model model(folder);
  model.add("large", model.maker().grid(kLarge));
  constexpr uint32_t kSide = 400;
  model.add("shuffled", shuffled_squares(model.maker(), kSide));
  model.add("last", model.maker().grid(rectangle_of(20, 20)));
  model.finish();
  ConvertOptions options = options_of(folder, "in.gltf");
  const std::string reference = reference_of(options);
  model.state(model.boxes());
  for (const uint32_t threads : {1u, 3u}) {
    options.threads = threads;
    const ConvertReport report = must_equal(options, reference);
    CHECK(report.windows_guessed == 1);
    CHECK(report.windows_discarded == 1);
    CHECK(report.sorted_triangles == 2 * kSide * kSide);
  }
}

TEST_CASE("encode ahead: nothing is left of a giant primitive that fails while it is encoded", "[convert][guess]") {
  const TempFolder folder;
  Model model(folder);
  GridSpec spec = rectangle_of(600, 1200);
  spec.normal = true;
  model.add("giant", model.maker().grid(spec));
  model.finish();
  model.state(model.boxes());
  ConvertOptions options = fast_options_of(folder);
  options.normals = convert::Normals::kAlways;
  SourceScene scene = must(import_gltf(options.input, {}));
  Accessor& normals = *scene.primitives[0].normal;
  // The vertex lies in the first or second window, which must be encoded before the last one is measured.
  const uint64_t vertex = GENERATE(60000, 200000);
  normals.source = std::make_shared<ShortSource>(normals.source, normals.offset + 12 * vertex);
  format::ContainerWriter writer = must(format::ContainerWriter::create(options.output));
  Start start(options, scene, writer);
  EncodeAhead::Written written = must(start.ahead.finish());
  CHECK(start.ahead.is_stopped());
  CHECK(written.windows.empty());
  CHECK_FALSE(written.page.is_open);
  CHECK(writer.page_count() == 0);
}

TEST_CASE("encode ahead: windows of a giant primitive without memory for them are not encoded", "[convert][guess]") {
  const TempFolder folder;
  Model model(folder, kGiant);
  model.state(model.boxes());
  const ConvertOptions options = fast_options_of(folder);
  WindowNeeds largest = kAnyWindow;
  (GENERATE(true, false) ? largest.vertices : largest.span) = 100000;
  CAPTURE(largest.vertices, largest.span);
  SourceScene scene = must(import_gltf(options.input, {}));
  format::ContainerWriter writer = must(format::ContainerWriter::create(options.output));
  Start start(options, scene, writer, largest);
  const EncodeAhead::Written written = must(start.ahead.finish());
  CHECK(start.ahead.is_stopped());
  CHECK(written.windows.empty());
  CHECK(written.discarded == 0);
}

TEST_CASE("convert --resume: continues after a right or a wrong guess", "[convert][resume][guess]") {
  const TempFolder folder;
  Model model(folder, kGiant);
  ConvertOptions options = fast_options_of(folder);
  const std::string reference = reference_of(options);
  std::vector<Box> stated = model.boxes();
  const bool is_right = GENERATE(true, false);
  if (!is_right) stated[0].hi[1] += 3;
  model.state(stated);
  {  // as if the process were killed
    SourceScene scene = must(import_gltf(options.input, {}));
    format::ContainerWriter writer = must(format::ContainerWriter::create(options.output));
    writer.keep_part();
    writer.keep_log(part_id(describe_options(options), source_files(options.input, scene), {}), 64 << 20);
    Start start(options, scene, writer);
    EncodeAhead::Written written = must(start.ahead.finish());
    CHECK(written.discarded == (is_right ? 0 : kGiantWindows - 1));
    CHECK(written.windows.size() == kGiantWindows);
  }
  options.resume = true;
  const ConvertReport report = must_convert(options);
  CHECK(report.resumed_pages >= 5);
  CHECK(report.warnings.empty());
  CHECK((tests::read_whole(options.output) == reference));
}
