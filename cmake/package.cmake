# Packages, by CPack (scripts/package calls it): a .deb for the distribution this is built on where SCREE_BUNDLE_LIBRARIES
# is off, else a tarball that can lie anywhere. The version is project()'s.
set(CPACK_PACKAGE_NAME scree)
set(CPACK_PACKAGE_VENDOR "The scree authors")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "pack, stream and draw huge glTF scenes exactly")
set(CPACK_STRIP_FILES ON)
# CMake takes its umask for folders that it makes; packages have the same everywhere.
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
string(TOLOWER "${CMAKE_SYSTEM_NAME}-${CMAKE_SYSTEM_PROCESSOR}" system)
set(CPACK_PACKAGE_FILE_NAME "scree-${PROJECT_VERSION}-${system}")

if(SCREE_BUNDLE_LIBRARIES)
  set(CPACK_GENERATOR TGZ)
  if(SCREE_PACKAGE_FILES)
    install(FILES "${CMAKE_SOURCE_DIR}/LICENSE" "${CMAKE_SOURCE_DIR}/README.md" "${CMAKE_SOURCE_DIR}/CHANGELOG.md"
      "${SCREE_PACKAGE_FILES}/THIRD-PARTY" DESTINATION "${CMAKE_INSTALL_DOCDIR}")
  endif()
else()
  # A number of the distribution's own would be newer: 0.1.0 > 0.1.0~debian12.
  file(STRINGS /etc/os-release release REGEX "^(ID|VERSION_ID)=")
  string(REGEX REPLACE ".*;?ID=\"?([a-z]+)\"?.*" "\\1" release_id ";${release}")
  string(REGEX REPLACE ".*VERSION_ID=\"?([0-9.]+)\"?.*" "\\1" release_version "${release}")
  set(CPACK_GENERATOR DEB)
  # The program's files; the library's would be packages of their own (libscree0, libscree-dev, python3-scree).
  set(CPACK_INSTALL_CMAKE_PROJECTS "${CMAKE_BINARY_DIR};scree;Unspecified;/")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
  set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
  set(CPACK_DEBIAN_PACKAGE_VERSION "${PROJECT_VERSION}~${release_id}${release_version}")
  set(CPACK_DEBIAN_PACKAGE_MAINTAINER "${SCREE_MAINTAINER}")
  set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
  if(scree_cuda STREQUAL nvcc)  # cudart's object code is not free software
    set(CPACK_DEBIAN_PACKAGE_SECTION non-free/graphics)
    set(CPACK_DEBIAN_PACKAGE_SUGGESTS libcuda1)
  endif()
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
  set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
  set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"scree packs glTF scenes that are too big for other tools into one small,
checked file, and draws them by software rasterisation: every triangle, no
level of detail. It converts, inspects, renders, compares and exports.
.
Scenes are drawn on an NVIDIA GPU where there is one and the program was built
with CUDA, else on the CPU, with the same result.")
  if(SCREE_PACKAGE_FILES)
    install(FILES "${SCREE_PACKAGE_FILES}/copyright" "${SCREE_PACKAGE_FILES}/changelog.gz" DESTINATION "${CMAKE_INSTALL_DATADIR}/doc/scree")
    install(FILES "${SCREE_PACKAGE_FILES}/overrides" DESTINATION "${CMAKE_INSTALL_DATADIR}/lintian/overrides" RENAME scree)
  endif()
endif()
include(CPack)
