#include "runtime/store/download.h"

#include <gtest/gtest.h>

#include "tests/runtime/store/http_server.h"
#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

class DownloadTest : public StoreKit {
 protected:
  [[nodiscard]] HttpBehaviour Good() {
    HttpBehaviour b;
    b.content = PackageBytes(EntriesOf(Bundle(1)));
    return b;
  }
  [[nodiscard]] Result<InstallReport> FromUrl(const std::string& url) const {
    return InstallFrom(layout_, url, {}, options_);
  }
  DownloadOptions options_;
};

TEST_F(DownloadTest, AUrlIsInstalledAndNothingStays) {
  const HttpServer server(Good());
  const auto report = FromUrl(server.url());
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->build, 1);
  EXPECT_TRUE(fs::is_empty(layout_.downloads()));
  EXPECT_EQ(server.requests().size(), 1U);
}

TEST_F(DownloadTest, AFolderAFileAndAFileUrlDoToo) {
  WriteText(folder_ / "one.pfb", Good().content);
  EXPECT_TRUE(FromUrl(Bundle(1)).ok());
  EXPECT_TRUE(FromUrl(folder_ / "one.pfb").ok());
  const auto report = FromUrl("file://" + (folder_ / "one.pfb").string());
  EXPECT_TRUE(report.ok()) << report.status().message();
}

TEST_F(DownloadTest, ItGoesOnWhereItWasCutOff) {
  HttpBehaviour cut = Good();
  cut.cut_after = static_cast<std::int64_t>(cut.content.size() / 4);
  HttpServer server(cut);
  const Status first = FromUrl(server.url()).status();
  EXPECT_EQ(first.code(), ErrorCode::kIo) << first.message();
  EXPECT_NE(first.message().find("run it again to go on"), std::string::npos);
  server.Change(Good());
  const auto report = FromUrl(server.url());
  ASSERT_TRUE(report.ok()) << report.status().message();
  // Three tries of a quarter each, then the rest.
  const auto requests = server.requests();
  ASSERT_EQ(requests.size(), 4U);
  const auto size = Good().content.size() / 4;
  for (std::size_t i = 1; i < 4; ++i) {
    EXPECT_NE(requests[i].find("Range: bytes=" + std::to_string(i * size) + "-"), std::string::npos)
        << requests[i];
    EXPECT_NE(requests[i].find("If-Range: \"one\""), std::string::npos);
  }
}

TEST_F(DownloadTest, AFileThatChangedMeanwhileIsFetchedAnew) {
  HttpBehaviour cut = Good();
  cut.cut_after = 5000;
  HttpServer server(cut);
  EXPECT_FALSE(FromUrl(server.url()).ok());
  HttpBehaviour other = Good();
  other.content = PackageBytes(EntriesOf(Bundle(2)));
  other.etag = "\"two\"";
  server.Change(other);
  const auto report = FromUrl(server.url());
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->build, 2);
}

TEST_F(DownloadTest, PiecesOfTwoFilesAreFetchedAnew) {
  // Without a tag nobody can tell; the hashes do.
  HttpBehaviour cut = Good();
  cut.etag.clear();
  cut.cut_after = 5000;
  HttpServer server(cut);
  EXPECT_FALSE(FromUrl(server.url()).ok());
  HttpBehaviour other = Good();
  other.etag.clear();
  other.content = PackageBytes(EntriesOf(Bundle(2)));
  server.Change(other);
  const auto report = FromUrl(server.url());
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->build, 2);
}

TEST_F(DownloadTest, AServerWithoutRangesIsAskedForAllOfIt) {
  HttpBehaviour cut = Good();
  cut.cut_after = 5000;
  HttpServer server(cut);
  EXPECT_FALSE(FromUrl(server.url()).ok());
  HttpBehaviour simple = Good();
  simple.knows_ranges = false;
  server.Change(simple);
  const auto report = FromUrl(server.url());
  EXPECT_TRUE(report.ok()) << report.status().message();
}

TEST_F(DownloadTest, EndlessDataIsCutOff) {
  HttpBehaviour endless;
  endless.is_endless = true;
  const HttpServer server(endless);
  options_.max_bytes = 300000;
  const Status status = FromUrl(server.url()).status();
  EXPECT_EQ(status.code(), ErrorCode::kEndlessData) << status.message();
  EXPECT_NE(status.message().find("--max-bytes"), std::string::npos);
  EXPECT_FALSE(fs::exists(layout_.downloads() / "x")) << "nothing large stays";
  for (const auto& entry : fs::directory_iterator(layout_.downloads()))
    EXPECT_LT(fs::file_size(entry), 1000U) << entry.path();
}

TEST_F(DownloadTest, EndlessTimeIsCutOff) {
  HttpBehaviour stalled;
  stalled.is_stalled = true;
  const HttpServer server(stalled);
  options_.timeout_s = 0.5;
  const Status status = FromUrl(server.url()).status();
  EXPECT_EQ(status.code(), ErrorCode::kEndlessData) << status.message();
  EXPECT_NE(status.message().find("--timeout-s"), std::string::npos);
}

TEST_F(DownloadTest, AddressesThatLeadNowhere) {
  HttpBehaviour b = Good();
  b.status = 404;
  HttpServer server(b);
  EXPECT_EQ(FromUrl(server.url()).status().code(), ErrorCode::kNotFound);
  b.status = 503;
  server.Change(b);
  EXPECT_EQ(FromUrl(server.url()).status().code(), ErrorCode::kIo);
  EXPECT_EQ(FromUrl("http://127.0.0.1:1/x.pfb").status().code(), ErrorCode::kIo);
  EXPECT_EQ(FromUrl("gopher://127.0.0.1/x").status().code(), ErrorCode::kInvalidArgument);
  EXPECT_EQ(FromUrl("file:///none/x.pfb").status().code(), ErrorCode::kNotFound);
  EXPECT_EQ(FromUrl("/none/x.pfb").status().code(), ErrorCode::kNotFound);
}

TEST_F(DownloadTest, ARedirectionDoesNotReachLocalFiles) {
  WriteText(folder_ / "one.pfb", Good().content);
  HttpBehaviour b;
  b.redirect_to = "file://" + (folder_ / "one.pfb").string();
  const HttpServer server(b);
  EXPECT_EQ(FromUrl(server.url()).status().code(), ErrorCode::kInvalidArgument);
}

TEST_F(DownloadTest, AHostilePackageIsRefusedAndGone) {
  HttpBehaviour b = Good();
  b.content[b.content.size() / 2] ^= 1;
  const HttpServer server(b);
  EXPECT_FALSE(FromUrl(server.url()).ok());
  EXPECT_TRUE(fs::is_empty(layout_.downloads()));
}

}  // namespace
}  // namespace panofix
