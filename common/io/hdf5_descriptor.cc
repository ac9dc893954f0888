// An HDF5 file driver over an open descriptor. The library's own drivers take a path: that can be
// swapped under a verified file, and 1.10 refuses the path of an unlinked one.
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "common/io/hdf5_support.h"

namespace panofix::hdf5 {
namespace {

constexpr haddr_t kMaxAddress = (haddr_t{1} << 62) - 1;

// H5FD_t must come first: the library holds pointers to it.
struct File {
  H5FD_t base;
  int fd;
  bool writable;
  haddr_t end_of_allocation, end_of_file;
};
static_assert(offsetof(File, base) == 0);

File* Cast(H5FD_t* file) { return reinterpret_cast<File*>(file); }
const File* Cast(const H5FD_t* file) { return reinterpret_cast<const File*>(file); }

herr_t Fail(const char* reason) {
  H5Epush2(H5E_DEFAULT, __FILE__, __func__, __LINE__, H5E_ERR_CLS, H5E_IO, H5E_READERROR, "%s",
           reason);
  return -1;
}

H5FD_t* Open(const char* /*name*/, unsigned flags, hid_t access_list, haddr_t /*max_address*/) {
  const auto* fd = static_cast<const int*>(H5Pget_driver_info(access_list));
  struct stat info {};
  if (fd == nullptr || ::fstat(*fd, &info) != 0) {
    Fail("no open descriptor");
    return nullptr;
  }
  auto* file = new (std::nothrow) File{};
  if (file == nullptr) return nullptr;
  file->fd = *fd;
  file->writable = (flags & H5F_ACC_RDWR) != 0;
  file->end_of_file = static_cast<haddr_t>(info.st_size);
  return &file->base;
}

// The descriptor stays its owner's.
herr_t Close(H5FD_t* file) {
  delete Cast(file);
  return 0;
}

herr_t Query(const H5FD_t* /*file*/, unsigned long* flags) {
  *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
           H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
  return 0;
}

haddr_t GetEndOfAllocation(const H5FD_t* file, H5FD_mem_t /*type*/) {
  return Cast(file)->end_of_allocation;
}

herr_t SetEndOfAllocation(H5FD_t* file, H5FD_mem_t /*type*/, haddr_t address) {
  Cast(file)->end_of_allocation = address;
  return 0;
}

haddr_t GetEndOfFile(const H5FD_t* file, H5FD_mem_t /*type*/) { return Cast(file)->end_of_file; }

herr_t Read(H5FD_t* file, H5FD_mem_t /*type*/, hid_t /*list*/, haddr_t address, std::size_t size,
            void* buffer) {
  if (address > kMaxAddress || size > kMaxAddress - address) return Fail("address out of range");
  auto* out = static_cast<std::uint8_t*>(buffer);
  while (size > 0) {
    const ssize_t got = ::pread(Cast(file)->fd, out, size, static_cast<off_t>(address));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Fail(std::strerror(errno));
    if (got == 0) {  // beyond the end lie zeros: space allocated and not yet written
      std::memset(out, 0, size);
      return 0;
    }
    out += got, address += static_cast<haddr_t>(got), size -= static_cast<std::size_t>(got);
  }
  return 0;
}

herr_t Write(H5FD_t* file, H5FD_mem_t /*type*/, hid_t /*list*/, haddr_t address, std::size_t size,
             const void* buffer) {
  if (address > kMaxAddress || size > kMaxAddress - address) return Fail("address out of range");
  const auto* in = static_cast<const std::uint8_t*>(buffer);
  while (size > 0) {
    const ssize_t put = ::pwrite(Cast(file)->fd, in, size, static_cast<off_t>(address));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return Fail(std::strerror(errno));
    in += put, address += static_cast<haddr_t>(put), size -= static_cast<std::size_t>(put);
  }
  Cast(file)->end_of_file = std::max(Cast(file)->end_of_file, address);
  return 0;
}

herr_t Truncate(H5FD_t* file, hid_t /*list*/, hbool_t /*closing*/) {
  File& f = *Cast(file);
  if (!f.writable || f.end_of_file == f.end_of_allocation) return 0;
  if (::ftruncate(f.fd, static_cast<off_t>(f.end_of_allocation)) != 0) {
    return Fail(std::strerror(errno));
  }
  f.end_of_file = f.end_of_allocation;
  return 0;
}

H5FD_class_t DriverClass() {
  H5FD_class_t driver{};
  driver.name = "panofix descriptor";
  driver.maxaddr = kMaxAddress;
  driver.fc_degree = H5F_CLOSE_STRONG;
  driver.fapl_size = sizeof(int);
  driver.open = Open;
  driver.close = Close;
  driver.query = Query;
  driver.get_eoa = GetEndOfAllocation;
  driver.set_eoa = SetEndOfAllocation;
  driver.get_eof = GetEndOfFile;
  driver.read = Read;
  driver.write = Write;
  driver.truncate = Truncate;
  const H5FD_mem_t two_kinds[] = H5FD_FLMAP_DICHOTOMY;
  std::copy(std::begin(two_kinds), std::end(two_kinds), std::begin(driver.fl_map));
  return driver;
}

}  // namespace

bool UseDescriptor(hid_t access_list, int fd) {
  static const H5FD_class_t driver_class = DriverClass();
  static const hid_t driver = H5FDregister(&driver_class);
  return driver >= 0 && H5Pset_driver(access_list, driver, &fd) >= 0;
}

}  // namespace panofix::hdf5
