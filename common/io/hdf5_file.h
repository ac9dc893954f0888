#pragma once
// HDF5 as panofix uses it: contiguous little-endian arrays in immutable files, equal bytes for
// equal content. The only door to the HDF5 library; its failures become Status here.
//
// Verify a file's hash before opening it: the library is not safe on hostile bytes.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace panofix {

// Element types on disk; all little-endian.
enum class ArrayType { kU8, kI32, kU32, kI64, kU64, kF32, kF64 };
template <typename T>
struct ArrayTypeOf;
template <>
struct ArrayTypeOf<std::uint8_t> {
  static constexpr ArrayType value = ArrayType::kU8;
};
template <>
struct ArrayTypeOf<std::int32_t> {
  static constexpr ArrayType value = ArrayType::kI32;
};
template <>
struct ArrayTypeOf<std::uint32_t> {
  static constexpr ArrayType value = ArrayType::kU32;
};
template <>
struct ArrayTypeOf<std::int64_t> {
  static constexpr ArrayType value = ArrayType::kI64;
};
template <>
struct ArrayTypeOf<std::uint64_t> {
  static constexpr ArrayType value = ArrayType::kU64;
};
template <>
struct ArrayTypeOf<float> {
  static constexpr ArrayType value = ArrayType::kF32;
};
template <>
struct ArrayTypeOf<double> {
  static constexpr ArrayType value = ArrayType::kF64;
};

// Builds one file in memory and writes it atomically at Close; without
// Close there is no file. libver V110, no time stamps, arrays contiguous, aligned to 4096 bytes
// once they are 64 KiB or larger, no fill. Throws panofix::Error. Not thread-safe; one writer a
// file.
class Hdf5Writer {
 public:
  explicit Hdf5Writer(const std::filesystem::path& path);
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;
  // rows x cols, row-major; name such as "sift/descriptors" (groups are made). rows may be 0.
  template <typename T>
  void Write(const std::string& name, std::span<const T> values, std::int64_t cols = 1) {
    WriteRaw(name, ArrayTypeOf<T>::value, values.data(), static_cast<std::int64_t>(values.size()),
             cols);
  }
  // Strings as one u8 array of UTF-8, each ended by '\n' (a string may not hold one:
  // std::logic_error).
  void WriteStrings(const std::string& name, const std::vector<std::string>& values);
  void WriteAttribute(const std::string& name, std::int64_t value);  // on the root
  void WriteAttribute(const std::string& name, const std::string& value);
  void Close();  // a second call does nothing

 private:
  void WriteRaw(const std::string& name, ArrayType type, const void* data, std::int64_t size,
                std::int64_t cols);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A read-only array: mapped from the file where it is contiguous, else copied. Valid while any copy
// of the array lives, also after its reader is gone.
template <typename T>
struct MappedArray {
  std::span<const T> values;
  std::int64_t rows = 0, cols = 1;
  std::shared_ptr<const void> owner;
};

// Reads a file that the caller has verified. Never throws; thread-safe for concurrent Read calls.
class Hdf5Reader {
 public:
  // `fd` is an open descriptor of the verified file (kept by dup), so that a swapped path cannot
  // change what is read; `name` is for messages.
  [[nodiscard]] static Result<Hdf5Reader> Open(int fd, const std::string& name);
  // Opens by path: tests and the builder's own files.
  [[nodiscard]] static Result<Hdf5Reader> Open(const std::filesystem::path& path);

  // kNotFound, kBadData (other type, other cols, larger than the file). cols -1 takes any.
  template <typename T>
  [[nodiscard]] Result<MappedArray<T>> Read(const std::string& name, std::int64_t cols = 1) const {
    auto raw = ReadRaw(name, ArrayTypeOf<T>::value, cols);
    if (!raw.ok()) return raw.status();
    MappedArray<T> array;
    array.values = {reinterpret_cast<const T*>(raw->data),
                    static_cast<std::size_t>(raw->rows * raw->cols)};
    array.rows = raw->rows, array.cols = raw->cols, array.owner = raw->owner;
    return array;
  }
  [[nodiscard]] Result<std::vector<std::string>> ReadStrings(const std::string& name) const;
  [[nodiscard]] Result<std::int64_t> ReadIntAttribute(const std::string& name) const;
  [[nodiscard]] Result<std::string> ReadStringAttribute(const std::string& name) const;

 private:
  struct Raw {
    const void* data = nullptr;
    std::int64_t rows = 0, cols = 1;
    std::shared_ptr<const void> owner;
  };
  [[nodiscard]] Result<Raw> ReadRaw(const std::string& name, ArrayType type,
                                    std::int64_t cols) const;
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace panofix
