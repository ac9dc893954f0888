#include "common/io/hdf5_support.h"

namespace panofix::hdf5 {
namespace {

// Never destroyed: readers may outlive static destruction.
std::mutex& LibraryMutex() {
  static auto* const mutex = new std::mutex;
  return *mutex;
}

herr_t KeepFirst(unsigned int depth, const H5E_error2_t* error, void* text) {
  if (depth == 0 && error->desc != nullptr) *static_cast<std::string*>(text) = error->desc;
  return 0;
}

}  // namespace

Lock::Lock() : guard_(LibraryMutex()) { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

std::string LastError() {
  std::string text;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, KeepFirst, &text);
  for (char& c : text) {
    if (c == '\n') c = ' ';
  }
  return text.empty() ? "HDF5 gives no reason" : text;
}

Status FailureStatus(const std::string& file, const std::string& doing, ErrorCode otherwise,
                     const std::string& mend) {
  const std::string reason = LastError();
  const std::string fault = file + ": " + doing + " failed (" + reason + "); ";
  if (reason.find("No space left") != std::string::npos) {
    return {ErrorCode::kNoSpace, fault + "free space on this disk and run again"};
  }
  return {otherwise, fault + mend};
}

hid_t DiskType(ArrayType type) {
  switch (type) {
    case ArrayType::kU8:
      return H5T_STD_U8LE;
    case ArrayType::kI32:
      return H5T_STD_I32LE;
    case ArrayType::kU32:
      return H5T_STD_U32LE;
    case ArrayType::kI64:
      return H5T_STD_I64LE;
    case ArrayType::kU64:
      return H5T_STD_U64LE;
    case ArrayType::kF32:
      return H5T_IEEE_F32LE;
    case ArrayType::kF64:
      return H5T_IEEE_F64LE;
  }
  return -1;
}

std::size_t ElementBytes(ArrayType type) {
  switch (type) {
    case ArrayType::kU8:
      return 1;
    case ArrayType::kI32:
    case ArrayType::kU32:
    case ArrayType::kF32:
      return 4;
    case ArrayType::kI64:
    case ArrayType::kU64:
    case ArrayType::kF64:
      return 8;
  }
  return 1;
}

const char* TypeName(ArrayType type) {
  switch (type) {
    case ArrayType::kU8:
      return "u8";
    case ArrayType::kI32:
      return "i32";
    case ArrayType::kU32:
      return "u32";
    case ArrayType::kI64:
      return "i64";
    case ArrayType::kU64:
      return "u64";
    case ArrayType::kF32:
      return "f32";
    case ArrayType::kF64:
      return "f64";
  }
  return "unknown";
}

}  // namespace panofix::hdf5
