# scripts/package calls CPack to make the tarball, a relocatable folder of all installed files. debhelper (cmake/debian)
# makes the packages for Debian from the components program, library, development and python.
if(NOT SCREE_BUNDLE_LIBRARIES)
  return()
endif()
set(CPACK_GENERATOR TGZ)
set(CPACK_STRIP_FILES ON)
# By default, the umask determines the permissions of CMake's folders. Packages should not depend on it.
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
string(TOLOWER "${CMAKE_SYSTEM_NAME}-${CMAKE_SYSTEM_PROCESSOR}" system)
set(CPACK_PACKAGE_FILE_NAME "scree-${PROJECT_VERSION}-${system}")
if(SCREE_PACKAGE_FILES)
  install(FILES "${CMAKE_SOURCE_DIR}/LICENSE" "${CMAKE_SOURCE_DIR}/README.md" "${CMAKE_SOURCE_DIR}/CHANGELOG.md"
    "${SCREE_PACKAGE_FILES}/THIRD-PARTY" DESTINATION "${CMAKE_INSTALL_DOCDIR}")
endif()
include(CPack)
