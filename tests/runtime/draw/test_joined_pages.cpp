// Split pages that a GPU joins while a scene is uploaded: the same bytes and the same errors as on the CPU.
#include <algorithm>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/common/check.h"
#include "runtime/draw/cuda_upload.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/damaged_page.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"
#include "tools/convert/convert.h"

#if defined(SCREE_EMULATED_CUDA)
#include "tests/emulator/machine.h"
#endif

namespace scree::tests {
namespace {

using format::SealedPage;
using namespace runtime;

constexpr uint64_t kTextureCache = 1 << 20;

Result<CudaScene> upload(const Scene& scene, Reading reading = Reading::kMapped, uint64_t budget = 0,
                         uint64_t host_memory = 0) {
  return CudaScene::upload(scene, budget, 0, 3, reading, kTextureCache, nullptr, host_memory);
}

void read(void* to, const void* from, size_t bytes) {
  must(kernels::cuda_check(cudaMemcpy(to, from, bytes, cudaMemcpyDeviceToHost), "a test"));
}

uint64_t split_pages(const Scene& scene) {
  uint64_t count = 0;
  for (uint64_t i = 0; i < scene.drawn_pages().size(); ++i)
    count += scene.drawn_pages().record(i).codec == format::PageCodec::kSplit;
  return count;
}

/// Whether the GPU has the bytes of all drawn pages.
bool has_pages(const CudaScene& copy, const Scene& scene) {
  std::vector<const std::byte*> pages(scene.container().pages().size());
  read(pages.data(), copy.view().pages, pages.size() * sizeof pages[0]);
  for (uint64_t i = 0; i < scene.drawn_pages().size(); ++i) {
    const uint32_t page = scene.drawn_pages().page(i);
    std::vector<std::byte> scratch;
    const auto expected = must(scene.container().load_page(page, scratch));
    std::vector<std::byte> found(expected.size());
    read(found.data(), pages[page], found.size());
    if (!std::equal(found.begin(), found.end(), expected.begin())) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("a GPU joins the split pages of a scene", "[cuda][upload]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  PagedScene paged{.zstd_every = 2};
  for (const uint64_t page_bytes : {9000, 40000}) {
    paged.page_bytes = page_bytes;
    paged.write(folder.file("a.scree"), clustered_meshes(60));
    const Scene scene = must_load(folder.file("a.scree"), {.pages = false});
    REQUIRE(split_pages(scene) > 1);
    for (const Reading reading : {Reading::kMapped, Reading::kBuffered, Reading::kDirect}) {
      if (kEmulatesGpu && reading == Reading::kDirect) continue;  // its pinned memory is not page-aligned
      const CudaScene copy = must(upload(scene, reading));
      CHECK(copy.stats().counts.joined_pages == split_pages(scene));
      CHECK(has_pages(copy, scene));
    }
    // If there is no memory for joining, the CPU joins the pages.
    const uint64_t least = CudaScene::device_bytes(scene, nullptr, kTextureCache);
    const CudaScene copy = must(upload(scene, Reading::kMapped, least));
    CHECK(copy.stats().counts.joined_pages == 0);
    CHECK(has_pages(copy, scene));
#if defined(SCREE_EMULATED_CUDA)
    constexpr uint64_t kHostMemory = uint64_t{256} << 10;
    emulator::reset_peaks();
    const CudaScene small = must(upload(scene, Reading::kMapped, 0, kHostMemory));
    CHECK(small.stats().counts.joined_pages > 0);
    CHECK(has_pages(small, scene));
    CHECK(emulator::pinned_memory().peak <= kHostMemory);
#endif
  }
}

TEST_CASE("a GPU joins the split pages of real models", "[cuda][upload]") {
  if (!has_gpu()) return;
  const std::vector<std::filesystem::path> models = model_files(real_models("scenes"));
  if (models.empty()) return;
  const TempFolder folder;
  uint64_t pages = 0;
  for (const std::filesystem::path& model : models) {
    if (kEmulatesGpu && std::filesystem::file_size(model) > 500'000) continue;
    convert::ConvertOptions options;
    options.input = model.string();
    options.output = folder.file("model.scree");
    options.zstd_level = 3;
    options.existing = format::Existing::kReplace;
    if (!convert::convert(options)) continue;
    const Scene scene = must_load(options.output, {.textures = false, .pages = false});
    uint64_t triangles = 0;
    for (uint64_t m = 0; m < scene.view().mesh_count; ++m) triangles += scene.view().meshes[m].triangle_count;
    if (kEmulatesGpu && triangles > 20'000) continue;
    INFO(model);
    const CudaScene copy = must(upload(scene));
    CHECK(copy.stats().counts.joined_pages == split_pages(scene));
    if (!has_pages(copy, scene)) FAIL("other bytes");
    pages += split_pages(scene);
  }
  CHECK(pages > 5);
}

TEST_CASE("damaged split pages give the same errors on the GPU and on the CPU", "[cuda][upload]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("bad.scree");
  std::mt19937 random(3);
  PagedScene paged{.zstd_every = 2};
  paged.change = [&](uint32_t, SealedPage& page) {
    if (page.record.codec != format::PageCodec::kSplit || random() % 4 != 0) return;
    damage_split_page(page, random);
  };
  uint32_t refused = 0;
  for (int i = 0; i < 12; ++i) {
    paged.write(path, clustered_meshes(60));
    Scene scene = must_load(path, {.pages = false});
    const Result<CudaScene> copy = upload(scene);
    const Result<void> loaded = scene.load_pages(2);
    CHECK(bool(copy) == bool(loaded));
    if (copy) continue;
    ++refused;
    CHECK(copy.error().message == loaded.error().message);
    CHECK(copy.error().code == loaded.error().code);
  }
  CHECK(refused > 3);
}

}  // namespace scree::tests
