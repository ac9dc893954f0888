// The live page in headless Chromium, driven as a person would: looked at, and clicked on.
#include <gtest/gtest.h>
#include <httplib.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <thread>

#include "runtime/monitor/live_page.h"
#include "runtime/monitor/monitor_server.h"
#include "tests/e2e/process.h"

namespace panofix::e2e {
namespace {

using Json = nlohmann::json;
constexpr const char* kDriver = "/usr/bin/chromedriver";
constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;

template <typename Condition>
bool Eventually(Condition condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

// A browser with one window, over the WebDriver protocol.
class Browser {
 public:
  Browser() : driver_({kDriver, "--port=0"}) {
    const std::string mark = "on port ";
    EXPECT_TRUE(Eventually([&] {
      const std::string output = driver_.Output();
      const auto at = output.rfind(mark);
      if (at == std::string::npos) return false;
      port_ = std::atoi(output.c_str() + at + mark.size());
      return port_ > 0;
    })) << driver_.Output();
    const Json options{
        {"args", {"--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,800"}}};
    const Json answer =
        Post("/session",
             {{"capabilities",
               {{"alwaysMatch", {{"browserName", "chrome"}, {"goog:chromeOptions", options}}}}}});
    session_ = "/session/" + answer["sessionId"].get<std::string>();
  }
  ~Browser() { static_cast<void>(Client().Delete(session_)); }
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void Open(const std::string& url) { Post(session_ + "/url", {{"url", url}}); }
  Json Run(const std::string& script) {
    return Post(session_ + "/execute/sync", {{"script", script}, {"args", Json::array()}});
  }
  void Click(double x_px, double y_px) {
    const Json move{{"type", "pointerMove"},
                    {"duration", 0},
                    {"x", std::lround(x_px)},
                    {"y", std::lround(y_px)}};
    const Json down{{"type", "pointerDown"}, {"button", 0}},
        up{{"type", "pointerUp"}, {"button", 0}};
    Post(session_ + "/actions",
         {{"actions", {{{"type", "pointer"}, {"id", "mouse"}, {"actions", {move, down, up}}}}}});
  }

 private:
  [[nodiscard]] httplib::Client Client() const {
    httplib::Client client("127.0.0.1", port_);
    client.set_read_timeout(std::chrono::seconds(static_cast<int>(kPatience_s)));
    return client;
  }
  Json Post(const std::string& path, const Json& body) {
    const auto result = Client().Post(path, body.dump(), "application/json");
    if (!result) {
      ADD_FAILURE() << path << ": the driver does not answer";
      return {};
    }
    EXPECT_EQ(result->status, 200) << path << ": " << result->body;
    return Json::parse(result->body)["value"];
  }

  Process driver_;
  int port_ = 0;
  std::string session_;
};

FrameResult FixAt(std::int64_t number) {
  FrameResult result;
  result.timestamp_ns = 1'700'000'000'000'000'000 + number;
  result.status = number == 3 ? FixStatus::kDegraded : FixStatus::kFix;
  FramePose pose;
  pose.position = {48.8 + 1e-4 * static_cast<double>(number), 2.13, 90};
  pose.position_in_map.setZero();
  pose.enu_from_cam = pose.map_from_cam = Eigen::Quaterniond::Identity();
  pose.covariance_in_map.setIdentity();
  result.pose = pose;
  result.latency = {1, 30, 2, 3, 4, 40};
  return result;
}

TEST(LivePage, ShowsTheTrailAndAClickTellsOfAnAnswer) {
  if (!std::filesystem::exists(kDriver) || !std::filesystem::exists(LeafletFolder())) {
    GTEST_SKIP() << "needs chromium-driver and libjs-leaflet";
  }
  ServiceMonitor monitor;
  MapFacts facts;
  facts.bundle.name = "<b>town</b>";
  facts.bundle.id = std::string(64, 'a');
  for (int i = 0; i < 8; ++i) facts.panoramas.push_back({48.8 + 1e-4 * i, 2.1299, 0});
  for (std::uint32_t i = 1; i < 8; ++i) facts.links.emplace_back(i - 1, i);
  monitor.SetMap(facts);
  const auto server = ValueOrThrow(MonitorServer::Start({}, monitor));
  Browser browser;
  browser.Open("http://127.0.0.1:" + std::to_string(server->port()) + "/");
  const auto text_of = [&](const std::string& id) {
    return browser.Run("return document.getElementById('" + id + "').textContent");
  };
  EXPECT_TRUE(Eventually([&] { return text_of("state") == "waiting for frames"; }));
  for (std::int64_t i = 1; i <= 6; ++i) monitor.AddAnswer(FixAt(i), 1, 2);
  EXPECT_TRUE(Eventually([&] { return text_of("state") == "fix"; }));
  EXPECT_NE(text_of("map-name").get<std::string>().find("<b>town</b>"), std::string::npos);
  EXPECT_EQ(browser.Run("return routeLayer.getLayers().length"), 7 + 8);
  EXPECT_EQ(browser.Run("return trailLayer.getLayers().length"), 6);
  EXPECT_EQ(browser.Run("return document.getElementById('detail').dataset.answer"), "6");
  // One sigma is 1 m: the ellipse reaches 2.448 m to the north of the newest fix.
  const double north_deg = browser.Run("return ellipse.getBounds().getNorth()").get<double>();
  EXPECT_NEAR((north_deg - (48.8 + 6e-4)) * 111320, 2.448, 0.01);
  // Something other than background is painted in the latency plot.
  EXPECT_GT(browser.Run("const c = document.getElementById('latency');"
                        "return c.getContext('2d').getImageData(0, 0, c.width, c.height).data"
                        ".reduce((n, v) => n + (v ? 1 : 0), 0)"),
            100);

  const Json at = browser.Run(
      "const p = map.latLngToContainerPoint(trail[2].mark.getLatLng()),"
      "b = document.getElementById('map').getBoundingClientRect(); return [b.x + p.x, b.y + p.y]");
  browser.Click(at[0], at[1]);
  EXPECT_TRUE(Eventually([&] {
    return browser.Run("return document.getElementById('detail').dataset.answer") == "3";
  }));
  EXPECT_NE(text_of("detail").get<std::string>().find("degraded"), std::string::npos);
  // The frame's answer beside the view that it rests on.
  auto sight = std::make_shared<FrameSight>();
  sight->panorama = "<b>p</b>", sight->width_px = 100, sight->height_px = 80;
  sight->pairs.push_back({{10, 20}, {30, 40}});
  sight->landmarks_px.push_back({50, 60});
  FramePicture picture;
  picture.timestamp_ns = FixAt(7).timestamp_ns, picture.sight = sight;
  EXPECT_EQ(browser.Run("return document.getElementById('sight').hidden"), true);
  monitor.SetPicture(picture);
  // What was chosen stays while frames come in.
  monitor.AddAnswer(FixAt(7), 1, 2);
  EXPECT_TRUE(Eventually([&] { return browser.Run("return trail.length") == 7; }));
  EXPECT_EQ(browser.Run("return document.getElementById('detail').dataset.answer"), "3");
  EXPECT_TRUE(Eventually(
      [&] { return browser.Run("return document.getElementById('sight').hidden") == false; }));
  EXPECT_NE(text_of("frame-note").get<std::string>().find("<b>p</b>"), std::string::npos);
  // Two pictures of 100 px with 2 px between: the landmark and half of the line are in the right
  // one.
  EXPECT_EQ(browser.Run("const c = document.getElementById('sight'); return [c.width, c.height]"),
            Json({202, 80}));
  const Json paint = browser.Run(
      "const at = (x, y) => [...document.getElementById('sight').getContext('2d')"
      ".getImageData(x, y, 1, 1).data].slice(0, 3).reduce((a, b) => a + b);"
      "return [at(102 + 50, 60), at(102 + 90, 70), at(71, 30)]");
  EXPECT_GT(paint[0], 200);  // a landmark
  EXPECT_LT(paint[1], 100);  // nothing
  EXPECT_GT(paint[2], 0);    // the line between (10, 20) and (132, 40)

  // A picture that is made where the page asks for it, of a frame without a pose.
  FramePicture made;
  made.timestamp_ns = FixAt(8).timestamp_ns, made.content_type = "image/svg+xml";
  made.preview = std::make_shared<LazyBytes>([] {
    const std::string svg =
        R"(<svg xmlns="http://www.w3.org/2000/svg" width="30" height="20"></svg>)";
    return std::vector<std::uint8_t>(svg.begin(), svg.end());
  });
  monitor.SetPicture(made);
  monitor.AddAnswer(FixAt(8), 1, 2);
  EXPECT_TRUE(Eventually([&] {
    return browser.Run(
               "const i = document.getElementById('frame'); return i.hidden ? 0 : "
               "i.naturalWidth") == 30;
  }));
}

}  // namespace
}  // namespace panofix::e2e
