# Flags, and the two functions that declare every module and test of the project.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_FLAGS_RELEASE "-O2")

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
  # The sloppiness is what ccache asks for beside precompiled headers.
  set(CMAKE_CXX_COMPILER_LAUNCHER
      "${CMAKE_COMMAND};-E;env;CCACHE_SLOPPINESS=pch_defines,time_macros;${CCACHE_PROGRAM}")
endif()

add_library(panofix_flags INTERFACE)
target_include_directories(panofix_flags INTERFACE "${CMAKE_SOURCE_DIR}" "${CMAKE_BINARY_DIR}/generated")
# -ffp-contract=off: a fused multiply-add changes results between machines, and results reach disk.
target_compile_options(panofix_flags INTERFACE
  -ffp-contract=off -fpch-preprocess -Wall -Wextra -Wpedantic -Wshadow -Wconversion
  -Wnon-virtual-dtor -Woverloaded-virtual
  $<$<BOOL:${PANOFIX_WARNINGS_AS_ERRORS}>:-Werror>)
if(PANOFIX_SANITIZE)
  target_compile_options(panofix_flags INTERFACE
    -fsanitize=${PANOFIX_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all -g1)
  target_link_options(panofix_flags INTERFACE -fsanitize=${PANOFIX_SANITIZE})
endif()

# One precompiled header for the whole project: the standard library and Eigen.
set(_panofix_pch_source "${CMAKE_BINARY_DIR}/generated/pch.cc")
file(CONFIGURE OUTPUT "${_panofix_pch_source}" CONTENT "// Carries the precompiled header.\n")
add_library(panofix_pch OBJECT "${_panofix_pch_source}")

# panofix_module(NAME folder/of/module SOURCES … HEADERS … DEPS …): target panofix_NAME.
function(panofix_module name)
  cmake_parse_arguments(ARG "" "" "SOURCES;HEADERS;DEPS;PRIVATE_DEPS" ${ARGN})
  if(ARG_SOURCES)
    add_library(panofix_${name} STATIC ${ARG_SOURCES})
    target_link_libraries(panofix_${name} PUBLIC panofix_flags ${ARG_DEPS} PRIVATE ${ARG_PRIVATE_DEPS})
    target_precompile_headers(panofix_${name} REUSE_FROM panofix_pch)
    target_sources(panofix_${name} PUBLIC FILE_SET HEADERS BASE_DIRS "${CMAKE_SOURCE_DIR}" FILES ${ARG_HEADERS})
  else()
    add_library(panofix_${name} INTERFACE)
    target_link_libraries(panofix_${name} INTERFACE panofix_flags ${ARG_DEPS})
    target_sources(panofix_${name} INTERFACE FILE_SET HEADERS BASE_DIRS "${CMAKE_SOURCE_DIR}" FILES ${ARG_HEADERS})
  endif()
endfunction()

# panofix_app(NAME [INSTALL] SOURCES … DEPS …): an executable of that name in bin/. INSTALL: it goes to
# PREFIX/bin with cmake --install.
function(panofix_app name)
  cmake_parse_arguments(ARG "INSTALL" "" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  if(ARG_INSTALL)
    install(TARGETS ${name})
  endif()
  target_link_libraries(${name} PRIVATE panofix_flags ${ARG_DEPS})
  target_precompile_headers(${name} REUSE_FROM panofix_pch)
endfunction()

# panofix_test(NAME LABEL unit|e2e SOURCES … DEPS …): one GoogleTest program, run whole by ctest.
function(panofix_test name)
  cmake_parse_arguments(ARG "" "LABEL;TIMEOUT" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE panofix_flags ${ARG_DEPS} GTest::gtest_main GTest::gmock)
  target_precompile_headers(${name} REUSE_FROM panofix_pch)
  target_compile_definitions(${name} PRIVATE
    PANOFIX_EVALUATION_DATA="${PANOFIX_EVALUATION_DATA}"
    PANOFIX_BIN_DIR="${CMAKE_RUNTIME_OUTPUT_DIRECTORY}"
    PANOFIX_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  if(NOT ARG_LABEL)
    set(ARG_LABEL unit)
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 600)
  endif()
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS ${ARG_LABEL} TIMEOUT ${ARG_TIMEOUT})
endfunction()
