# Tests of the library's public interface: everything here uses only include/scree/.
add_executable(scree_library_tests gpu.cpp library/test_abi.cpp library/test_extremes.cpp
  library/test_misuse.cpp library/test_misuse_handles.cpp library/test_path.cpp
  library/test_render_equal.cpp library/test_shadows.cpp library/test_views.cpp)
target_link_libraries(scree_library_tests PRIVATE scree_test_main scree::scree scree_convert)
add_dependencies(scree_library_tests scree)
if(TARGET OpenEXR::OpenEXR)
  target_sources(scree_library_tests PRIVATE library/test_exr.cpp)
  target_link_libraries(scree_library_tests PRIVATE OpenEXR::OpenEXR)
endif()
catch_discover_tests(scree_library_tests TEST_SPEC "~[cuda]~[.]" PROPERTIES LABELS cpu)

# These tests need only the library, so that building them with ThreadSanitizer builds nothing else.
add_executable(scree_thread_tests library/test_threads.cpp)
target_link_libraries(scree_thread_tests PRIVATE scree_test_main scree::scree scree_options)
catch_discover_tests(scree_thread_tests PROPERTIES LABELS cpu)

if(scree_cuda STREQUAL emulated)
  catch_discover_tests(scree_library_tests TEST_SPEC "[cuda]~[.]" TEST_SUFFIX " (emulated)"
    PROPERTIES LABELS cuda ENVIRONMENT SCREE_EMULATED_GPU=1)
else()
  catch_discover_tests(scree_library_tests TEST_SPEC "[cuda]~[.]" TEST_SUFFIX " (cuda)" PROPERTIES LABELS cuda)
endif()

if(CMAKE_NM)
  add_test(NAME library-symbols COMMAND "${CMAKE_COMMAND}" "-DNM=${CMAKE_NM}" "-DLIST=${CMAKE_SOURCE_DIR}/library/abi.txt"
    "-DLIBRARY=$<TARGET_FILE:libscree>" "-DARCHIVE=$<$<TARGET_EXISTS:libscree_static>:${CMAKE_BINARY_DIR}/library/libscree.a>"
    -P "${CMAKE_CURRENT_SOURCE_DIR}/library/check_symbols.cmake")
  set_tests_properties(library-symbols PROPERTIES LABELS cpu)
endif()

find_program(PKG_CONFIG pkg-config)
if(PKG_CONFIG AND NOT SCREE_SANITIZE)  # the sanitizers' runtime is missing in a third-party program
  add_test(NAME library-install COMMAND "${Python3_EXECUTABLE}" "${CMAKE_CURRENT_SOURCE_DIR}/library/check_install.py"
    "${CMAKE_BINARY_DIR}" "${CMAKE_SOURCE_DIR}" "${CMAKE_CURRENT_SOURCE_DIR}/data/textured_cube.glb")
  set_tests_properties(library-install PROPERTIES LABELS cpu)
endif()

if(TARGET scree_python)
  execute_process(COMMAND "${Python3_EXECUTABLE}" -c "import numpy" RESULT_VARIABLE no_numpy OUTPUT_QUIET ERROR_QUIET)
  if(no_numpy)
    message(STATUS "The Python package is not tested: numpy (python3-numpy) is not there")
  else()
    add_test(NAME python COMMAND "${Python3_EXECUTABLE}" "${CMAKE_CURRENT_SOURCE_DIR}/python/test_scree.py"
      "${CMAKE_CURRENT_SOURCE_DIR}/data" "${CMAKE_SOURCE_DIR}/python/examples")
    set_tests_properties(python PROPERTIES LABELS cpu ENVIRONMENT "PYTHONPATH=${CMAKE_BINARY_DIR}/python")
    add_test(NAME python-torch COMMAND "${Python3_EXECUTABLE}" "${CMAKE_CURRENT_SOURCE_DIR}/python/test_torch.py"
      "${CMAKE_CURRENT_SOURCE_DIR}/data")
    set_tests_properties(python-torch PROPERTIES LABELS cuda SKIP_RETURN_CODE 77
      ENVIRONMENT "PYTHONPATH=${CMAKE_BINARY_DIR}/python")
  endif()
endif()
