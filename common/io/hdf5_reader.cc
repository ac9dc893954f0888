#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <limits>
#include <new>

#include "common/base/log.h"
#include "common/io/hdf5_support.h"
#include "common/io/unique_fd.h"

namespace panofix {
namespace {

using hdf5::Handle;

constexpr const char* kMend = "the file is damaged or not ours; fetch or build it again";
constexpr std::size_t kMaxAttributeBytes = std::size_t{16} << 20;

Status Bad(const std::string& file, const std::string& fault) {
  return {ErrorCode::kBadData, file + ": " + fault + "; " + kMend};
}

// rows x cols from a dataspace of rank 1 or 2, and the bytes they take.
struct Extent {
  std::int64_t rows = 0, cols = 1;
  std::uint64_t bytes = 0;
};

// Sizes are held against the file's own: our arrays are not compressed.
Result<Extent> ExtentOf(const Handle& space, std::size_t element_bytes, std::uint64_t file_bytes,
                        const std::string& what) {
  const int rank = H5Sget_simple_extent_ndims(space.get());
  hsize_t dims[2] = {0, 1};
  if ((rank != 1 && rank != 2) || H5Sget_simple_extent_dims(space.get(), dims, nullptr) != rank) {
    return Bad(what, Format("rank %d, not 1 or 2", rank));
  }
  const std::uint64_t most = file_bytes / element_bytes;
  if (dims[1] == 0 || dims[1] > most + 1 || dims[0] > most || dims[0] * dims[1] > most) {
    return Bad(what, Format("%llu x %llu values do not fit a file of %llu bytes",
                            static_cast<unsigned long long>(dims[0]),
                            static_cast<unsigned long long>(dims[1]),
                            static_cast<unsigned long long>(file_bytes)));
  }
  return Extent{static_cast<std::int64_t>(dims[0]), static_cast<std::int64_t>(dims[1]),
                dims[0] * dims[1] * element_bytes};
}

// The page-aligned mapping that holds `bytes` at `offset` of the file; nullptr where it cannot be.
std::shared_ptr<const void> MapFile(int fd, std::uint64_t offset, std::uint64_t bytes) {
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  const std::uint64_t lead = offset % page;
  const auto length = static_cast<std::size_t>(lead + bytes);
  void* base =
      ::mmap(nullptr, length, PROT_READ, MAP_SHARED, fd, static_cast<off_t>(offset - lead));
  if (base == MAP_FAILED) return nullptr;
  const std::shared_ptr<const void> mapping(
      base, [length](const void* p) { ::munmap(const_cast<void*>(p), length); });
  return {mapping, static_cast<const std::uint8_t*>(base) + lead};
}

}  // namespace

struct Hdf5Reader::Impl {
  std::string name;
  UniqueFd fd;
  std::uint64_t file_bytes = 0;
  Handle file;

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    const hdf5::Lock lock;
    file.Close();
  }

  std::string What(const std::string& array) const { return name + ": '" + array + "'"; }
  // Every step of the path is a plain link, so that nothing leads out of the verified file.
  Result<Handle> OpenDataset(const std::string& array) const;
  Status CheckStorage(const Handle& dataset, ArrayType type, const std::string& array) const;
  Result<Handle> OpenAttribute(const std::string& attribute) const;
};

Result<Handle> Hdf5Reader::Impl::OpenDataset(const std::string& array) const {
  for (std::size_t slash = 0; slash != std::string::npos;) {
    slash = array.find('/', slash + 1);
    const std::string part = array.substr(0, slash);
    if (H5Lexists(file.get(), part.c_str(), H5P_DEFAULT) <= 0) {
      return Status(ErrorCode::kNotFound,
                    What(array) + " is not in the file; build it again with this release");
    }
    H5L_info_t info;
    if (H5Lget_info(file.get(), part.c_str(), &info, H5P_DEFAULT) < 0 ||
        info.type != H5L_TYPE_HARD) {
      return Bad(What(array), "is a link to elsewhere");
    }
  }
  Handle dataset(H5Dopen2(file.get(), array.c_str(), H5P_DEFAULT), H5Dclose);
  if (!dataset.valid()) return Bad(What(array), "cannot be opened (" + hdf5::LastError() + ")");
  return dataset;
}

Status Hdf5Reader::Impl::CheckStorage(const Handle& dataset, ArrayType type,
                                      const std::string& array) const {
  const Handle disk_type(H5Dget_type(dataset.get()), H5Tclose);
  if (H5Tequal(disk_type.get(), hdf5::DiskType(type)) <= 0) {
    return Bad(What(array), std::string("is not of type ") + hdf5::TypeName(type));
  }
  const Handle list(H5Dget_create_plist(dataset.get()), H5Pclose);
  const H5D_layout_t layout = H5Pget_layout(list.get());
  if (layout != H5D_CONTIGUOUS && layout != H5D_CHUNKED && layout != H5D_COMPACT) {
    return Bad(What(array), "has a layout that panofix does not write");
  }
  if (H5Pget_external_count(list.get()) != 0) return Bad(What(array), "is stored in another file");
  return {};
}

Result<Handle> Hdf5Reader::Impl::OpenAttribute(const std::string& attribute) const {
  if (H5Aexists_by_name(file.get(), ".", attribute.c_str(), H5P_DEFAULT) <= 0) {
    return Status(ErrorCode::kNotFound, What(attribute) + " is not among the file's attributes; " +
                                            "build it again with this release");
  }
  Handle opened(H5Aopen_by_name(file.get(), ".", attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT),
                H5Aclose);
  if (!opened.valid()) return Bad(What(attribute), "cannot be opened (" + hdf5::LastError() + ")");
  const Handle space(H5Aget_space(opened.get()), H5Sclose);
  if (H5Sget_simple_extent_type(space.get()) != H5S_SCALAR) {
    return Bad(What(attribute), "is not a single value");
  }
  return opened;
}

Result<Hdf5Reader> Hdf5Reader::Open(int fd, const std::string& name) {
  const auto impl = std::make_shared<Impl>();
  impl->name = name;
  impl->fd = UniqueFd(::fcntl(fd, F_DUPFD_CLOEXEC, 0));
  struct stat info {};
  if (!impl->fd.valid() || ::fstat(impl->fd.get(), &info) != 0) {
    return Status(ErrorCode::kIo, name + ": cannot be read (" + std::strerror(errno) +
                                      "); raise the limit of open files");
  }
  if (!S_ISREG(info.st_mode)) {
    return Status(ErrorCode::kInvalidArgument, name + ": is not a file; name an HDF5 file");
  }
  impl->file_bytes = static_cast<std::uint64_t>(info.st_size);
  const hdf5::Lock lock;
  H5PLset_loading_state(0);  // no code from plug-ins that a file asks for
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG);
  if (hdf5::UseDescriptor(access.get(), impl->fd.get())) {
    impl->file = Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose);
  }
  if (!impl->file.valid()) return Bad(name, "is not a whole HDF5 file (" + hdf5::LastError() + ")");
  Hdf5Reader reader;
  reader.impl_ = impl;
  return reader;
}

Result<Hdf5Reader> Hdf5Reader::Open(const std::filesystem::path& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.valid()) return Open(fd.get(), path.string());
  const bool absent = errno == ENOENT || errno == ENOTDIR;
  return Status(absent ? ErrorCode::kNotFound : ErrorCode::kIo,
                path.string() + ": cannot be opened (" + std::strerror(errno) +
                    "); name a file that exists and may be read");
}

Result<Hdf5Reader::Raw> Hdf5Reader::ReadRaw(const std::string& name, ArrayType type,
                                            std::int64_t cols) const {
  const Impl& in = *impl_;
  const std::size_t element_bytes = hdf5::ElementBytes(type);
  const hdf5::Lock lock;
  Result<Handle> opened = in.OpenDataset(name);
  if (!opened.ok()) return opened.status();
  const Handle& dataset = *opened;
  const Status storage = in.CheckStorage(dataset, type, name);
  if (!storage.ok()) return storage;
  const Handle space(H5Dget_space(dataset.get()), H5Sclose);
  const Result<Extent> extent = ExtentOf(space, element_bytes, in.file_bytes, in.What(name));
  if (!extent.ok()) return extent.status();
  if (cols >= 0 && extent->cols != cols) {
    return Bad(in.What(name),
               Format("has %lld columns, not %lld", static_cast<long long>(extent->cols),
                      static_cast<long long>(cols)));
  }
  Raw raw;
  raw.rows = extent->rows, raw.cols = extent->cols;
  if (extent->bytes == 0) return raw;

  const haddr_t offset = H5Dget_offset(dataset.get());
  if (offset != HADDR_UNDEF && offset % element_bytes == 0) {
    if (offset > in.file_bytes || extent->bytes > in.file_bytes - offset) {
      return Bad(in.What(name), "lies beyond the end of the file");
    }
    raw.owner = MapFile(in.fd.get(), offset, extent->bytes);
  }
  if (raw.owner == nullptr) {
    const std::size_t words = (extent->bytes + 7) / 8;
    const std::shared_ptr<std::uint64_t[]> copy(new (std::nothrow) std::uint64_t[words]);
    if (copy == nullptr) {
      return Status(ErrorCode::kTooLarge, in.What(name) + " does not fit into memory; free some");
    }
    if (H5Dread(dataset.get(), hdf5::DiskType(type), H5S_ALL, H5S_ALL, H5P_DEFAULT, copy.get()) <
        0) {
      return Bad(in.What(name), "cannot be read (" + hdf5::LastError() + ")");
    }
    raw.owner = std::shared_ptr<const void>(copy, copy.get());
  }
  raw.data = raw.owner.get();
  return raw;
}

Result<std::vector<std::string>> Hdf5Reader::ReadStrings(const std::string& name) const {
  const Result<MappedArray<std::uint8_t>> array = Read<std::uint8_t>(name);
  if (!array.ok()) return array.status();
  const std::string_view text(reinterpret_cast<const char*>(array->values.data()),
                              array->values.size());
  if (!text.empty() && text.back() != '\n') {
    return Bad(impl_->What(name), "ends within a string");
  }
  std::vector<std::string> values;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = text.find('\n', start);
    values.emplace_back(text.substr(start, end - start));
    start = end + 1;
  }
  return values;
}

Result<std::int64_t> Hdf5Reader::ReadIntAttribute(const std::string& name) const {
  const hdf5::Lock lock;
  const Result<Handle> attribute = impl_->OpenAttribute(name);
  if (!attribute.ok()) return attribute.status();
  const Handle type(H5Aget_type(attribute->get()), H5Tclose);
  std::int64_t value = 0;
  if (H5Tequal(type.get(), H5T_STD_I64LE) <= 0 ||
      H5Aread(attribute->get(), H5T_NATIVE_INT64, &value) < 0) {
    return Bad(impl_->What(name), "is not a 64-bit integer");
  }
  return value;
}

Result<std::string> Hdf5Reader::ReadStringAttribute(const std::string& name) const {
  const hdf5::Lock lock;
  const Result<Handle> attribute = impl_->OpenAttribute(name);
  if (!attribute.ok()) return attribute.status();
  const Handle type(H5Aget_type(attribute->get()), H5Tclose);
  const std::size_t bytes = H5Tget_size(type.get());
  if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) != 0 || bytes == 0 ||
      bytes > kMaxAttributeBytes || bytes > impl_->file_bytes) {
    return Bad(impl_->What(name), "is not a string of fixed length");
  }
  std::string value(bytes, '\0');
  if (H5Aread(attribute->get(), type.get(), value.data()) < 0) {
    return Bad(impl_->What(name), "cannot be read (" + hdf5::LastError() + ")");
  }
  value.resize(std::strlen(value.c_str()));
  return value;
}

}  // namespace panofix
