// Runs every command with each call failing once (for files, memory and the GPU), and with reads and writes that stop
// half way, by scree_faults.
#include <algorithm>
#include <filesystem>
#include <string>
#include <thread>

#include "runtime/draw/device_scene.h"
#include "tests/faults/fault_inputs.h"
#include "tests/gpu.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/run_program.h"

namespace scree::tests {
namespace {

struct Job {
  const char* outputs;
  const char* command;
  bool only_maps = false;  // reads and writes files only through a map
};

// If memory for compressing a page is short, the page stays raw (format::seal_page).
constexpr Job kConvert[] = {
    {"out.scree", "convert in.gltf -o out.scree --force --normals --quiet --threads 1"},
    {"~out.scree", "convert in.gltf -o out.scree --force --encoding clustered --zstd 3 --quiet --threads 2"},
    {"out.scree", "convert in.gltf -o out.scree --quiet --threads 1"},
    {"out.scree", "convert in.gltf -o out.scree --force --textures jpeg:80 --max-error 1e-3 --quiet --threads 1"},
};
// For the .part of an interrupted run. The first job compresses pages, which may stay raw here too.
constexpr Job kResume[] = {
    {"~out.scree", "convert in.gltf -o out.scree --force --resume --zstd 3 --quiet --threads 2"},
    {"out.scree",
     "convert in.gltf -o out.scree --force --resume --encoding clustered --max-error 1e-3 --normals --quiet --threads "
     "1"},
};
// Only calls after the temporary file for sorting is made, from the unlink that removes its name on.
constexpr Job kSort[] = {{"out.scree", "convert scattered.gltf -o out.scree --force --normals --quiet --threads 1"}};
// A primitive that is encoded while it is measured, with as little work per window as possible. Only calls from the
// ftruncate on that empties the opened output.
constexpr Job kGuess[] = {
    {"out.scree",
     "convert giant.gltf -o out.scree --force --order none --no-weld --chunk-triangles 65536 --positions 8 --encoding "
     "indexed "
     "--quiet --threads 1"},
    {"out.scree",
     "convert lying.gltf -o out.scree --force --order none --no-weld --chunk-triangles 65536 --positions 8 --encoding "
     "indexed "
     "--quiet --threads 1"},
};
// Triangles are read three times, since memory holds only this many vertices' new numbers. Buckets are written whenever
// they are full.
constexpr Job kSortInPasses[] = {{"out", "sort shuffled.gltf 1000 1 out"}, {"out", "sort shuffled.gltf 1000 2 out"}};
constexpr Job kReaders[] = {
    {"", "inspect packed.scree --verify --threads 2", true},
    {"", "inspect in.scree --json", true},
    {"out.glb", "export in.scree -o out.glb --force --quiet --threads 1"},
    {"out.gltf+out.bin+out_jpeg.jpg+out_png.png", "export in.scree -o out.gltf --force --quiet --threads 2"},
    {"out.gltf+out.bin+out_jpeg.jpg+out_png.png", "export in.scree -o out.gltf --quiet --threads 1"},
    {"", "compare in.scree in.gltf --size 24x16 --threads 1"},
    // PNGs by one thread: in one of a thousand runs with two, ISA-L gives other bytes of the same picture.
    {"out.png,flip.png", "compare in.scree in.gltf --size 24x16 -o out.png --force --flip flip.png --threads 1"},
    {"out.png", "compare a.vis b.vis --of in.scree --size 24x16 -o out.png --force --threads 1"},
    {"out.png", "compare a.vis b.vis --of in.scree --of coarse.scree --size 24x16 -o out.png --force --threads 1"},
    {"out.png", "compare a.png b.png -o out.png --force --threads 1"},
    {"", "inspect coarse.scree --source in.gltf --threads 1"},
    {"out.png,out.pfm,normals.pfm,uvs.pfm,out.bin",
     "render in.scree --force -o out.png --depth out.pfm --normals normals.pfm --uvs uvs.pfm --visbuffer out.bin "
     "--size 24x16 --ssao --pick 12,8 --backend cpu --quiet --threads 1"},
    {"out.png", "render packed.scree --force -o out.png --size 24x16 --samples 2 --backend cpu --quiet --threads 1"},
    // The pool has room for one of two pages, which threads read.
    {"~out.png",
     "render blocks.scree --force -o out.png --size 200x120 --texture-memory 30KiB --backend cpu --quiet --threads 2"},
};
#if defined(SCREE_HAS_EXR)
// Only for calls for files: OpenEXR 3.1 may wait for ever if memory runs out while it writes.
constexpr Job kExr[] = {
    {"out.exr", "render in.scree --force -o out.exr --size 24x16 --edl --backend cpu --quiet --threads 1"},
};
#endif
constexpr Job kDevice[] = {
    {"out.png,out.bin",
     "render in.scree --force -o out.png --visbuffer out.bin --size 640x480 --ssao --edl --pick 12,8 --backend cuda "
     "--quiet "
     "--threads 2"},
    {"out.png", "render packed.scree --force -o out.png --size 640x480 --samples 2 --backend cuda --quiet --threads 2"},
};

// Past the page cache, if the file system supports that, and through it. Raw and compressed pages.
constexpr Job kUpload[] = {
    {"out", "upload in.scree direct 1 out"},
    {"out", "upload packed.scree direct 2 out"},
    {"out", "upload in.scree buffered 2 out"},
};

// The same for pages of several blocks, where a read past the page cache may stop after one block.
constexpr Job kUploadBlocks[] = {
    {"out", "upload shuffled.scree direct 1 out"},
    {"out", "upload shuffled_packed.scree direct 2 out"},
    {"out", "upload shuffled.scree buffered 2 out"},
};

// Draws frames from a pool that holds a third of the chunks, while a thread reads others.
constexpr Job kStream[] = {
    {"out.bin,out.png", "stream many.scree 3 1 out.bin out.png"},
    {"out.bin,out.png", "stream many_packed.scree 3 2 out.bin out.png"},
};

template <size_t kCount>
void check_all(const std::string& kind, const std::string& which, const Job (&jobs)[kCount],
               const std::string& options = "") {
  FaultInputs inputs;
  for (const Job& job : jobs) inputs.check(kind, which, job.outputs, job.command, options);
}

/// Tests one call per site, and all calls.
template <size_t kCount>
void check_short(FaultInputs& inputs, const Job (&jobs)[kCount], const std::string& options = "") {
  for (const Job& job : jobs)
    for (const char* which : {SCREE_FAULT_SHORT_SITES, "every"})
      if (!job.only_maps) inputs.check("short", which, job.outputs, job.command, options);
}

/// The option for parallel runs.
std::string on_all_cores() {
  return "-j " + std::to_string(std::max(1u, std::thread::hardware_concurrency()));
}

void check_stream(const std::string& kind, const std::string& which, const std::string& options = "") {
  FaultInputs inputs;
  inputs.add_many();
  for (const Job& job : kStream) inputs.check(kind, which, job.outputs, job.command, options + " -p -s 2");
}

/// Checks that both outcomes of a guess are tested: one guess is right, and for the other a page is removed from the
/// file again.
void must_guess(const TempFolder& folder) {
  for (const bool is_right : {true, false}) {
    convert::ConvertOptions options = options_of(folder, is_right ? "giant.gltf" : "lying.gltf");
    options.order = convert::Order::kNone;
    options.weld = options.source_ids = false;
    options.chunk_triangles = 65536;
    options.position_bits = 8;
    options.encoding = convert::Encoding::kIndexed;
    options.threads = 1;
    const convert::ConvertReport report = must_convert(options);
    CHECK(report.windows_guessed == (is_right ? 4 : 0));
    CHECK(report.windows_discarded == (is_right ? 0 : 4));
    CHECK((report.rates.written_bytes > report.output_bytes) == !is_right);
  }
}

void check_guess(const std::string& kind, const std::string& which, const std::string& options = "") {
  FaultInputs inputs;
  inputs.add_giant();
  must_guess(inputs.folder());
  // Threads decide whether a window is encoded before the next one is measured. So the n-th call varies.
  for (const Job& job : kGuess) inputs.check(kind, which + "@ftruncate", job.outputs, job.command, options + " -s 2");
}

// Starting with a GPU takes longer than everything else, so each process makes many runs.
constexpr const char* kOnGpu = "-p -j 4";
// The number of calls and their order depend on when loads are done.
constexpr const char* kStreamedOnGpu = "-p -j 4 -s 4";

TEST_CASE("faults: every call for a file fails once while converting", "[faults]") {
  check_all("file", SCREE_FAULT_FILE_CALLS, kConvert);
}
TEST_CASE("faults: every call for a file fails once while a giant primitive is measured", "[faults][guess]") {
  check_guess("file", "all" SCREE_FAULT_GUESS_STEP);
}
TEST_CASE("faults: every place that takes memory fails once while a giant primitive is measured", "[faults][guess]") {
  check_guess("memory", "sites" SCREE_FAULT_GUESS_STEP);
}
TEST_CASE("faults: every call for a file fails once while a conversion is resumed", "[faults][resume]") {
  check_all("file", SCREE_FAULT_FILE_CALLS, kResume, "-r");
}
TEST_CASE("faults: every place that takes memory fails once while a conversion is resumed", "[faults][resume]") {
  check_all("memory", SCREE_FAULT_SITES, kResume, "-r");
}
TEST_CASE("faults: every call for a file fails once while sorting", "[faults]") {
  check_all("file", SCREE_FAULT_SORT_CALLS "@unlink", kSort);
}
TEST_CASE("faults: every place that takes memory fails once while sorting", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES "@unlink", kSort);
}
TEST_CASE("faults: every call for a file fails once while sorting in passes", "[faults]") {
  check_all("file", SCREE_FAULT_FILE_CALLS "@unlink", kSortInPasses);
}
TEST_CASE("faults: every place that takes memory fails once while sorting in passes", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES "@unlink", kSortInPasses);
}
TEST_CASE("faults: every call for a file fails once while reading", "[faults]") {
  check_all("file", SCREE_FAULT_FILE_CALLS, kReaders);
#if defined(SCREE_HAS_EXR)
  check_all("file", SCREE_FAULT_FILE_CALLS, kExr);
#endif
}
TEST_CASE("faults: every place that takes memory fails once while converting", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES, kConvert);
}
TEST_CASE("faults: every place that takes memory fails once while reading", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES, kReaders);
}
TEST_CASE("faults: every call for a file fails once while pages are uploaded", "[faults]") {
  check_all("file", "all", kUpload);
}
TEST_CASE("faults: every place that takes memory fails once while pages are uploaded", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES, kUpload);
}
TEST_CASE("faults: reads and writes move half of the bytes while converting", "[faults][short]") {
  FaultInputs inputs;
  check_short(inputs, kConvert);
  check_short(inputs, kSort);
  check_short(inputs, kSortInPasses);
}
TEST_CASE("faults: reads and writes move half of the bytes while a giant primitive is measured", "[faults][short]") {
  FaultInputs inputs;
  inputs.add_giant();
  must_guess(inputs.folder());
  for (const Job& job : kGuess) inputs.check("short", "every", job.outputs, job.command);
}
TEST_CASE("faults: reads and writes move half of the bytes while a conversion is resumed", "[faults][short][resume]") {
  FaultInputs inputs;
  check_short(inputs, kResume, "-r");
}
TEST_CASE("faults: reads and writes move half of the bytes while reading", "[faults][short]") {
  FaultInputs inputs;
  check_short(inputs, kReaders);
}
TEST_CASE("faults: reads and writes move half of the bytes while pages are uploaded", "[faults][short]") {
  FaultInputs inputs;
  inputs.add_shuffled();
  check_short(inputs, kUploadBlocks);
}
TEST_CASE("faults: reads and writes move half of the bytes while frames are streamed", "[faults][short][stream]") {
  check_stream("short", "every");
}
// Takes hours of one core, so all cores make runs.
TEST_CASE("faults: every call fails once while sorting", "[.][faults-all]") {
  check_all("file", "all", kSort, on_all_cores());
  check_all("memory", "all", kSort, on_all_cores());
}
TEST_CASE("faults: every call for memory fails once while converting", "[.][faults-all]") {
  check_all("memory", "all", kConvert, on_all_cores());
}
TEST_CASE("faults: every call for memory fails once while a conversion is resumed", "[.][faults-all]") {
  check_all("memory", "all", kResume, "-r " + on_all_cores());
}
TEST_CASE("faults: every call for memory fails once while sorting in passes", "[.][faults-all]") {
  check_all("memory", "all@unlink", kSortInPasses, on_all_cores());
}
TEST_CASE("faults: every call for memory fails once while reading", "[.][faults-all]") {
  check_all("memory", "all", kReaders, on_all_cores());
}
TEST_CASE("faults: every call for memory fails once while pages are uploaded", "[.][faults-all]") {
  check_all("memory", "all", kUpload, on_all_cores());
}
TEST_CASE("faults: every call fails once while a giant primitive is measured", "[.][faults-all]") {
  check_guess("file", "all", on_all_cores());
  check_guess("memory", "all", on_all_cores());
}
TEST_CASE("faults: every call fails once while frames are streamed", "[.][faults-all]") {
  check_stream("file", "all", on_all_cores());
  check_stream("memory", "all", on_all_cores());
}
TEST_CASE("faults: every call for a file fails once while frames are streamed", "[faults][stream]") {
  check_stream("file", SCREE_FAULT_STREAM_CALLS);
}
TEST_CASE("faults: every place that takes memory fails once while frames are streamed", "[faults][stream]") {
  check_stream("memory", SCREE_FAULT_SITES);
}
TEST_CASE("faults: every CUDA call fails once", "[cuda][faults]") {
  if (has_gpu()) check_all("device", "all", kDevice, kOnGpu);
}
TEST_CASE("faults: every call fails once while two GPUs draw", "[cuda][gpus][faults]") {
  if (!has_gpu()) return;
  const EmulatedGpus emulated("9.0,9.0");
  if (!has_gpus(2)) return;
  FaultInputs inputs;
  inputs.add_many(12);  // more than one page
  // With memory for all pages the GPUs divide the picture. With slightly less memory they share the pages.
  const runtime::Scene scene = must_load(inputs.folder().file("many.scree"), {.threads = 2, .pages = false});
  kernels::ShadeOptions shade{.show = kernels::Show::kNormal};
  const auto alone = runtime::DeviceScene::upload(scene, 0, 2, runtime::Reading::kAuto, runtime::kDeviceTextureCache, 0,
                                                  {64, 96, 1, &shade});
  REQUIRE(alone);
  const uint64_t all_pages = alone->stats().device_bytes + runtime::DeviceScene::view_bytes(scene, {});
  for (const uint64_t budget : {all_pages, all_pages - (1 << 16)}) {
    const std::string command =
        "render many.scree --force -o out.png --visbuffer out.bin --size 64x96 --eye 0,0,2 --target 0,0,0 --frames 2 "
        "--show normal --backend cuda --gpus 2 --quiet --threads 2 --device-memory " +
        std::to_string(budget);
    inputs.check("device", SCREE_FAULT_FILE_CALLS, "out.png,out.bin", command, kStreamedOnGpu);
    inputs.check("memory", SCREE_FAULT_SITES, "out.png,out.bin", command, kStreamedOnGpu);
  }
}
TEST_CASE("faults: every call for a file fails once while a GPU draws", "[cuda][faults]") {
  if (has_gpu()) check_all("file", "all", kDevice, kOnGpu);
}
TEST_CASE("faults: every place that takes memory fails once while a GPU draws", "[cuda][faults]") {
  if (has_gpu()) check_all("memory", "sites", kDevice, kOnGpu);
}
TEST_CASE("faults: every call fails once while a GPU streams frames", "[cuda][faults][stream]") {
  if (!has_gpu()) return;
  FaultInputs inputs;
  inputs.add_many(12);  // the pages must take more memory than streaming needs
  const std::string log = inputs.folder().file("log.txt");
  for (const std::string file : {"many.scree", "many_packed.scree"}) {
    const std::string path = inputs.folder().file(file);
    const ProgramRun refused = run_program(
        {"render", path, "--backend", "cuda", "--device-memory", "1", "--size", "64x48", "-o", path + ".png"}, log);
    // The budget has room for a third of the chunks.
    const uint64_t budget = least_device_memory(refused.output) + std::filesystem::file_size(path) / 3;
    const std::string common =
        " --force -o out.png --visbuffer out.bin --size 64x48 --eye 0,0,2 --target 0,0,0 --frames 2 "
        "--backend cuda --quiet --threads 2 --device-memory " +
        std::to_string(budget);
    // A part of the pages comes from the page cache and the rest from pinned memory: the budget has room for the
    // picture's buffers and a third of the chunks.
    const uint64_t picture = 64 * 48 * (sizeof(uint64_t) + 3 + sizeof(uint32_t));
    const ProgramRun no_room =
        run_program({"render", path, "-o", path + ".png", "--visbuffer", path + ".bin", "--size", "64x48", "--backend",
                     "cuda", "--device-memory", std::to_string(budget), "--host-memory", std::to_string(picture + 1)},
                    log);
    const uint64_t some = picture + least_device_memory(no_room.output) + std::filesystem::file_size(path) / 3;
    for (const std::string& host : {std::string("0"), std::to_string(some)}) {
      const std::string command = "render " + file + common + " --host-memory " + host;
      const ProgramRun streamed = run_program(
          {"render", path, "-f", "-o", path + ".png", "--size", "64x48", "--eye", "0,0,2", "--target", "0,0,0",
           "--backend", "cuda", "--device-memory", std::to_string(budget), "--host-memory", host, "--stats"},
          log);
      CAPTURE(streamed.output);
      REQUIRE(streamed.output.find(" batches") != std::string::npos);
      inputs.check("device", "all", "out.png,out.bin", command, kStreamedOnGpu);
      if (host != "0") continue;
      inputs.check("file", "all", "out.png,out.bin", command, kStreamedOnGpu);
      inputs.check("memory", "sites", "out.png,out.bin", command, kStreamedOnGpu);
    }
  }
}

}  // namespace
}  // namespace scree::tests
