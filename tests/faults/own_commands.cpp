#include "tests/faults/own_commands.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"
#include "runtime/files/direct_file.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/chunk_source.h"
#include "runtime/stream/residency.h"
#include "runtime/stream/upload.h"
#include "tests/runtime/stream/cpu_stream.h"
#include "tools/convert/sort/sort_primitive.h"
#include "tools/gltf/source.h"

namespace scree::faults {
namespace {

constexpr uint32_t kWidth = 64, kHeight = 48;

Result<void> stream(const std::string& path, uint64_t part, uint32_t threads, const std::string& samples_path,
                    const std::string& picture_path) {
  const Result<runtime::Scene> scene = runtime::Scene::open(path, {.threads = threads, .pages = false});
  if (!scene) return scene.error();
  const std::vector<uint64_t> bytes = runtime::ChunkSource(*scene).chunk_bytes();
  const uint64_t all = std::accumulate(bytes.begin(), bytes.end(), uint64_t{0});
  const uint64_t largest = bytes.empty() ? 0 : *std::max_element(bytes.begin(), bytes.end());
  const auto stream = tests::CpuStream::create(*scene, all / part + largest + runtime::Residency::kAlignment, threads);
  if (!stream) return stream.error();
  // A view of everything, a near view, and the first one again, so that chunks are evicted and loaded again.
  const kernels::ShadeOptions shade;
  for (const double distance : {4.0, 0.5, 4.0}) {
    const runtime::CameraOptions camera{
        .eye = runtime::Vec3{0, 0, distance}, .target = runtime::Vec3{0, 0, 0}, .width = kWidth, .height = kHeight};
    const Result<kernels::View> view = runtime::make_view(*scene, camera);
    if (!view) return view.error();
    if (const Result<runtime::StreamStats> drawn = (*stream)->draw_frame(*view, &shade); !drawn) return drawn.error();
  }
  const Result<std::vector<uint8_t>> picture = (*stream)->picture(1);
  if (!picture) return picture.error();
  if (Result<void> written = runtime::write_visibility(samples_path, (*stream)->samples()); !written) return written;
  return runtime::write_png(picture_path, {kWidth, kHeight, 4, *picture});
}

Result<void> write_file(const std::string& path, std::span<const std::byte> bytes) {
  Result<format::PartFile> out = format::PartFile::create(path);
  if (!out) return out.error();
  if (Result<void> written = out->write_at(0, bytes); !written) return written;
  return out->commit();
}

/// A device whose memory is host memory.
class HostTarget final : public runtime::UploadTarget {
 public:
  HostTarget(uint64_t arena_bytes, const runtime::StagingSizes& sizes)
      : arena_(arena_bytes), slot_bytes_(sizes.slot_bytes), ring_(runtime::direct_memory(sizes.bytes())) {}

  std::byte* slot(uint32_t slot) override { return ring_.get() + slot * slot_bytes_; }
  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) override {
    std::memcpy(arena_.data() + to, this->slot(slot), bytes);
    return {};
  }
  Result<void> wait(uint32_t) override { return {}; }

  std::span<const std::byte> arena() const { return arena_; }

 private:
  std::vector<std::byte> arena_;
  uint64_t slot_bytes_;
  runtime::DirectMemory ring_;
};

Result<void> upload(const std::string& path, std::string_view reading_name, uint32_t threads,
                    const std::string& output) {
  const runtime::Reading reading = reading_name == "direct"     ? runtime::Reading::kDirect
                                   : reading_name == "buffered" ? runtime::Reading::kBuffered
                                                                : runtime::Reading::kMapped;
  const Result<runtime::Scene> scene =
      runtime::Scene::open(path, {.textures = false, .threads = threads, .pages = false});
  if (!scene) return scene.error();
  runtime::UploadPlan plan;
  plan.add_pages(scene->drawn_pages());
  const runtime::StagingSizes sizes = runtime::staging_for(plan, reading, threads);
  HostTarget target(plan.bytes(), sizes);
  const Result<runtime::UploadCounts> done =
      runtime::run_upload(plan, scene->file().map(), target, sizes, reading, threads);
  if (!done) return at(path, done.error());
  return write_file(output, target.arena());
}

Result<void> sort(const std::string& path, uint64_t map_vertices, uint32_t threads, const std::string& output) {
  Result<convert::SourceScene> scene = convert::import_gltf(path, {});
  if (!scene) return scene.error();
  const convert::Primitive& primitive = scene->primitives.front();
  Result<format::PartFile> made = format::PartFile::create(output + ".sorted");
  if (!made) return made.error();
  if (Result<void> hidden = made->hide(); !hidden) return hidden;
  const auto file = std::make_shared<const format::PartFile>(std::move(*made));
  const Result<convert::Primitive> copy = convert::sort_primitive(
      primitive, {0, 0, primitive.vertex_count()}, true, {threads, map_vertices}, file, 0, nullptr, [](uint64_t) {});
  if (!copy) return at(path, copy.error());
  // The output is a copy of the temporary file without its buckets.
  const Result<uint64_t> size = file->size();
  if (!size) return size.error();
  std::vector<std::byte> bytes(*size);
  if (Result<void> read = file->read_at(0, bytes); !read) return read;
  return write_file(output, bytes);
}

/// Handles a command's errors as tools/main.cpp does.
template <class Command>
int report(const char* name, const Command& command) {
  try {
    const Result<void> done = command();
    if (done) return 0;
    std::fprintf(stderr, "scree %s: %s\n", name, done.error().message.c_str());
    return exit_code(done.error().code);
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "scree: out of memory\n");
    return exit_code(ErrorCode::kMemory);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scree: unexpected: %s\n", error.what());
    return exit_code(ErrorCode::kFile);
  }
}

uint64_t number(const char* word) {
  return std::strtoull(word, nullptr, 10);
}

int stream_main(int argc, char** argv) {
  if (argc != 7) return exit_code(ErrorCode::kUsage);
  return report("stream", [&] {
    return stream(argv[2], number(argv[3]), static_cast<uint32_t>(number(argv[4])), argv[5], argv[6]);
  });
}

int upload_main(int argc, char** argv) {
  if (argc != 6) return exit_code(ErrorCode::kUsage);
  return report("upload", [&] { return upload(argv[2], argv[3], static_cast<uint32_t>(number(argv[4])), argv[5]); });
}

int sort_main(int argc, char** argv) {
  if (argc != 6) return exit_code(ErrorCode::kUsage);
  return report("sort",
                [&] { return sort(argv[2], number(argv[3]), static_cast<uint32_t>(number(argv[4])), argv[5]); });
}

}  // namespace

Main own_command(const char* name) {
  if (std::string_view(name) == "stream") return stream_main;
  if (std::string_view(name) == "upload") return upload_main;
  if (std::string_view(name) == "sort") return sort_main;
  return nullptr;
}

}  // namespace scree::faults
