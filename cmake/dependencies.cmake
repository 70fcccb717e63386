# The libraries that scree uses, from the distribution's packages (scripts/setup installs them). zstd, turbojpeg, jpeg,
# png, z and xxhash are linked statically; meshoptimizer and ISA-L are packaged as shared libraries only and are installed
# beside the program, so that an installed folder runs on a machine without these packages.
find_package(Threads REQUIRED)
if(NOT SCREE_FUZZ)
  # Prefers the distribution's Python, for which packages are made, over another one on PATH.
  if(EXISTS /usr/bin/python3)
    set(Python3_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "The Python that the package scree is built for")
  endif()
  find_package(Python3 REQUIRED COMPONENTS Interpreter)  # makes man pages and completion
endif()

# Makes an installed target find its shared libraries in `folder`. It sets RPATH: the linker's default, RUNPATH, does
# not apply to the libraries that OpenEXR needs.
function(scree_find_bundled target folder)
  if(SCREE_BUNDLE_LIBRARIES)
    set_target_properties(${target} PROPERTIES INSTALL_RPATH "${folder}")
    target_link_options(${target} PRIVATE LINKER:--disable-new-dtags)
  endif()
endfunction()

# kind: STATIC, UNKNOWN (a shared library), or INTERFACE (only headers, no file).
function(scree_imported_library target kind file header)
  find_path(${target}_include NAMES ${header} REQUIRED)
  add_library(scree::${target} ${kind} IMPORTED)
  set_target_properties(scree::${target} PROPERTIES INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${${target}_include}")
  if(file)
    set_target_properties(scree::${target} PROPERTIES IMPORTED_LOCATION "${file}")
  endif()
endfunction()

function(scree_static_library target archive header)
  find_library(${target}_archive NAMES ${archive} REQUIRED)
  scree_imported_library(${target} STATIC "${${target}_archive}" ${header})
endfunction()

scree_static_library(zstd libzstd.a zstd.h)
scree_static_library(xxhash libxxhash.a xxhash.h)
scree_static_library(zlib libz.a zlib.h)
scree_static_library(png libpng.a png.h)
set_property(TARGET scree::png PROPERTY INTERFACE_LINK_LIBRARIES scree::zlib m)
scree_static_library(jpeg libjpeg.a jpeglib.h)
scree_static_library(turbojpeg libturbojpeg.a turbojpeg.h)

function(scree_shared_library target name header)
  find_library(${target}_library NAMES ${name} REQUIRED)
  scree_imported_library(${target} UNKNOWN "${${target}_library}" ${header})
endfunction()

scree_shared_library(meshoptimizer meshoptimizer meshoptimizer.h)
scree_shared_library(isal isal isa-l.h)

scree_imported_library(tinygltf INTERFACE "" tiny_gltf.h)
scree_imported_library(nlohmann_json INTERFACE "" nlohmann/json.hpp)
scree_imported_library(cli11 INTERFACE "" CLI/CLI.hpp)

# OpenEXR pictures. Without the library, writing one fails with an error that names the library.
set(CMAKE_MESSAGE_LOG_LEVEL WARNING)  # Debian's Imath reports at length that another package is not installed
find_package(OpenEXR CONFIG QUIET)
unset(CMAKE_MESSAGE_LOG_LEVEL)
if(NOT TARGET OpenEXR::OpenEXR)
  message(STATUS "OpenEXR (libopenexr-dev) is not found: scree render writes no .exr")
endif()

# Codecs of some files. Without the library, such a file is refused with an error that names the library.
function(scree_optional_library target archive header what)
  string(TOUPPER "SCREE_${target}" option)
  option(${option} "Read ${what}, where the library is found" ON)
  find_library(${target}_archive NAMES ${archive})
  find_path(${target}_include NAMES ${header})
  if(NOT ${option} OR NOT ${target}_archive OR NOT ${target}_include)
    message(STATUS "${what} will not be read: ${archive} is not found or ${option} is off")
    return()
  endif()
  scree_static_library(${target} ${archive} ${header})
endfunction()

scree_optional_library(webp libwebp.a webp/decode.h "WebP textures (EXT_texture_webp)")
if(TARGET scree::webp)
  find_library(sharpyuv_archive NAMES libsharpyuv.a)  # a separate archive from libwebp 1.3 on, for the encoder in the tests
  set_property(TARGET scree::webp PROPERTY INTERFACE_LINK_LIBRARIES
    $<$<BOOL:${sharpyuv_archive}>:${sharpyuv_archive}> Threads::Threads m)
endif()

scree_optional_library(draco libdraco.a draco/compression/mesh/mesh_edgebreaker_decoder.h
  "Draco geometry (KHR_draco_mesh_compression)")

# Only scree view needs Boost.Beast (headers only). Without it the command fails with an error that names it.
find_path(beast_include NAMES boost/beast.hpp)
if(beast_include)
  add_library(scree::beast INTERFACE IMPORTED)
  set_target_properties(scree::beast PROPERTIES
    INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${beast_include}"
    INTERFACE_LINK_LIBRARIES Threads::Threads)
else()
  message(STATUS "Boost.Beast (libboost-dev) is not found: scree view is built without its server")
endif()

# With MPI, ranks of mpirun and srun share a film's frames. Without it such a run fails with an error that names it.
option(SCREE_MPI "Let ranks that mpirun or srun start share the work, where MPI is found" ON)
if(SCREE_MPI AND NOT SCREE_FUZZ)
  set(MPI_CXX_SKIP_MPICXX ON)  # only the C API is used
  find_package(MPI QUIET COMPONENTS CXX)
  if(NOT MPI_CXX_FOUND)
    message(STATUS "MPI (libopenmpi-dev) is not found: scree is built without it")
  endif()
endif()
