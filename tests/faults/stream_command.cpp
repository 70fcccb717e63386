#include "tests/faults/stream_command.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <new>
#include <numeric>
#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/camera.h"
#include "runtime/chunk_source.h"
#include "runtime/image.h"
#include "runtime/residency.h"
#include "runtime/scene.h"
#include "runtime/stream_cpu.h"

namespace scree::faults {
namespace {

constexpr uint32_t kWidth = 64, kHeight = 48;

Result<void> draw(const std::string& path, uint64_t part, uint32_t threads, const std::string& samples_path,
                  const std::string& picture_path) {
  const Result<runtime::Scene> scene = runtime::Scene::open(path, {.threads = threads, .pages = false});
  if (!scene) return scene.error();
  const std::vector<uint64_t> bytes = runtime::ChunkSource(*scene).chunk_bytes();
  const uint64_t all = std::accumulate(bytes.begin(), bytes.end(), uint64_t{0});
  const uint64_t largest = bytes.empty() ? 0 : *std::max_element(bytes.begin(), bytes.end());
  const auto stream =
      runtime::CpuStream::create(*scene, all / part + largest + runtime::Residency::kAlignment, threads);
  if (!stream) return stream.error();
  // All of it, and then what is near, and back: chunks give way and come again.
  const kernels::ShadeOptions shade;
  for (const double distance : {4.0, 0.5, 4.0}) {
    runtime::CameraOptions camera;
    camera.width = kWidth;
    camera.height = kHeight;
    camera.eye = runtime::Vec3{0, 0, distance};
    camera.target = runtime::Vec3{0, 0, 0};
    const Result<kernels::View> view =
        runtime::make_view(scene->container(), scene->scene_index(), scene->view(), camera);
    if (!view) return view.error();
    if (const Result<runtime::StreamStats> drawn = (*stream)->draw_frame(*view, &shade); !drawn) return drawn.error();
  }
  const Result<runtime::Picture> picture = (*stream)->picture(1);
  if (!picture) return picture.error();
  if (Result<void> written = runtime::write_visibility(samples_path, (*stream)->samples()); !written) return written;
  return runtime::write_png(picture_path, picture->width, picture->height, picture->channels, picture->pixels);
}

}  // namespace

int stream_main(int argc, char** argv) {
  if (argc != 7) return 1;
  try {
    const Result<void> done = draw(argv[2], std::strtoul(argv[3], nullptr, 10),
                                   static_cast<uint32_t>(std::strtoul(argv[4], nullptr, 10)), argv[5], argv[6]);
    if (done) return 0;
    std::fprintf(stderr, "scree stream: %s\n", done.error().message.c_str());
    return exit_code(done.error().code);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "scree: out of memory\n");
    return exit_code(ErrorCode::kMemory);
  }
}

}  // namespace scree::faults
