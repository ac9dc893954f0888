#include "common/drive/csv.h"

#include <gtest/gtest.h>

#include "common/base/rng.h"

namespace panofix {
namespace {

// All records of two columns, or the failure's message.
std::vector<std::vector<std::string>> Records(const std::string& text,
                                              std::string* fault = nullptr) {
  std::vector<std::vector<std::string>> records;
  auto table = CsvReader::Parse(text, "t.csv", {"a", "b"});
  Result<bool> more = table.ok() ? table->Next() : Result<bool>(table.status());
  for (; more.ok() && *more; more = table->Next()) {
    records.push_back({table->Text(0), table->Text(1)});
  }
  if (fault != nullptr) *fault = more.status().message();
  EXPECT_TRUE(more.ok() || fault != nullptr) << more.status().message();
  return records;
}

using Table = std::vector<std::vector<std::string>>;

TEST(Csv, ColumnsInAnyOrderExtraOnesIgnored) {
  EXPECT_EQ(Records("x,b,a\n1,2,3\n4,5,6\n"), (Table{{"3", "2"}, {"6", "5"}}));
}

TEST(Csv, LineEndsBlankLinesAndByteOrderMark) {
  EXPECT_EQ(Records("\xEF\xBB\xBF"
                    "a,b\r\n1,2\r\n\r\n3,4"),
            (Table{{"1", "2"}, {"3", "4"}}));
  EXPECT_EQ(Records(" a , b \n1,\n"), (Table{{"1", ""}}));
  EXPECT_EQ(Records("a,b\n"), Table());
}

TEST(Csv, QuotedFields) {
  EXPECT_EQ(Records("a,b\n\"1,\"\"x\"\"\",\"two\nlines\"\n"), (Table{{"1,\"x\"", "two\nlines"}}));
}

TEST(Csv, FieldsRoundTrip) {
  const std::string hard[] = {"", "plain", "a,b", "\"", "\"\"", "a\nb", "a\r\nb", " lead", "é"};
  for (const std::string& first : hard) {
    for (const std::string& second : hard) {
      // A record of two empty fields is ",": not a blank line.
      EXPECT_EQ(Records("a,b\n" + CsvField(first) + "," + CsvField(second) + "\n"),
                (Table{{first, second}}));
    }
  }
}

TEST(Csv, FaultsNameFileLineAndMend) {
  std::string fault;
  Records("", &fault);
  EXPECT_EQ(fault, "t.csv: is empty; the header line needs the columns a,b");
  Records("a,c\n", &fault);
  EXPECT_EQ(fault, "t.csv:1: column 'b' is missing; the header line needs the columns a,b");
  Records("a,b,a\n", &fault);
  EXPECT_EQ(fault, "t.csv:1: column 'a' stands twice; the header line needs the columns a,b");
  EXPECT_EQ(Records("a,b\n1,2\n\n1,2,3\n", &fault).size(), 1U);
  EXPECT_NE(fault.find("t.csv:4: 3 fields where the header has 2"), std::string::npos) << fault;
  Records("a,b\n1,\"2\n3,4\n", &fault);
  EXPECT_NE(fault.find("t.csv:2: a quote is opened and never closed"), std::string::npos) << fault;
}

TEST(Csv, NumbersAreWholeFields) {
  const auto parse = [](const std::string& field) {
    auto table = CsvReader::Parse("n\n" + field + "\n", "t.csv", {"n"});
    EXPECT_TRUE(table->Next().ok());
    return std::pair(table->Integer(0), table->Number(0, -1e6, 1e6));
  };
  EXPECT_EQ(*parse("42").first, 42);
  EXPECT_EQ(*parse(" -42 ").first, -42);
  EXPECT_EQ(*parse("-12.5").second, -12.5);
  EXPECT_EQ(*parse("1e3").second, 1000);
  for (const char* bad : {"x", "1x", "1.5", "99999999999999999999", "0x10", "1 2"}) {
    EXPECT_EQ(parse(bad).first.status().code(), ErrorCode::kBadData) << bad;
  }
  for (const char* bad : {"x", "1.5x", "nan", "inf", "-inf", "1e400", "1e7"}) {
    EXPECT_EQ(parse(bad).second.status().code(), ErrorCode::kBadData) << bad;
  }
}

// Whatever the bytes: an end, a record of the right width or a Status; never more records than
// bytes.
TEST(Csv, RandomBytesEndHonestly) {
  Rng rng(7, "test/csv");
  constexpr std::string_view kAlphabet = "ab,,\"\"\n\n\r1\0\xff";
  for (int round = 0; round < 5000; ++round) {
    std::string text = "a,b\n";
    const std::uint64_t length = rng.Below(40);
    for (std::uint64_t i = 0; i < length; ++i) text += kAlphabet[rng.Below(kAlphabet.size())];
    std::string fault;
    const auto records = Records(text, &fault);
    ASSERT_LT(records.size(), text.size());
    if (!fault.empty()) {
      ASSERT_EQ(fault.rfind("t.csv:", 0), 0U);
      ASSERT_EQ(fault.find('\n'), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace panofix
