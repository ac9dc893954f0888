#include "common/io/hdf5_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <hdf5.h>
#include <unistd.h>

#include <chrono>
#include <limits>
#include <thread>

#include "tests/common/io/temp_folder.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

template <typename T>
std::vector<T> Ramp(std::size_t size) {
  std::vector<T> values(size);
  for (std::size_t i = 0; i < size; ++i) values[i] = static_cast<T>(i * 37 % 251);
  if (size > 1) {
    values[0] = std::numeric_limits<T>::lowest();
    values[1] = std::numeric_limits<T>::max();
  }
  return values;
}

Hdf5Reader OpenOrDie(const fs::path& path) { return ValueOrThrow(Hdf5Reader::Open(path)); }

template <typename T>
class Hdf5RoundTrip : public testing::Test {};
using ElementTypes = testing::Types<std::uint8_t, std::int32_t, std::uint32_t, std::int64_t,
                                    std::uint64_t, float, double>;
TYPED_TEST_SUITE(Hdf5RoundTrip, ElementTypes);

// Sizes from nothing to arrays that get an alignment of their own; 16385 x 4 bytes is past 64 KiB.
TYPED_TEST(Hdf5RoundTrip, ValuesAndShapeReturn) {
  const TempFolder folder;
  const std::size_t sizes[] = {0, 3, 999, 16386, 70002};
  {
    Hdf5Writer writer(folder / "f.h5");
    for (const std::size_t size : sizes) {
      const auto values = Ramp<TypeParam>(size);
      writer.Write<TypeParam>("group/deep/flat" + std::to_string(size), values);
      writer.Write<TypeParam>("group/wide" + std::to_string(size), values, 3);
    }
    writer.Close();
  }
  const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
  for (const std::size_t size : sizes) {
    const auto expected = Ramp<TypeParam>(size);
    const auto flat = reader.Read<TypeParam>("group/deep/flat" + std::to_string(size));
    ASSERT_TRUE(flat.ok()) << flat.status().message();
    EXPECT_EQ(flat->rows, static_cast<std::int64_t>(size));
    EXPECT_EQ(flat->cols, 1);
    EXPECT_TRUE(
        std::equal(expected.begin(), expected.end(), flat->values.begin(), flat->values.end()));
    const auto wide = reader.Read<TypeParam>("group/wide" + std::to_string(size), -1);
    ASSERT_TRUE(wide.ok()) << wide.status().message();
    EXPECT_EQ(wide->rows, static_cast<std::int64_t>(size / 3));
    EXPECT_EQ(wide->cols, 3);
    EXPECT_TRUE(
        std::equal(expected.begin(), expected.end(), wide->values.begin(), wide->values.end()));
  }
}

TEST(Hdf5File, StringsAndAttributesReturn) {
  const TempFolder folder;
  const std::vector<std::string> strings{"", "pano 1", "rue de l'Église", "", "x,\"y\"", ""};
  {
    Hdf5Writer writer(folder / "f.h5");
    writer.WriteStrings("ids", strings);
    writer.WriteStrings("none", {});
    writer.WriteStrings("one_empty", {""});
    writer.WriteAttribute("version", std::int64_t{-7});
    writer.WriteAttribute("name", std::string("Église"));
    writer.WriteAttribute("empty", std::string());
    writer.Close();
  }
  const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
  EXPECT_EQ(*reader.ReadStrings("ids"), strings);
  EXPECT_EQ(*reader.ReadStrings("none"), std::vector<std::string>());
  EXPECT_EQ(*reader.ReadStrings("one_empty"), std::vector<std::string>{""});
  EXPECT_EQ(*reader.ReadIntAttribute("version"), -7);
  EXPECT_EQ(*reader.ReadStringAttribute("name"), "Église");
  EXPECT_EQ(*reader.ReadStringAttribute("empty"), "");
  EXPECT_EQ(reader.ReadIntAttribute("name").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(reader.ReadStringAttribute("version").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(reader.ReadIntAttribute("absent").status().code(), ErrorCode::kNotFound);
}

TEST(Hdf5File, LargeArraysStartOnAPage) {
  const TempFolder folder;
  constexpr std::uintptr_t kPageBytes = 4096;
  {
    Hdf5Writer writer(folder / "f.h5");
    writer.Write<std::uint8_t>("odd", Ramp<std::uint8_t>(13));
    writer.Write<double>("big", Ramp<double>(8192));
    writer.Write<std::uint8_t>("bytes", Ramp<std::uint8_t>(65536));
    writer.Close();
  }
  const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
  const auto big = ValueOrThrow(reader.Read<double>("big"));
  const auto bytes = ValueOrThrow(reader.Read<std::uint8_t>("bytes"));
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(big.values.data()) % kPageBytes, 0U);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(bytes.values.data()) % kPageBytes, 0U);
}

TEST(Hdf5File, ArraysOutliveTheirReaderAndTheFilesName) {
  const TempFolder folder;
  const auto values = Ramp<float>(40'000);
  {
    Hdf5Writer writer(folder / "f.h5");
    writer.Write<float>("x", values);
    writer.Close();
  }
  MappedArray<float> array;
  {
    const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
    array = ValueOrThrow(reader.Read<float>("x"));
  }
  // A new file of the same name does not disturb the old one's mapping.
  Hdf5Writer replacement(folder / "f.h5");
  replacement.Close();
  fs::remove(folder / "f.h5");
  EXPECT_TRUE(std::equal(values.begin(), values.end(), array.values.begin(), array.values.end()));
}

TEST(Hdf5File, EqualContentMakesEqualBytes) {
  const TempFolder folder;
  const auto write = [&](const std::string& name) {
    Hdf5Writer writer(folder / name);
    writer.Write<float>("a/b/x", Ramp<float>(30'000), 3);
    writer.Write<std::uint8_t>("a/none", {});
    writer.WriteStrings("ids", {"p", "q"});
    writer.WriteAttribute("version", std::int64_t{1});
    writer.Close();
  };
  write("one.h5");
  std::this_thread::sleep_for(std::chrono::seconds(2));  // HDF5's time stamps count seconds
  write("two.h5");
  EXPECT_EQ(ReadText(folder / "one.h5"), ReadText(folder / "two.h5"));
}

TEST(Hdf5File, OtherProgramsReadOurFiles) {
  const TempFolder folder;
  const std::vector<double> values{1.5, -2};
  Hdf5Writer writer(folder / "f.h5");
  writer.Write<double>("group/x", values);
  writer.Close();
  const hid_t file = H5Fopen((folder / "f.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t set = H5Dopen2(file, "group/x", H5P_DEFAULT);
  std::vector<double> read(2);
  EXPECT_GE(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, read.data()), 0);
  EXPECT_EQ(read, values);
  H5Dclose(set), H5Fclose(file);
}

TEST(Hdf5File, ConcurrentReads) {
  const TempFolder folder;
  const auto values = Ramp<std::int32_t>(20'000);
  {
    Hdf5Writer writer(folder / "f.h5");
    writer.Write<std::int32_t>("x", values);
    writer.Close();
  }
  const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
  std::vector<std::thread> threads;
  std::vector<int> num_right(4, 0);
  for (int& count : num_right) {
    threads.emplace_back([&] {
      for (int i = 0; i < 50; ++i) {
        const Hdf5Reader own = OpenOrDie(folder / "f.h5");
        const auto shared = reader.Read<std::int32_t>("x");
        const auto mine = own.Read<std::int32_t>("x");
        count += shared.ok() && mine.ok() && shared->values[7] == values[7] &&
                 mine->values[19'999] == values[19'999];
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(num_right, std::vector<int>(4, 50));
}

// Layouts that other programs write: read by copy, or refused.
TEST(Hdf5File, AnOpenDescriptorIsReadThoughItsNameIsGoneOrTaken) {
  const TempFolder folder;
  const std::vector<float> mine{1}, other{2};
  const auto write = [&](std::span<const float> values) {
    Hdf5Writer writer(folder / "f.h5");
    writer.Write<float>("x", values);
    writer.Close();
  };
  write(mine);
  const int fd = ::open((folder / "f.h5").c_str(), O_RDONLY);
  fs::remove(folder / "f.h5");
  EXPECT_EQ(ValueOrThrow(ValueOrThrow(Hdf5Reader::Open(fd, "gone")).Read<float>("x")).values[0], 1);
  write(other);
  const auto reader = ValueOrThrow(Hdf5Reader::Open(fd, "swapped"));
  ::close(fd);  // the reader keeps its own
  EXPECT_EQ(ValueOrThrow(reader.Read<float>("x")).values[0], 1);
}

TEST(Hdf5File, NothingOnDiskBeforeCloseAndTheOldFileUntilThen) {
  const TempFolder folder;
  const std::vector<float> one{1}, two{2};
  {
    Hdf5Writer abandoned(folder / "f.h5");
    abandoned.Write<float>("x", one);
  }
  EXPECT_FALSE(fs::exists(folder / "f.h5"));
  Hdf5Writer first(folder / "f.h5");
  first.Write<float>("x", one);
  first.Close();
  first.Close();
  const Hdf5Reader reader = OpenOrDie(folder / "f.h5");
  Hdf5Writer second(folder / "f.h5");  // beside an open reader of the same path
  second.Write<float>("x", two);
  EXPECT_EQ(ValueOrThrow(OpenOrDie(folder / "f.h5").Read<float>("x")).values[0], 1);
  second.Close();
  EXPECT_EQ(ValueOrThrow(OpenOrDie(folder / "f.h5").Read<float>("x")).values[0], 2);
  EXPECT_EQ(ValueOrThrow(reader.Read<float>("x")).values[0], 1);
}

class ForeignFile : public testing::Test {
 protected:
  // A file with dataset "x" of 10 i32 (0..9), created with `list` from disk type `type`.
  fs::path Make(hid_t list, hid_t type = H5T_STD_I32LE) {
    const fs::path path = folder_ / ("foreign" + std::to_string(num_made_++) + ".h5");
    const hsize_t dims[1] = {10};
    std::vector<int> values(10);
    for (int i = 0; i < 10; ++i) values[static_cast<std::size_t>(i)] = i;
    const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    const hid_t space = H5Screate_simple(1, dims, nullptr);
    const hid_t set = H5Dcreate2(file, "x", type, space, H5P_DEFAULT, list, H5P_DEFAULT);
    EXPECT_GE(H5Dwrite(set, H5T_NATIVE_INT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
    H5Lcreate_external("/etc/other.h5", "/x", file, "outside", H5P_DEFAULT, H5P_DEFAULT);
    H5Lcreate_soft("/x", file, "soft", H5P_DEFAULT, H5P_DEFAULT);
    H5Dclose(set), H5Sclose(space), H5Fclose(file), H5Pclose(list);
    return path;
  }
  TempFolder folder_;
  int num_made_ = 0;
};

TEST_F(ForeignFile, CompactAndChunkedAreCopied) {
  for (const H5D_layout_t layout : {H5D_COMPACT, H5D_CHUNKED}) {
    const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
    const hsize_t chunk[1] = {4};
    layout == H5D_CHUNKED ? H5Pset_chunk(list, 1, chunk) : H5Pset_layout(list, layout);
    const Hdf5Reader reader = OpenOrDie(Make(list));
    const auto array = reader.Read<std::int32_t>("x");
    ASSERT_TRUE(array.ok()) << array.status().message();
    ASSERT_EQ(array->rows, 10);
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(array->values[i], static_cast<int>(i));
  }
}

TEST_F(ForeignFile, BigEndianExternalStorageAndLinksAreRefused) {
  const Hdf5Reader big_endian = OpenOrDie(Make(H5Pcreate(H5P_DATASET_CREATE), H5T_STD_I32BE));
  EXPECT_EQ(big_endian.Read<std::int32_t>("x").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(big_endian.Read<std::int32_t>("outside").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(big_endian.Read<std::int32_t>("soft").status().code(), ErrorCode::kBadData);
  const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
  WriteText(folder_ / "raw.bin", std::string(40, '\0'));
  H5Pset_external(list, (folder_ / "raw.bin").c_str(), 0, 40);
  const Hdf5Reader external = OpenOrDie(Make(list));
  EXPECT_EQ(external.Read<std::int32_t>("x").status().code(), ErrorCode::kBadData);
}

class FaultyFile : public testing::Test {
 protected:
  FaultyFile() {
    Hdf5Writer writer(path_);
    writer.Write<float>("group/x", Ramp<float>(60'000), 3);
    writer.Write<std::uint8_t>("bytes", std::vector<std::uint8_t>{'a', '\n', 'b'});
    writer.Close();
  }
  TempFolder folder_;
  fs::path path_ = folder_ / "f.h5";
};

TEST_F(FaultyFile, WrongTypeColumnsAndNames) {
  const Hdf5Reader reader = OpenOrDie(path_);
  const auto code = [](const auto& result) { return result.status().code(); };
  EXPECT_EQ(code(reader.Read<double>("group/x", 3)), ErrorCode::kBadData);
  EXPECT_EQ(code(reader.Read<std::int32_t>("group/x", 3)), ErrorCode::kBadData);
  EXPECT_EQ(code(reader.Read<std::uint32_t>("group/x", 3)), ErrorCode::kBadData);
  EXPECT_EQ(code(reader.Read<float>("group/x", 2)), ErrorCode::kBadData);
  EXPECT_EQ(code(reader.Read<float>("group/x")), ErrorCode::kBadData);
  EXPECT_EQ(code(reader.Read<float>("group/y", 3)), ErrorCode::kNotFound);
  EXPECT_EQ(code(reader.Read<float>("no/x", 3)), ErrorCode::kNotFound);
  EXPECT_FALSE(reader.Read<float>("group", 3).ok());
  EXPECT_FALSE(reader.Read<float>("", 3).ok());
  EXPECT_FALSE(reader.Read<float>("/", 3).ok());
  EXPECT_FALSE(reader.Read<float>("group//", 3).ok());
  EXPECT_EQ(code(reader.ReadStrings("bytes")), ErrorCode::kBadData);  // last one not ended
  const std::string message = reader.Read<float>("group/y", 3).status().message();
  EXPECT_NE(message.find("f.h5"), std::string::npos);
  EXPECT_NE(message.find("group/y"), std::string::npos);
}

TEST_F(FaultyFile, TruncatedAnywhereDoesNotOpenOrRead) {
  const std::string whole = ReadText(path_);
  for (std::size_t share = 0; share < 20; ++share) {
    const fs::path cut = folder_ / "cut.h5";
    WriteText(cut, whole.substr(0, whole.size() * share / 20));
    const auto reader = Hdf5Reader::Open(cut);
    ASSERT_FALSE(reader.ok()) << "opened with " << share << "/20 of its bytes";
    EXPECT_EQ(reader.status().code(), ErrorCode::kBadData);
  }
}

TEST_F(FaultyFile, AbsentFolderAndOtherContent) {
  EXPECT_EQ(Hdf5Reader::Open(folder_ / "absent.h5").status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(Hdf5Reader::Open(folder_.path()).status().code(), ErrorCode::kInvalidArgument);
  WriteText(folder_ / "text.h5", "not an HDF5 file at all");
  EXPECT_EQ(Hdf5Reader::Open(folder_ / "text.h5").status().code(), ErrorCode::kBadData);
  EXPECT_EQ(Hdf5Reader::Open(-1, "closed").status().code(), ErrorCode::kIo);
}

TEST_F(FaultyFile, WritersMisuseIsALogicError) {
  Hdf5Writer writer(folder_ / "w.h5");
  const std::vector<float> seven(7);
  EXPECT_THROW(writer.Write<float>("x", seven, 3), std::logic_error);
  EXPECT_THROW(writer.Write<float>("x", seven, 0), std::logic_error);
  EXPECT_THROW(writer.WriteStrings("s", {"a\nb"}), std::logic_error);
  EXPECT_THROW(writer.WriteAttribute("a", std::string("\0x", 2)), std::logic_error);
  writer.Write<float>("x", seven);
  EXPECT_THROW(writer.Write<float>("x", seven), Error);  // the name is taken
  writer.Close();
  EXPECT_THROW(writer.Write<float>("y", seven), std::logic_error);
  EXPECT_THROW(Hdf5Writer(folder_ / "no/w.h5"), Error);
}

}  // namespace
}  // namespace panofix
