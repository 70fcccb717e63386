/* scree as a library: packs glTF scenes of any size into one checked file, loads it, and draws it exactly, on a GPU or
 * on the CPU. docs/library.md explains it with examples.
 *
 * Handles. scree_file, scree_scene and scree_view are made by scree_open(), scree_load() and scree_view_create() and
 * ended by scree_close(), scree_unload() and scree_view_destroy(). A handle is a number in the form of a pointer, never
 * used twice: a call with a handle that was ended fails with SCREE_ERROR_HANDLE. A handle keeps the data that it needs.
 * So a file may be closed while its scenes are drawn, and a scene unloaded while it has views.
 *
 * Errors. Every function that can fail returns a scree_status; scree_error() then gives one line of text. A failed
 * call leaves its outputs unchanged, unless its description states otherwise. No function ends the process, prints, or
 * throws.
 * If another program cuts an open file short, reading it raises SIGBUS, as with any mapped file. Bytes that another
 * program writes into a loaded file are not checked, and may crash the process. So copy a file that others may write to
 * before you open it.
 *
 * Threads. All functions may be called from any thread. Calls with the same view wait for each other; calls with
 * different views run at the same time on the CPU, and one after the other on a GPU. A handle may be ended while
 * another thread uses it: the call of that thread is still completed. No call changes the calling thread's current CUDA
 * device.
 *
 * Structures begin with `size`, which the caller sets to sizeof. A later version of the library may have more fields.
 * It treats fields that the caller's version lacks as 0. A size below 16, above 4096 or no multiple of 8 belongs to no
 * version, and is refused (SCREE_ERROR_ARGUMENT). In options 0 always means the default. So begin with
 *     scree_load_options options = {.size = sizeof options};
 *
 * Pixels go row by row from the top left. World space is glTF's: right-handed, units as in the scene. */
#ifndef SCREE_SCREE_H
#define SCREE_SCREE_H

#include <stddef.h>
#include <stdint.h>

#define SCREE_API_VERSION 6 /* grows by 1 with every addition; existing declarations stay as they are */

#if defined(__GNUC__)
#define SCREE_API __attribute__((visibility("default")))
#else
#define SCREE_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct scree_file scree_file;     /* an open .scree file */
typedef struct scree_scene scree_scene;   /* one scene of it, loaded to be drawn */
typedef struct scree_view scree_view;     /* draws a scene, frame after frame */
typedef struct scree_memory scree_memory; /* a layer's memory, held beyond the next draw */

typedef enum scree_status {
  SCREE_OK = 0,
  SCREE_ERROR_ARGUMENT = 1,  /* a null pointer, a number out of range, options that exclude each other */
  SCREE_ERROR_FILE = 2,      /* a missing or unreadable file, no room on the disk */
  SCREE_ERROR_DATA = 3,      /* a damaged file, or one of another kind or of a newer version */
  SCREE_ERROR_DEVICE = 4,    /* no usable GPU, a failing one, not enough of its memory */
  SCREE_ERROR_MEMORY = 5,    /* not enough host memory */
  SCREE_ERROR_HANDLE = 6,    /* a handle that was ended, or is of another kind */
  SCREE_ERROR_BUFFER = 7,    /* a buffer of another size than is needed; the text has both sizes */
  SCREE_ERROR_NO_FRAME = 8,  /* the view has no frame yet, or the last draw failed */
  SCREE_ERROR_CANCELLED = 9, /* a progress function did not return 0 */
  SCREE_ERROR_INTERNAL = 10, /* an error of the library itself */
  SCREE_STATUS_32_BITS = 0x7fffffff
} scree_status;

/* The library's version, "0.2.0", and the newest SCREE_API_VERSION that it has. */
SCREE_API const char* scree_version(void);
SCREE_API uint32_t scree_api_version(void);

/* One line about the calling thread's last call that failed; "" if none has. Valid until its next failing call. */
SCREE_API const char* scree_error(void);

/* The name of a status, such as "SCREE_ERROR_FILE"; "SCREE_ERROR_INTERNAL" for a number that is no status. */
SCREE_API const char* scree_status_name(scree_status status);

/* Reports the progress of a call: `done` of `total` bytes or objects of `stage`, such as "geometry" or "encode".
 * Returns 0 to go on; any other number ends the call with SCREE_ERROR_CANCELLED. One thread at a time calls it, not
 * always the caller's, some twenty times per second. It must not call the function whose progress it reports. */
typedef int (*scree_progress)(void* user, const char* stage, uint64_t done, uint64_t total);

/* ---- Files ------------------------------------------------------------------------------------------------------- */

/* Opens a .scree file and checks its records, which takes 15 ns per record; no geometry is read. */
SCREE_API scree_status scree_open(const char* path, scree_file** file);

/* Ends a handle. Does nothing for null. */
SCREE_API scree_status scree_close(scree_file* file);

typedef struct scree_file_info {
  size_t size;
  uint64_t bytes;
  uint64_t triangles; /* stored, in all meshes */
  uint32_t scenes;
  uint32_t default_scene;
  uint32_t meshes; /* one per glTF primitive */
  uint32_t materials;
  uint32_t textures;
  uint32_t nodes;
} scree_file_info;

typedef struct scree_scene_info {
  size_t size;
  const char* name;   /* UTF-8, "" if there is none; stays until the file is closed and its scenes are unloaded */
  uint64_t triangles; /* drawn: of all instances */
  uint64_t instances;
  uint32_t cameras;
} scree_scene_info;

typedef struct scree_mesh_info {
  size_t size;
  const char* name; /* of the glTF mesh */
  uint64_t triangles;
  uint64_t vertices; /* stored */
  float box_min[3];  /* in the mesh's own units */
  float box_max[3];
  double max_position_error; /* per axis, in the mesh's own units */
  int32_t material;          /* -1: the default material */
  uint32_t attributes;       /* 1: texture coordinates, 2: colours, 4: normals, 8: triangle numbers of the source,
                                16: second texture coordinates, 32: tangents */
} scree_mesh_info;

typedef struct scree_material_info {
  size_t size;
  const char* name;
  float base_color[4]; /* linear RGBA */
  int32_t texture;     /* -1: none */
  uint32_t flags;      /* 1: double-sided, 2: unlit, 4: alpha mask, 8: alpha blend */
} scree_material_info;

typedef struct scree_camera_info {
  size_t size;
  const char* name;      /* of the camera */
  const char* node_name; /* of the node that has the camera */
  uint32_t camera;       /* number in the file; scree_camera::name accepts it too */
  uint32_t orthographic; /* 1: yes */
  double fov_degrees;    /* vertical; 0 if orthographic */
  double half_height;    /* in units, if orthographic */
  double z_near;
  double z_far;     /* 0: none */
  double world[12]; /* of the node: three rows of x, y, z, translation */
} scree_camera_info;

SCREE_API scree_status scree_get_file_info(scree_file* file, scree_file_info* info);
/* `index` is below the count in scree_file_info, and for a camera below the count in scree_scene_info. */
SCREE_API scree_status scree_get_scene_info(scree_file* file, uint32_t index, scree_scene_info* info);
SCREE_API scree_status scree_get_mesh_info(scree_file* file, uint32_t index, scree_mesh_info* info);
SCREE_API scree_status scree_get_material_info(scree_file* file, uint32_t index, scree_material_info* info);
SCREE_API scree_status scree_get_camera_info(scree_file* file, uint32_t scene, uint32_t index, scree_camera_info* info);

/* ---- Scenes ------------------------------------------------------------------------------------------------------ */

typedef enum scree_backend {
  SCREE_BACKEND_AUTO = 0, /* a GPU if one is usable and can take the scene, else the CPU */
  SCREE_BACKEND_CPU = 1,
  SCREE_BACKEND_CUDA = 2,
  SCREE_BACKEND_32_BITS = 0x7fffffff
} scree_backend;

#define SCREE_ALL_GPUS 0xffffffffu

/* Where the light of textured pictures comes from. Since version 4. */
typedef enum scree_light {
  SCREE_LIGHT_AUTO = 0,        /* in options of a load: the environment if a material has more than a base colour, or if
                                  scree_load_options::environment names one; else the camera. In options of a draw: as
                                  the scene was loaded */
  SCREE_LIGHT_CAMERA = 1,      /* from the eye, on matt surfaces */
  SCREE_LIGHT_ENVIRONMENT = 2, /* from all around */
  SCREE_LIGHT_SCENE = 3,       /* the file's own lights; SCREE_ERROR_ARGUMENT if it has none */
  SCREE_LIGHT_32_BITS = 0x7fffffff
} scree_light;

/* How pages are read for a GPU. Since version 4. */
typedef enum scree_reading {
  SCREE_READ_AUTO = 0, /* DIRECT for large files that are not in the page cache, else BUFFERED */
  SCREE_READ_MAPPED = 1,
  SCREE_READ_BUFFERED = 2, /* through the page cache */
  SCREE_READ_DIRECT = 3,   /* past the page cache */
  SCREE_READ_32_BITS = 0x7fffffff
} scree_reading;

typedef struct scree_load_options {
  size_t size;
  const char* scene; /* by name or number; null: the file's default */
  scree_backend backend;
  const char* gpu;        /* index or UUID; null: the first that can be used */
  uint32_t threads;       /* at most 4096; 0: one per processor */
  uint32_t no_textures;   /* 1: materials have only their colour */
  uint64_t device_memory; /* the most bytes of the GPU's memory for scene and pictures; chunks that do not fit are
                             streamed while frames are drawn. 0: the free memory */
  uint64_t host_memory;   /* the most bytes of pinned host memory, for copies to the GPU, and for chunks and pages of
                             textures that the GPU's memory does not hold. 0: no limit, and such chunks and pages are
                             read from the file */
  uint64_t texture_cache; /* bytes of decoded blocks of JPEG textures. 0: 64 MiB, on a GPU 256 MiB */
  uint32_t max_width;     /* size of the largest frames, whose memory device_memory then includes; 0: not included */
  uint32_t max_height;
  uint32_t max_samples; /* per pixel and axis: 1, 2 or 4 */
  scree_progress progress;
  void* user;
  uint64_t gpus; /* the number of GPUs that draw the scene together, from `gpu` on, each with a part of the picture
                    or of the scene (docs/scale.md), at most 16; SCREE_ALL_GPUS: all. 0 and 1: one. Since version 3 */
  /* Since version 4: */
  uint64_t texture_memory; /* the most bytes for pages of KTX2, DDS and JPEG textures, which are read when pixels show
                              them; the picture does not depend on it. On the CPU 0 means 2 GiB. On a GPU textures
                              that together take at most this many bytes are loaded whole; with 0 they are loaded
                              whole if the whole file fits, otherwise pages and geometry share the memory */
  const char* environment; /* a Radiance picture (.hdr) of all directions, as the light of SCREE_LIGHT_ENVIRONMENT. A
                              picture implies this light. Null: a clear sky */
  scree_light light;       /* the light of pictures, unless a draw names another. The environment is only loaded if it
                              is this light; otherwise a draw by SCREE_LIGHT_ENVIRONMENT fails */
  scree_reading reading;
  void (*warning)(void* user, const char* line); /* called for each warning about the scene, such as a damaged texture,
                                                    by the caller's thread, at the end */
  uint64_t max_shadow_size; /* the largest scree_draw_options::shadow_size, whose maps device_memory then includes, at
                               most 16384; 0: not included. Since version 6 */
} scree_load_options;

/* Loads a scene and checks every byte of it. `options` may be null. */
SCREE_API scree_status scree_load(scree_file* file, const scree_load_options* options, scree_scene** scene);
SCREE_API scree_status scree_unload(scree_scene* scene);

typedef struct scree_scene_stats {
  size_t size;
  uint64_t triangles; /* drawn: of all instances */
  uint64_t instances;
  double box_min[3]; /* of all instances, world space; min > max if nothing is drawn */
  double box_max[3];
  uint32_t on_gpu; /* 1: a GPU draws it */
  int32_t gpu;     /* its index, -1: the CPU */
  uint32_t streamed;
  uint32_t scene; /* its number in the file */
  uint64_t device_bytes;
  double load_ms;       /* geometry, textures, upload */
  const char* gpu_name; /* valid as long as the handle */
  const char* why_cpu;  /* one line: why SCREE_BACKEND_AUTO chose no GPU; "" if a GPU draws, or for other backends */
  /* Since version 4: */
  uint32_t lights;   /* the number of the file's lights that are drawn */
  scree_light light; /* the light of a draw by SCREE_LIGHT_AUTO; never SCREE_LIGHT_AUTO */
} scree_scene_stats;

SCREE_API scree_status scree_get_scene_stats(scree_scene* scene, scree_scene_stats* stats);

/* An instance, by its index: the id in the instance layer. */
typedef struct scree_instance_info {
  size_t size;
  uint32_t mesh;
  uint32_t node;
  uint32_t node_instance; /* index among the node's instances (EXT_mesh_gpu_instancing); 0 if it has none */
  int32_t material;
  uint64_t first_triangle; /* global id of its first triangle */
  double world[12];        /* three rows of x, y, z, translation */
} scree_instance_info;

SCREE_API scree_status scree_get_instance_info(scree_scene* scene, uint64_t index, scree_instance_info* info);

/* ---- Views and frames -------------------------------------------------------------------------------------------- */

/* A view draws a scene. It has buffers and, on a GPU, the set of clusters that the last frame showed. A scene may have
 * any number of views. */
SCREE_API scree_status scree_view_create(scree_scene* scene, scree_view** view);
SCREE_API scree_status scree_view_destroy(scree_view* view);

typedef enum scree_camera_kind {
  SCREE_CAMERA_DEFAULT = 0,  /* all of the scene, from the front, right and above; takes `up` and `fov_degrees` */
  SCREE_CAMERA_NAMED = 1,    /* `name`, of the file; takes `fov_degrees` */
  SCREE_CAMERA_LOOK_AT = 2,  /* `eye`, `target`, `up`, `fov_degrees` */
  SCREE_CAMERA_MATRICES = 3, /* `view`, `projection`, `z_near` */
  SCREE_CAMERA_AROUND = 4,   /* all of the scene from `turn_degrees` and `rise_degrees`; takes `up` and `fov_degrees`.
                                Since version 4 */
  SCREE_CAMERA_32_BITS = 0x7fffffff
} scree_camera_kind;

typedef struct scree_camera {
  size_t size;
  scree_camera_kind kind;
  const char* name; /* of a camera, of its node, or the camera's number */
  double eye[3];
  double target[3];
  double up[3];          /* 0,0,0: y, or -z if the camera looks along y */
  double fov_degrees;    /* vertical, 1e-9 or more and below 180; 0: 45, or the camera's own */
  uint32_t look_at_box;  /* 1: LOOK_AT looks at the middle of the scene's box, not at `target` */
  double view[16];       /* row-major: from world to camera, which looks along -z with y up; no scale */
  double projection[16]; /* row-major: from camera to clip space as in OpenGL (w = -z, depths -1 to 1), perspective or
                            orthographic, around the middle of the picture. A perspective has no far plane here */
  double z_near;         /* above 0: the near plane instead of the projection's, for other ranges of depth */
  double turn_degrees;   /* to the right of the scene's front: 90 is its right, 180 its back. Since version 4 */
  double rise_degrees;   /* above it, -90 to 90. Since version 4 */
  /* Since version 5: */
  uint32_t clips;     /* 1: only the part of the scene that lies in a box is drawn, to look inside a building; for every
                         kind of camera. Depths, ids, picks and layers are those of a scene that ends there
                         (spec/rasterization.md 14). The box moves no camera: SCREE_CAMERA_DEFAULT and
                         SCREE_CAMERA_AROUND are fitted to all of the scene */
  double clip_min[3]; /* the box's smallest corner, world space; at most clip_max on each axis */
  double clip_max[3]; /* its largest */
} scree_camera;

typedef struct scree_path_info {
  size_t size;
  uint64_t frames; /* 1 or more */
  double frames_per_second;
} scree_path_info;

/* Reads the cameras of a film from a path that `scree view` saved or a person wrote (docs/scale.md). Writes the cameras
 * of the `count` frames from `first` on into `cameras`, as SCREE_CAMERA_LOOK_AT. `scree render --path` draws the same
 * frames with the same cameras. `frames_per_second`: instead of the file's, below 1e6; 0: the file's, else 30. `info`:
 * of the whole path, may be null. With a `count` of 0 `cameras` is not read, so that a first call gives the number of
 * frames.
 * The caller sets cameras[0].size, which is the size of each camera; all other fields are written. Errors:
 * SCREE_ERROR_FILE, SCREE_ERROR_DATA (no path), SCREE_ERROR_ARGUMENT (frames that the path does not have). The caller
 * may then change the cameras, to draw a film in a box (`clips`). Since version 5. */
SCREE_API scree_status scree_cameras_of_path(const char* file, double frames_per_second, uint64_t first, uint64_t count,
                                             scree_camera* cameras, scree_path_info* info);

typedef enum scree_show {
  SCREE_SHOW_TEXTURE = 0,
  SCREE_SHOW_COLOR = 1, /* without textures */
  SCREE_SHOW_UV = 2,    /* texture coordinates */
  SCREE_SHOW_NORMAL = 3,
  SCREE_SHOW_TRIANGLE = 4, /* a colour per triangle; the next two likewise */
  SCREE_SHOW_CLUSTER = 5,
  SCREE_SHOW_MESH = 6,
  SCREE_SHOW_STAGE = 7, /* of the rasteriser */
  SCREE_SHOW_DEPTH = 8,
  SCREE_SHOW_32_BITS = 0x7fffffff
} scree_show;

enum {
  SCREE_NO_LIGHT = 1, /* surface colours alone */
  SCREE_SSAO = 2,
  SCREE_EDL = 4,     /* eye-dome lighting */
  SCREE_NO_BLEND = 8, /* blended surfaces, such as glass, are left out of the colours. Since version 4 */
  SCREE_SHADOWS = 16  /* the file's first directional light casts shadows (docs/materials.md). The view draws maps
                         of them before the frame, with 8 bytes per sample, and keeps each map until a frame needs
                         another. A batch draws its cameras one after the other. SCREE_ERROR_ARGUMENT if the light is
                         not SCREE_LIGHT_SCENE, or the file has no directional light. Since version 6 */
};

typedef struct scree_draw_options {
  size_t size;
  uint32_t width;   /* pixels; width and height times samples at most 16384. 0: 1920 */
  uint32_t height;  /* 0: 1080 */
  uint32_t samples; /* per pixel and axis: 1, 2 or 4. 0: 1 */
  scree_show show;
  uint32_t flags;      /* SCREE_NO_LIGHT, which excludes `light`, and the others */
  float background[4]; /* linear RGBA */
  float edl_strength;  /* 0: 1 */
  uint32_t edl_radius; /* pixels, at most 64. 0: 1 */
  uint32_t reserved;   /* not read */
  /* Since version 4: */
  double exposure;       /* stops, -20 to 20; without effect on SCREE_LIGHT_CAMERA */
  scree_light light;     /* SCREE_LIGHT_AUTO: as the scene was loaded */
  uint32_t blend_layers; /* the most layers of blended surfaces behind one another, at most 65535. 0: 16 */
  uint64_t shadow_size;  /* samples along the longer side of the map of SCREE_SHADOWS, 64 to 16384; a view far into
                            the scene has four maps of half the side. 0: 4096. Since version 6 */
} scree_draw_options;

/* Draws a frame and returns when its samples are drawn. `camera` and `options` may be null. A frame no larger than an
 * earlier one allocates nothing. */
SCREE_API scree_status scree_draw(scree_view* view, const scree_camera* camera, const scree_draw_options* options);

/* Draws a frame for each of `count` cameras in one call. All frames have the size of `options`. `layers`: the layers
 * that are made, one bit each, such as 1 << SCREE_COLOR; all except SCREE_SAMPLES and SCREE_LINEAR can be made. Until
 * the next draw these layers have one more dimension, the first, for the cameras. Such a layer is one block of memory,
 * on the GPU if a GPU draws. Picking is not available after a batch. Each camera may have a box of its own (`clips`); a
 * GPU then draws the batch frame by frame. On the CPU the scene's threads share the cameras. */
SCREE_API scree_status scree_draw_batch(scree_view* view, const scree_camera* cameras, uint32_t count,
                                        const scree_draw_options* options, uint32_t layers);

/* Shades the last frame again, without drawing it, with all of `options` except sizes and samples. Fails if chunks are
 * streamed. */
SCREE_API scree_status scree_shade(scree_view* view, const scree_draw_options* options);

/* In all layers except colours a pixel has the value of its nearest sample. */
typedef enum scree_layer {
  SCREE_COLOR = 0,    /* height x width x 4 uint8: 8-bit sRGB, alpha linear and not premultiplied */
  SCREE_DEPTH = 1,    /* height x width float32: from the eye's plane, in units; infinity on the background */
  SCREE_TRIANGLE = 2, /* height x width int64: id, -1 on the background */
  SCREE_INSTANCE = 3, /* height x width int32: index for scree_get_instance_info(), -1 on the background */
  SCREE_SAMPLES = 4,  /* height * samples x width * samples uint64: 28 bits of depth code over 36 of triangle id */
  SCREE_NORMAL = 5,   /* height x width x 3 float32: unit length, world space, of the front even where the back is
                         visible; 0 on the background. Like SCREE_UV it fails if chunks are streamed:
                         SCREE_ERROR_ARGUMENT */
  SCREE_UV = 6,       /* height x width x 2 float32: texture coordinates of the mesh, without the material's transform;
                         0 on the background and if the mesh has none */
  SCREE_LINEAR = 7,   /* height x width x 4 float32: the colours in linear light, premultiplied by alpha, as in an .exr;
                         only in host memory, and not if chunks are streamed. Since version 4 */
  SCREE_LAYER_32_BITS = 0x7fffffff
} scree_layer;

typedef enum scree_type {
  SCREE_UINT8 = 0,
  SCREE_FLOAT32 = 1,
  SCREE_INT64 = 2,
  SCREE_INT32 = 3,
  SCREE_UINT64 = 4,
  SCREE_TYPE_32_BITS = 0x7fffffff
} scree_type;

typedef struct scree_array {
  size_t size;
  const void* data; /* rows follow each other without gaps */
  uint64_t bytes;
  scree_type type;
  uint32_t dimensions;
  int64_t shape[4];
  int32_t gpu; /* the GPU whose memory holds `data`; -1: host memory */
} scree_array;

/* Returns a layer of the last frame in memory of the view; the first request makes it. The layer stays until the next
 * scree_draw() or scree_shade() (colours alone) or the end of the view. scree_hold() keeps the memory. */
SCREE_API scree_status scree_host_layer(scree_view* view, scree_layer layer, scree_array* array);

/* Returns it in the GPU's memory, without a copy. `stream`: a cudaStream_t of that GPU, which waits until the layer is
 * written; null: the default stream. SCREE_ERROR_DEVICE if the CPU draws. */
SCREE_API scree_status scree_device_layer(scree_view* view, scree_layer layer, void* stream, scree_array* array);

/* Holds the memory of a layer until scree_release(), also beyond the end of the view. `array`: from scree_host_layer()
 * or scree_device_layer(). Later draws write over the memory if their frames fit; larger frames take other memory.
 * SCREE_ERROR_ARGUMENT if the view has drawn into other memory since then. */
SCREE_API scree_status scree_hold(scree_view* view, const scree_array* array, scree_memory** memory);
SCREE_API scree_status scree_release(scree_memory* memory);

/* Copies a layer to host memory of the caller. `bytes`: the size of `buffer`, which must be the size of the layer. */
SCREE_API scree_status scree_read(scree_view* view, scree_layer layer, void* buffer, uint64_t bytes);

/* A block of the caller's memory for a layer of a batch. Since version 4. */
typedef struct scree_target {
  size_t size;
  void* data;     /* in the memory of the GPU that draws, else of the host; begins at a multiple of 16 bytes */
  uint64_t bytes; /* the size of the layer for all cameras; otherwise SCREE_ERROR_BUFFER */
  scree_layer layer;
  uint32_t reserved; /* not read */
} scree_target;

/* As scree_draw_batch(), but the layers are drawn into `target_count` `targets`, one per layer. The view keeps none of
 * them. `stream`: a cudaStream_t of the GPU; null: the default stream. The stream's earlier work ends before the
 * drawing begins, and its later work begins after the drawing. Not read if the CPU draws. After an error the targets
 * may have any contents. The targets must not overlap. Since version 4. */
SCREE_API scree_status scree_draw_batch_to(scree_view* view, const scree_camera* cameras, uint32_t count,
                                           const scree_draw_options* options, const scree_target* targets,
                                           uint32_t target_count, void* stream);

typedef struct scree_pick_info {
  size_t size;
  uint32_t hit; /* 0: the background; the fields below are not set */
  uint32_t mesh;
  uint32_t node;
  uint32_t node_instance;
  uint64_t instance;
  uint64_t triangle;       /* global id */
  uint64_t mesh_triangle;  /* in the mesh as stored */
  int64_t source_triangle; /* in the source's primitive; -1 if the file has no source ids */
  double depth;            /* from the eye's plane, in units */
  double position[3];      /* world space, at the pixel's middle */
} scree_pick_info;

/* Finds the triangle at the middle of a pixel of the last frame. Reads one sample. */
SCREE_API scree_status scree_pick(scree_view* view, uint32_t x, uint32_t y, scree_pick_info* info);

typedef struct scree_frame_stats {
  size_t size;
  uint32_t width; /* of the last frame, pixels */
  uint32_t height;
  uint32_t samples;
  uint64_t instances; /* after culling; with a streamed scene once for each part of the frame */
  uint64_t triangles; /* drawn after culling; the set of hidden clusters depends on threads and earlier frames */
  uint64_t clusters;
  double draw_ms;          /* the host's clock */
  double gpu_ms;           /* the GPU's clock, for the samples alone; 0: the CPU drew, or chunks were streamed */
  uint64_t streamed_bytes; /* 0 for a batch */
  uint32_t cameras;        /* of a batch, whose counts are sums; 0: no batch */
  uint32_t blended_layers; /* layers of blended surfaces, once the colours are made; for a batch the most of a frame */
  uint64_t samples_with_more_layers; /* than scree_draw_options::blend_layers; 0 until the colours are made */
  double shadow_ms; /* drawing the maps of SCREE_SHADOWS before the frame; 0: earlier maps were kept, or there are none.
                       For a batch the sum, which draw_ms includes. Since version 6 */
} scree_frame_stats;

SCREE_API scree_status scree_get_frame_stats(scree_view* view, scree_frame_stats* stats);

/* ---- Converting ----------------------------------------------------------------------------------------------------
 * Errors and warnings of a conversion name options as the program `scree convert` spells them. The spelling is given
 * in brackets at each flag and field. */

typedef enum scree_textures {
  SCREE_TEXTURES_KEEP = 0, /* JPEGs are indexed without loss, other images stay as they are */
  SCREE_TEXTURES_RAW = 1,  /* all images stay as they are */
  SCREE_TEXTURES_JPEG = 2, /* other images become JPEGs of `jpeg_quality` */
  SCREE_TEXTURES_32_BITS = 0x7fffffff
} scree_textures;

enum {
  SCREE_CONVERT_INDEXED = 1,         /* [--encoding indexed] chunks of vertices and indices instead of clusters */
  SCREE_CONVERT_FLOAT32 = 2,         /* [--positions float32] positions as they are */
  SCREE_CONVERT_NORMALS = 4,         /* [--normals always] stores all normals; else not those that equal the faces' */
  SCREE_CONVERT_SOURCE_IDS = 8,      /* [--source-ids] stores every triangle's number in the source */
  SCREE_CONVERT_REPLACE = 16,        /* [--force] replaces an existing output */
  SCREE_CONVERT_KEEP_GOING = 32,     /* [--keep-going] a damaged image becomes grey */
  SCREE_CONVERT_DROP_NONFINITE = 64, /* [--drop-nonfinite] leaves out triangles with a position that is not finite */
  SCREE_CONVERT_ALLOW_OUTSIDE = 128, /* [--allow-outside] reads files outside the folder of the source */
  SCREE_CONVERT_NO_WELD = 256,       /* [--no-weld] keeps vertices whose stored data are equal */
  SCREE_CONVERT_NO_SHARE = 512,      /* [--no-share] stores equal meshes, textures and materials several times */
  SCREE_CONVERT_GRID_SCENE = 1024,   /* [--grid scene] meshes with equal world matrices share the finest step */
  SCREE_CONVERT_BEST = 2048          /* [--clusters best] smaller files, many times slower */
};

typedef struct scree_convert_options {
  size_t size;
  uint32_t flags;
  uint32_t position_bits;  /* [--positions] per axis, 8 to 24. 0: 16 */
  double max_error;        /* [--max-error] above 0: per axis, in a mesh's own units, instead of position_bits */
  int32_t zstd_level;      /* [--zstd] 1 to 22. 0: only pages of textures' blocks, at 1. -1: no page */
  scree_textures textures; /* [--textures] */
  int32_t jpeg_quality;    /* [--textures jpeg:Q] 1 to 100. 0: 90 */
  uint32_t threads;        /* [--threads] 0: one per processor */
  uint64_t memory;         /* [--memory] bytes that the process may take. 0: 2 GiB */
  const char* exclude;     /* [--exclude] a regular expression: nodes with such names and all below them are left out */
  scree_progress progress;
  void (*warning)(void* user, const char* line); /* called for each warning by the caller's thread, at the end */
  void* user;                                    /* passed to both functions */
} scree_convert_options;

typedef struct scree_convert_report {
  size_t size;
  uint64_t input_bytes;
  uint64_t output_bytes;
  uint64_t triangles; /* stored */
  uint64_t meshes;
  double position_error; /* the largest found, per axis in a mesh's own units */
  double seconds;
  uint64_t warnings;
} scree_convert_report;

/* Packs a .gltf or .glb into a .scree file, in bounded memory. If `output` is null, it is `input` with the extension
 * .scree. After an error the disk has no new file. `options` and `report` may be null. */
SCREE_API scree_status scree_convert(const char* input, const char* output, const scree_convert_options* options,
                                     scree_convert_report* report);

#ifdef __cplusplus
}
#endif

#endif
