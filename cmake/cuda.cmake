# Sets up the build of CUDA sources. scree_cuda is nvcc, emulated (tests/emulator: kernels as C++ on the CPU, for their
# tests) or none.
set(scree_cuda none)
set(SCREE_CUDA_PATH "" CACHE STRING "Compute capability whose code path every GPU takes, to test it: 75 or 80")

# The compute capabilities of this machine's GPUs, else all from 7.5 on, the least that CUDA 13 supports. Code for x.y
# also runs on later minor versions of x. The last one is also built as PTX, for all newer GPUs.
function(scree_default_architectures out)
  find_program(SCREE_NVIDIA_SMI nvidia-smi)
  set(found "")
  if(SCREE_NVIDIA_SMI)
    execute_process(COMMAND "${SCREE_NVIDIA_SMI}" --query-gpu=compute_cap --format=csv,noheader
      OUTPUT_VARIABLE capabilities ERROR_QUIET RESULT_VARIABLE failed)
    if(NOT failed)
      string(REGEX MATCHALL "[0-9]+[.][0-9]" found "${capabilities}")
      list(REMOVE_DUPLICATES found)
      list(TRANSFORM found REPLACE "[.]" "")
      list(FILTER found EXCLUDE REGEX "^([1-6].|7[0-4])$")  # too old for CUDA 13
      list(TRANSFORM found APPEND "-real")
    endif()
  endif()
  if(NOT found)
    set(found 75-real 80-real 86-real 89-real 90-real 100-real 120)
  endif()
  set(${out} "${found}" PARENT_SCOPE)
endfunction()

# Makes check_language() find nvcc: in CUDACXX, CUDA_PATH, PATH or else in the folders that are given. In a build folder
# that was configured before nvcc was installed, check_language() would keep the NOTFOUND of its cache.
function(scree_find_nvcc)
  if(CMAKE_CUDA_COMPILER)
    return()
  endif()
  unset(CMAKE_CUDA_COMPILER CACHE)
  if("$ENV{CUDACXX}" STREQUAL "")
    find_program(scree_nvcc NAMES nvcc HINTS "$ENV{CUDA_PATH}/bin" PATHS ${ARGN} NO_CACHE)
    if(scree_nvcc)
      set(ENV{CUDACXX} "${scree_nvcc}")
    endif()
  endif()
endfunction()

if(SCREE_EMULATED_CUDA)
  if(SCREE_CUDA OR NOT CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    message(FATAL_ERROR "SCREE_EMULATED_CUDA needs GCC (-fno-weak), and SCREE_CUDA off")
  endif()
  find_package(CUDAToolkit REQUIRED)  # its headers
  set(scree_cuda emulated)
  add_subdirectory(tests/emulator)
elseif(SCREE_CUDA)
  scree_find_nvcc(/usr/local/cuda/bin /opt/cuda/bin)  # where installers put it that leave PATH as it is
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    if(NOT CMAKE_CUDA_ARCHITECTURES)
      scree_default_architectures(CMAKE_CUDA_ARCHITECTURES)
      set(CMAKE_CUDA_ARCHITECTURES "${CMAKE_CUDA_ARCHITECTURES}" CACHE STRING "Compute capabilities to build code for")
    endif()
    message(STATUS "CUDA code is built for ${CMAKE_CUDA_ARCHITECTURES}")
    enable_language(CUDA)
    # CMake 3.25 lacks the C++20 option of CUDA 13. It is set here because enable_language() clears it.
    if(NOT CMAKE_CUDA20_STANDARD_COMPILE_OPTION)
      set(CMAKE_CUDA20_STANDARD_COMPILE_OPTION "-std=c++20")
    endif()
    find_package(CUDAToolkit REQUIRED)
    set(scree_cuda nvcc)
  else()
    message(STATUS "SCREE_CUDA is on, but there is no CUDA compiler: the CPU backend alone is built")
  endif()
endif()

# Adds an object library of .cu files, built without contraction, so that results equal the CPU's
# (spec/rasterization.md).
function(scree_add_cuda_objects target)
  if(scree_cuda STREQUAL emulated)
    scree_emulate_cuda(sources ${ARGN})
    add_library(${target} OBJECT ${sources})
    target_link_libraries(${target} PRIVATE scree_emulated_device scree_options)
  else()
    add_library(${target} OBJECT ${ARGN})
    set_target_properties(${target} PROPERTIES CUDA_STANDARD 20 CUDA_STANDARD_REQUIRED ON CUDA_EXTENSIONS OFF)
    target_compile_options(${target} PRIVATE --fmad=false -Xcompiler=-ffp-contract=off -Werror=all-warnings)
    target_include_directories(${target} PRIVATE "${CMAKE_SOURCE_DIR}")
    # Makes programs for all capabilities a quarter as large. Drivers before CUDA 12.4 cannot unpack it; CUDA 13 needs
    # newer ones.
    if(CMAKE_CUDA_COMPILER_VERSION VERSION_GREATER_EQUAL 13)
      target_compile_options(${target} PRIVATE -compress-mode=size)
    endif()
    # The resources that ptxas reports go to a file beside each object, for tests/kernels/cuda/registers.cmake.
    target_compile_options(${target} PRIVATE -Xptxas=-v)
    set_property(TARGET ${target} PROPERTY RULE_LAUNCH_COMPILE "\"${CMAKE_SOURCE_DIR}/cmake/keep-ptxas\" <OBJECT>.ptxas")
  endif()
  set_property(TARGET ${target} PROPERTY UNITY_BUILD OFF)
  if(SCREE_CUDA_PATH)
    target_compile_definitions(${target} PRIVATE SCREE_CUDA_PATH=${SCREE_CUDA_PATH})
  endif()
endfunction()
