#include <sys/mman.h>
#include <sys/stat.h>

#include <filesystem>
#include <stdexcept>

#include "common/base/log.h"
#include "common/io/atomic_file.h"
#include "common/io/hdf5_support.h"
#include "common/io/unique_fd.h"

namespace panofix {
namespace {

using hdf5::Handle;

constexpr hsize_t kAlignFromBytes = 64 * 1024;
constexpr hsize_t kAlignmentBytes = 4096;
constexpr const char* kMend = "free some memory and run again";

// Time stamps would make two equal builds differ.
Handle CreationList(hid_t list_class) {
  Handle list(H5Pcreate(list_class), H5Pclose);
  H5Pset_obj_track_times(list.get(), false);
  return list;
}

}  // namespace

struct Hdf5Writer::Impl {
  std::string name;
  // The file is built in memory: on a full disk the library cannot close its file, and crashes when
  // the program ends.
  UniqueFd memory;
  Handle file;

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    const hdf5::Lock lock;
    file.Close();
  }
  [[noreturn]] void Throw(const std::string& doing) const {
    throw Error(hdf5::FailureStatus(name, doing, ErrorCode::kIo, kMend));
  }
  void RequireOpen() const {
    if (!file.valid()) throw std::logic_error(name + ": written to after Close");
  }
  // Groups are made one by one: H5Pset_create_intermediate_group would stamp them with the time.
  void MakeGroups(const std::string& dataset) const {
    for (auto slash = dataset.find('/'); slash != std::string::npos;
         slash = dataset.find('/', slash + 1)) {
      const std::string group = dataset.substr(0, slash);
      if (H5Lexists(file.get(), group.c_str(), H5P_DEFAULT) > 0) continue;
      const Handle list = CreationList(H5P_GROUP_CREATE);
      const Handle made(H5Gcreate2(file.get(), group.c_str(), H5P_DEFAULT, list.get(), H5P_DEFAULT),
                        H5Gclose);
      if (!made.valid()) Throw("making group '" + group + "'");
    }
  }
  void WriteRootAttribute(const std::string& attribute, hid_t disk_type, hid_t memory_type,
                          const void* data) const {
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle made(H5Acreate_by_name(file.get(), ".", attribute.c_str(), disk_type, space.get(),
                                        H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                      H5Aclose);
    if (!made.valid() || H5Awrite(made.get(), memory_type, data) < 0) {
      Throw("writing attribute '" + attribute + "'");
    }
  }
};

Hdf5Writer::Hdf5Writer(const std::filesystem::path& path) : impl_(std::make_unique<Impl>()) {
  impl_->name = path.string();
  std::error_code error;
  const auto folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  if (!std::filesystem::is_directory(folder, error)) {
    throw Error(ErrorCode::kNotFound,
                impl_->name + ": its folder does not exist; create it or name another");
  }
  const hdf5::Lock lock;
  const Handle creation = CreationList(H5P_FILE_CREATE);
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110);
  H5Pset_alignment(access.get(), kAlignFromBytes, kAlignmentBytes);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  impl_->memory = UniqueFd(::memfd_create("panofix-hdf5", MFD_CLOEXEC));
  if (hdf5::UseDescriptor(access.get(), impl_->memory.get())) {
    impl_->file =
        Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.get(), access.get()), H5Fclose);
  }
  if (!impl_->file.valid()) impl_->Throw("creating");
}

Hdf5Writer::~Hdf5Writer() = default;

void Hdf5Writer::Close() {
  if (!impl_->file.valid()) return;
  {
    const hdf5::Lock lock;
    if (!impl_->file.Close()) impl_->Throw("closing");
  }
  struct stat info {};
  ::fstat(impl_->memory.get(), &info);
  const auto bytes = static_cast<std::size_t>(info.st_size);
  void* image = ::mmap(nullptr, bytes, PROT_READ, MAP_SHARED, impl_->memory.get(), 0);
  if (image == MAP_FAILED) impl_->Throw("mapping");
  const Status written =
      WriteFileAtomically(impl_->name, std::span(static_cast<const std::uint8_t*>(image), bytes));
  ::munmap(image, bytes);
  impl_->memory.Reset();
  ThrowIfError(written);
}

void Hdf5Writer::WriteRaw(const std::string& name, ArrayType type, const void* data,
                          std::int64_t size, std::int64_t cols) {
  if (cols < 1 || size % cols != 0) {
    throw std::logic_error("Hdf5Writer: array '" + name + "' has " + std::to_string(size) +
                           " values, not whole rows of " + std::to_string(cols));
  }
  impl_->RequireOpen();
  const hdf5::Lock lock;
  impl_->MakeGroups(name);
  const hsize_t dims[2] = {static_cast<hsize_t>(size / cols), static_cast<hsize_t>(cols)};
  const Handle space(H5Screate_simple(cols == 1 ? 1 : 2, dims, nullptr), H5Sclose);
  const Handle list = CreationList(H5P_DATASET_CREATE);
  H5Pset_layout(list.get(), H5D_CONTIGUOUS);
  H5Pset_fill_time(list.get(), H5D_FILL_TIME_NEVER);
  const hid_t disk_type = hdf5::DiskType(type);
  const Handle made(H5Dcreate2(impl_->file.get(), name.c_str(), disk_type, space.get(), H5P_DEFAULT,
                               list.get(), H5P_DEFAULT),
                    H5Dclose);
  if (!made.valid()) impl_->Throw("making array '" + name + "'");
  // Memory is little-endian on every machine this runs on: the disk type is the memory type.
  if (size > 0 && H5Dwrite(made.get(), disk_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0) {
    impl_->Throw("writing array '" + name + "'");
  }
}

void Hdf5Writer::WriteStrings(const std::string& name, const std::vector<std::string>& values) {
  std::string joined;
  for (const std::string& value : values) {
    if (value.find('\n') != std::string::npos) {
      throw std::logic_error("Hdf5Writer: a string of '" + name + "' holds a line break");
    }
    joined += value;
    joined += '\n';
  }
  WriteRaw(name, ArrayType::kU8, joined.data(), static_cast<std::int64_t>(joined.size()), 1);
}

void Hdf5Writer::WriteAttribute(const std::string& name, std::int64_t value) {
  impl_->RequireOpen();
  const hdf5::Lock lock;
  impl_->WriteRootAttribute(name, H5T_STD_I64LE, H5T_NATIVE_INT64, &value);
}

void Hdf5Writer::WriteAttribute(const std::string& name, const std::string& value) {
  impl_->RequireOpen();
  if (value.find('\0') != std::string::npos) {
    throw std::logic_error("Hdf5Writer: attribute '" + name + "' holds a zero byte");
  }
  const hdf5::Lock lock;
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), value.size() + 1);  // with its zero: HDF5 has no strings of length 0
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  impl_->WriteRootAttribute(name, type.get(), type.get(), value.c_str());
}

}  // namespace panofix
