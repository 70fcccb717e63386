# Writes a C++ file that holds the viewer's page: cmake -DFOLDER=tools/view/page -DOUTPUT=assets.cpp -P embed.cmake
set(types html "text/html" css "text/css" js "text/javascript" svg "image/svg+xml")
file(GLOB files RELATIVE "${FOLDER}" "${FOLDER}/*")
list(SORT files)
set(arrays "")
set(entries "")
set(number 0)
foreach(file IN LISTS files)
  get_filename_component(extension "${file}" LAST_EXT)
  string(SUBSTRING "${extension}" 1 -1 extension)
  list(FIND types "${extension}" place)
  if(place EQUAL -1)
    message(FATAL_ERROR "${FOLDER}/${file}: no content type for .${extension}")
  endif()
  math(EXPR place "${place} + 1")
  list(GET types ${place} type)
  file(READ "${FOLDER}/${file}" bytes HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "((0x[0-9a-f][0-9a-f],)(0x[0-9a-f][0-9a-f],)(0x[0-9a-f][0-9a-f],)(0x[0-9a-f][0-9a-f],))" "\\1\n" bytes "${bytes}")
  string(APPEND arrays "constexpr unsigned char kFile${number}[] = {\n${bytes}};\n")
  set(path "/${file}")
  if(file STREQUAL index.html)
    set(path "/")
  endif()
  string(APPEND entries "    {\"${path}\", \"${type}; charset=utf-8\", kFile${number}},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE "${OUTPUT}" "// Made by cmake/embed.cmake of the files of tools/view/page/.
#include \"tools/view/server.h\"

namespace scree::tools::view {
namespace {

${arrays}
}  // namespace

std::span<const Asset> page_assets() {
  static constexpr Asset kAssets[] = {
${entries}  };
  return kAssets;
}

}  // namespace scree::tools::view
")
