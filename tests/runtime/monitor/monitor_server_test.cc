// What a browser or a scraper gets over real sockets.
#include "runtime/monitor/monitor_server.h"

#include <gtest/gtest.h>
#include <httplib.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "common/base/log.h"
#include "runtime/monitor/live_page.h"

namespace panofix {
namespace {

class MonitorHttp : public testing::Test {
 protected:
  void SetUp() override { SetLogLevel("off"); }
  void Start(const MonitorServerOptions& options = {}) {
    server_ = ValueOrThrow(MonitorServer::Start(options, monitor_));
  }
  [[nodiscard]] httplib::Response Get(const std::string& path, const std::string& host = "") const {
    httplib::Client client("127.0.0.1", server_->port());
    httplib::Headers headers;
    if (!host.empty()) headers.emplace("Host", host);
    const auto result = client.Get(path, headers);
    EXPECT_TRUE(result) << path;
    return result ? *result : httplib::Response{};
  }
  void Answer(FixStatus status = FixStatus::kNoFix) {
    FrameResult result;
    result.status = status;
    monitor_.AddAnswer(result, 0, 0);
  }

  ServiceMonitor monitor_;
  std::unique_ptr<MonitorServer> server_;
};

TEST_F(MonitorHttp, MetricsAreText) {
  Start();
  const auto response = Get("/metrics");
  EXPECT_EQ(response.status, 200);
  EXPECT_EQ(response.get_header_value("Content-Type"), "text/plain; version=0.0.4; charset=utf-8");
  EXPECT_NE(response.body.find("\npanofix_frames_received_total 0\n"), std::string::npos);
}

TEST_F(MonitorHttp, HealthFollowsTheLoopAndReadinessTheAnswers) {
  MonitorServerOptions options;
  options.hang_s = options.quiet_s = 0.2;
  Start(options);
  EXPECT_EQ(Get("/healthz").status, 503);
  monitor_.Step();
  EXPECT_EQ(Get("/healthz").status, 200);
  EXPECT_EQ(Get("/readyz").status, 503);
  EXPECT_EQ(Get("/readyz").body, "no frame has been answered yet\n");
  Answer();
  monitor_.Step();
  EXPECT_EQ(Get("/readyz").status, 200);
  std::this_thread::sleep_for(std::chrono::milliseconds(250));
  EXPECT_EQ(Get("/healthz").status, 503);
  monitor_.Step();
  EXPECT_EQ(Get("/healthz").status, 200);
  EXPECT_EQ(Get("/readyz").status, 503);
}

TEST_F(MonitorHttp, LiveGivesWhatIsNew) {
  Start();
  MapFacts facts;
  facts.bundle.name = "town";
  facts.panoramas = {{48.5, 2.5, 0}, {48.6, 2.6, 0}};
  facts.links = {{0, 1}};
  monitor_.SetMap(facts);
  for (int i = 0; i < 5; ++i) Answer(FixStatus::kFix);
  const auto live = nlohmann::json::parse(Get("/api/live?after=3").body);
  ASSERT_EQ(live["trail"].size(), 2U);
  EXPECT_EQ(live["trail"][0]["n"], 4);
  EXPECT_EQ(live["counts"]["fixes"], 5);
  EXPECT_EQ(nlohmann::json::parse(Get("/api/live?after=nonsense").body)["trail"].size(), 5U);
  const auto route = nlohmann::json::parse(Get("/api/route").body);
  EXPECT_EQ(route["panoramas"][1][0], 48.6);
  EXPECT_EQ(route["links"], nlohmann::json::parse("[[0,1]]"));
}

TEST_F(MonitorHttp, ThePageAndWhatItNeedsAreThere) {
  Start();
  const std::string page = Get("/").body;
  for (const char* name : {"live.css", "live.js"}) {
    EXPECT_NE(page.find(std::string("\"") + name), std::string::npos);
    EXPECT_EQ(Get(std::string("/") + name).status, 200);
  }
  EXPECT_EQ(page.find("http://"), std::string::npos) << "it must work without a network";
  EXPECT_EQ(page.find("https://"), std::string::npos);
  if (std::filesystem::exists(LeafletFolder())) {
    EXPECT_NE(Get("/leaflet/leaflet.js").body.find("Leaflet"), std::string::npos);
  }
  EXPECT_EQ(Get("/leaflet/../../../../etc/passwd").status, 404);
  EXPECT_EQ(Get("/nothing").status, 404);
}

TEST_F(MonitorHttp, PictureIsTheNewestFrame) {
  Start();
  EXPECT_EQ(Get("/api/frame").status, 404);
  const auto bytes =
      std::make_shared<std::vector<std::uint8_t>>(std::vector<std::uint8_t>{1, 0, 2});
  auto sight = std::make_shared<FrameSight>();
  sight->panorama = "p\xff", sight->width_px = 64, sight->height_px = 48;
  sight->pairs.push_back({{1, 2}, {3, 4}});
  EXPECT_EQ(Get("/api/sight").body, "null");
  monitor_.SetPicture({bytes, *bytes, nullptr, "image/jpeg", 77, sight});
  EXPECT_NE(Get("/api/sight").body.find("\"pairs\":[[1.0,2.0,3.0,4.0]]"), std::string::npos);
  EXPECT_EQ(Get("/api/frame").get_header_value("X-Timestamp-Ns"), "77");
  const auto response = Get("/api/frame");
  EXPECT_EQ(response.body, std::string("\1\0\2", 3));
  EXPECT_EQ(response.get_header_value("Content-Type"), "image/jpeg");
}

TEST_F(MonitorHttp, APreviewIsMadeOnceAndOnlyWhereSomebodyAsks) {
  Start();
  int num_made = 0;
  FramePicture picture;
  picture.timestamp_ns = 78, picture.content_type = "image/jpeg";
  picture.preview = std::make_shared<LazyBytes>([&] {
    ++num_made;
    return std::vector<std::uint8_t>{7, 8};
  });
  monitor_.SetPicture(picture);
  EXPECT_EQ(Get("/api/sight").status, 200);
  EXPECT_EQ(num_made, 0);
  for (int i = 0; i < 3; ++i) {
    const auto response = Get("/api/frame");
    EXPECT_EQ(response.status, 200);
    EXPECT_EQ(response.body, "\7\10");
    EXPECT_EQ(response.get_header_value("X-Timestamp-Ns"), "78");
  }
  EXPECT_EQ(num_made, 1);
  picture.preview = std::make_shared<LazyBytes>([] { return std::vector<std::uint8_t>(); });
  monitor_.SetPicture(picture);
  EXPECT_EQ(Get("/api/frame").status, 404);
}

TEST_F(MonitorHttp, OtherNamesForThisMachineAreRefused) {
  Start();
  EXPECT_EQ(Get("/metrics", "evil.example").status, 403);
  EXPECT_EQ(Get("/metrics", "localhost:80").status, 200);
}

TEST_F(MonitorHttp, ATakenPortIsNamed) {
  Start();
  MonitorServerOptions options;
  options.port = server_->port();
  const auto second = MonitorServer::Start(options, monitor_);
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.status().message().find(std::to_string(options.port)), std::string::npos);
}

}  // namespace
}  // namespace panofix
