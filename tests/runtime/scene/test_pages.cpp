// Chunks of a page are checked before a copy of them is made.
#include "runtime/scene/pages.h"

#include "runtime/scene/scene.h"
#include "runtime/stream/chunk_source.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"

namespace scree::tests {

TEST_CASE("a page whose chunks take more bytes than it has is refused, also where it is streamed", "[scene][stream]") {
  const TempFolder folder;
  const std::string path = folder.file("a.scree");
  const Soup soup = sphere(8, 0.1);
  PagedScene paged{.page_bytes = 1};  // a page per chunk
  paged.change_tables = [](format::TableSet& tables) { tables.chunks[1].page = tables.chunks[0].page; };
  paged.write(path, {{soup, {}}, {soup, {}}});
  const char* const expected = "overlaps another chunk: with it the page's chunks take more than ";
  check_refusal(runtime::Scene::open(path, {}), ErrorCode::kRange, expected);

  const runtime::Scene scene = must_load(path, {.pages = false});
  runtime::ChunkSource source(scene);
  const uint64_t bytes = scene.view().chunks[0].bytes;
  std::vector<std::byte> memory(2 * bytes);
  const runtime::Residency::Place places[] = {{0, 0, bytes}, {1, bytes, bytes}};
  runtime::Workers workers(1);
  check_refusal(source.read(places, memory.data(), runtime::ChunkSource::Reader::kProcessor, workers),
                ErrorCode::kRange, expected);
}

}  // namespace scree::tests
