# System packages only; nothing is downloaded. The runtime's list is an allow-list (tests/rules).
list(APPEND CMAKE_MODULE_PATH /usr/share/cmake/geographiclib)

find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(OpenMP REQUIRED COMPONENTS CXX)
find_package(TBB REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(HDF5 REQUIRED COMPONENTS C)
find_package(GeographicLib REQUIRED)
find_package(FlatBuffers REQUIRED CONFIG)
find_package(spdlog REQUIRED)
find_package(OpenSSL REQUIRED COMPONENTS Crypto)
find_package(ZLIB REQUIRED)
find_package(yaml-cpp REQUIRED)
pkg_check_modules(ZeroMQ REQUIRED IMPORTED_TARGET libzmq)
pkg_check_modules(Sodium REQUIRED IMPORTED_TARGET libsodium)
pkg_check_modules(Zstd REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(HttpLib REQUIRED IMPORTED_TARGET cpp-httplib)
pkg_check_modules(Curl REQUIRED IMPORTED_TARGET libcurl)
find_path(CLI11_INCLUDE_DIR CLI/CLI.hpp REQUIRED)
find_path(NLOHMANN_JSON_INCLUDE_DIR nlohmann/json.hpp REQUIRED)

add_library(panofix::geographiclib INTERFACE IMPORTED)
target_link_libraries(panofix::geographiclib INTERFACE ${GeographicLib_LIBRARIES})
target_include_directories(panofix::geographiclib SYSTEM INTERFACE ${GeographicLib_INCLUDE_DIRS})

add_library(panofix::hdf5 INTERFACE IMPORTED)
target_link_libraries(panofix::hdf5 INTERFACE ${HDF5_C_LIBRARIES})
target_include_directories(panofix::hdf5 SYSTEM INTERFACE ${HDF5_C_INCLUDE_DIRS})

# OpenCV by component: Debian's OpenCVConfig.cmake sits in libopencv-dev, which drags in VTK and Qt
# (210 packages more); the component packages need no config file.
find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(_component core imgproc imgcodecs features2d flann calib3d)
  find_library(OPENCV_${_component}_LIBRARY opencv_${_component} REQUIRED)
  add_library(panofix::opencv_${_component} INTERFACE IMPORTED)
  target_include_directories(panofix::opencv_${_component} SYSTEM INTERFACE ${OPENCV_INCLUDE_DIR})
  target_link_libraries(panofix::opencv_${_component} INTERFACE ${OPENCV_${_component}_LIBRARY})
endforeach()

# Everywhere, so that one precompiled header fits all; g++ reports false OpenMP races under tsan.
target_link_libraries(panofix_flags INTERFACE Eigen3::Eigen Threads::Threads)
target_compile_options(panofix_flags INTERFACE -pthread)
if(NOT PANOFIX_SANITIZE STREQUAL "thread")
  target_link_libraries(panofix_flags INTERFACE OpenMP::OpenMP_CXX)
endif()

if(PANOFIX_BUILD_BUILDER)
  find_package(Ceres REQUIRED)
endif()
if(PANOFIX_BUILD_TESTS)
  find_package(GTest REQUIRED)
  if(PANOFIX_BUILD_BUILDER)
    find_package(embree 3 REQUIRED)
  endif()
endif()
if(PANOFIX_BUILD_BENCH)
  find_package(benchmark REQUIRED)
endif()

target_precompile_headers(panofix_pch PRIVATE
  <Eigen/Core> <Eigen/Geometry> <algorithm> <array> <chrono> <cmath> <cstdint> <filesystem> <functional>
  <map> <memory> <optional> <span> <string> <string_view> <unordered_map> <vector>)
target_link_libraries(panofix_pch PUBLIC panofix_flags)
