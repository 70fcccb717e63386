/* consumer_c MODEL.glb FOLDER: packs, loads and draws, in C. */
#include <scree/scree.h>

#include <stdio.h>
#include <string.h>

static int failed(const char* what) {
  fprintf(stderr, "%s: %s\n", what, scree_error());
  return 1;
}

int main(int argc, char** argv) {
  char path[4096];
  scree_convert_options convert = {.size = sizeof convert, .flags = SCREE_CONVERT_REPLACE};
  scree_convert_report report = {.size = sizeof report};
  scree_load_options load = {.size = sizeof load, .backend = SCREE_BACKEND_CPU};
  scree_draw_options draw = {.size = sizeof draw, .width = 64, .height = 48, .background = {0, 0, 0, 1}};
  scree_array color = {.size = sizeof color};
  scree_file* file = NULL;
  scree_scene* scene = NULL;
  scree_view* view = NULL;
  if (argc != 3) return 2;
  snprintf(path, sizeof path, "%s/consumer.scree", argv[2]);
  if (scree_convert(argv[1], path, &convert, &report) != SCREE_OK) return failed("convert");
  if (scree_open(path, &file) != SCREE_OK) return failed("open");
  if (scree_load(file, &load, &scene) != SCREE_OK) return failed("load");
  if (scree_view_create(scene, &view) != SCREE_OK) return failed("view");
  if (scree_draw(view, NULL, &draw) != SCREE_OK) return failed("draw");
  if (scree_host_layer(view, SCREE_COLOR, &color) != SCREE_OK) return failed("layer");
  {
    const unsigned char* pixels = color.data;
    unsigned long sum = 0;
    uint64_t i;
    for (i = 0; i < color.bytes; ++i) sum += pixels[i];
    printf("scree %s: %llu triangles, %d x %d, sum %lu\n", scree_version(), (unsigned long long)report.triangles,
           (int)color.shape[1], (int)color.shape[0], sum);
  }
  scree_view_destroy(view);
  scree_unload(scene);
  scree_close(file);
  return strcmp(scree_status_name(scree_close(file)), "SCREE_ERROR_HANDLE") == 0 ? 0 : failed("close");
}
