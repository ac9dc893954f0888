// The real service while its map is taken away, cut, or larger than its memory; and its end.
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>

#include <thread>
#include <zmq.hpp>

#include "common/drive/drive.h"
#include "common/drive/poses_csv.h"
#include "common/io/read_file.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"
#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
// Only a failing test waits this long.
constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;
// From SIGTERM to the end, whatever it is doing.
constexpr double kStop_s = 1 * PANOFIX_SLOWDOWN;

// Five panoramas in two tiles or three: some 200 m a tile.
std::vector<std::string> LongTown() {
  std::vector<std::string> options = EasyTown();
  for (std::size_t i = 0; i + 1 < options.size(); ++i) {
    if (options[i] == "--panoramas") options[i + 1] = "5";
    if (options[i] == "--spacing-m") options[i + 1] = "60";
    if (options[i] == "--frames") options[i + 1] = "17";
  }
  return options;
}

class MapFaults : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(LongTown());
    built_ = data_->Build(data_->panoramas(), data_->root() / "map", {"--station-spacing-m", "15"});
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override {
    ASSERT_EQ(built_.exit_code, 0) << built_.errors;
    bundle_ = CopyFolder(data_->root() / "map", data_->root() / ("map_" + Name()));
    for (const auto& entry : fs::directory_iterator(bundle_ / "tiles"))
      tiles_.push_back(entry.path());
    ASSERT_GE(tiles_.size(), 2U) << "the town lies in one tile: this test shows nothing";
  }
  static std::string Name() {
    return testing::UnitTest::GetInstance()->current_test_info()->name();
  }
  [[nodiscard]] static std::string Ipc(const std::string& name) {
    return "ipc://" + (data_->root() / (Name().substr(0, 12) + name)).string();
  }
  [[nodiscard]] std::vector<std::string> ServeCommand(
      const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"serve",  "--bundle", bundle_.string(), "--frames",
                                       Ipc("f"), "--poses",  Ipc("p")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RuntimeCommand(arguments);
  }
  [[nodiscard]] static std::vector<std::string> PlayCommand(const std::string& rate_hz) {
    return RuntimeCommand({"play", "--drive", data_->drive().string(), "--bind", Ipc("f"), "--rate",
                           rate_hz, "--loop", "--now", "--wait-for-subscriber"});
  }
  [[nodiscard]] static Subscriber Poses() {
    SubscriberOptions options;
    options.topics = {kPoseTopic};
    options.receive_queue_messages = 0;
    return ValueOrThrow(Subscriber::Open(Ipc("p"), options));
  }
  // Takes answers until `count` of them hold.
  template <typename Wanted>
  static bool Sees(Subscriber& poses, int count, const Wanted& wanted) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
    while (std::chrono::steady_clock::now() < end) {
      const auto message = ValueOrThrow(poses.Receive(100));
      if (message && wanted(ValueOrThrow(UnpackResult(message->payload)).row) && --count == 0)
        return true;
    }
    return false;
  }
  static void DiscardWaiting(Subscriber& poses) {
    while (ValueOrThrow(poses.Receive(0))) {
    }
  }
  static bool IsFix(const PoseRow& row) { return row.status == FixStatus::kFix; }

  static inline std::unique_ptr<TownData> data_;
  static inline Outcome built_;
  fs::path bundle_;
  std::vector<fs::path> tiles_;
};

TEST_F(MapFaults, PosesAreTheSameWhateverTheMemory) {
  const auto rows = [&](const std::string& name, const std::vector<std::string>& more) {
    const fs::path out = data_->root() / (name + ".csv");
    const Outcome outcome = data_->Localize(bundle_, data_->drive(), out, more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return ReadPosesCsv(out).value();
  };
  const std::vector<PoseRow> all = rows("all", {}), bounded = rows("bounded", {"--memory-mb", "1"});
  ASSERT_EQ(all.size(), bounded.size());
  int num_fixes = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(all[i].status, bounded[i].status);
    EXPECT_EQ(all[i].reason, bounded[i].reason);
    EXPECT_EQ(all[i].best_panorama, bounded[i].best_panorama);
    EXPECT_EQ(all[i].num_inliers, bounded[i].num_inliers);
    ASSERT_EQ(all[i].pose.has_value(), bounded[i].pose.has_value());
    if (!all[i].pose) continue;
    ++num_fixes;
    EXPECT_EQ(all[i].pose->position.lat_deg, bounded[i].pose->position.lat_deg);
    EXPECT_EQ(all[i].pose->position.lon_deg, bounded[i].pose->position.lon_deg);
  }
  EXPECT_GE(num_fixes, 3);
}

// All that it needs is held open; with so little memory every tile is read again and again.
TEST_F(MapFaults, ABundleThatIsDeletedIsServedOn) {
  Process serve(ServeCommand({"--memory-mb", "1"}));
  Process play(PlayCommand("3"));
  Subscriber poses = Poses();
  ASSERT_TRUE(Sees(poses, 1, IsFix)) << serve.Errors();
  fs::remove_all(bundle_);
  DiscardWaiting(poses);
  EXPECT_TRUE(Sees(poses, 3, IsFix)) << serve.Errors();
  EXPECT_TRUE(serve.Running()) << serve.Errors();
}

// One map for both, so small a bound that each search reads all of it again while the other waits.
TEST_F(MapFaults, RequestsAreAnsweredBesideTheFeedWhateverTheMemory) {
  constexpr int kHttpPort = 18084;
  Process serve(ServeCommand(
      {"--memory-mb", "1", "--requests", Ipc("r"), "--http", std::to_string(kHttpPort)}));
  Process play(PlayCommand("3"));
  Subscriber poses = Poses();
  ASSERT_TRUE(Sees(poses, 1, IsFix)) << serve.Errors();
  DiscardWaiting(poses);
  zmq::context_t context;
  zmq::socket_t socket(context, zmq::socket_type::req);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::rcvtimeo, static_cast<int>(1000 * kPatience_s));
  socket.connect(Ipc("r"));
  const Drive drive = ValueOrThrow(ReadDrive(data_->drive()));
  int num_fixes = 0;
  for (std::size_t i = 0; i < drive.frames.size(); i += 4) {
    const auto request = PackFrame(drive.frames[i].timestamp_ns,
                                   ValueOrThrow(ReadFileBytes(drive.frames[i].image, 1 << 20)));
    socket.send(zmq::buffer(kFrameTopic), zmq::send_flags::sndmore);
    socket.send(zmq::buffer(request), zmq::send_flags::none);
    zmq::message_t topic, payload;
    ASSERT_TRUE(socket.recv(topic)) << serve.Errors();
    ASSERT_TRUE(socket.recv(payload)) << serve.Errors();
    ASSERT_EQ(topic.to_string_view(), kPoseTopic) << payload.to_string_view();
    const auto* bytes = payload.data<std::uint8_t>();
    const PoseRow row = ValueOrThrow(UnpackResult(WireBytes::Copy({bytes, payload.size()}))).row;
    EXPECT_EQ(row.timestamp_ns, drive.frames[i].timestamp_ns);
    num_fixes += IsFix(row) ? 1 : 0;
  }
  EXPECT_GE(num_fixes, 3);
  EXPECT_TRUE(Sees(poses, 3, IsFix)) << serve.Errors();
  const auto page = httplib::Client("127.0.0.1", kHttpPort).Get("/metrics");
  ASSERT_TRUE(page);
  EXPECT_NE(page->body.find("\npanofix_tile_failures_total 0\n"), std::string::npos);
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(kPatience_s), 0) << serve.Errors();
}

TEST_F(MapFaults, TilesThatAreCutDoNotEndIt) {
  Process serve(ServeCommand());
  Process play(PlayCommand("3"));
  Subscriber poses = Poses();
  ASSERT_TRUE(Sees(poses, 1, IsFix)) << serve.Errors();
  for (const fs::path& tile : tiles_) TruncateFile(tile, 0);
  DiscardWaiting(poses);
  // What was verified is in memory.
  EXPECT_TRUE(Sees(poses, 3, IsFix)) << serve.Errors();
  EXPECT_TRUE(serve.Running()) << serve.Errors();
}

TEST_F(MapFaults, TilesThatAreCutBeforeTheyAreReadAgainAreToldAndCounted) {
  constexpr int kHttpPort = 18083;
  Process serve(ServeCommand({"--memory-mb", "1", "--http", std::to_string(kHttpPort)}));
  Process play(PlayCommand("3"));
  Subscriber poses = Poses();
  ASSERT_TRUE(Sees(poses, 1, IsFix)) << serve.Errors();
  for (const fs::path& tile : tiles_) TruncateFile(tile, 0.5);
  EXPECT_TRUE(Sees(poses, 1, [&](const PoseRow& row) { return !IsFix(row); }));
  DiscardWaiting(poses);
  EXPECT_TRUE(Sees(poses, 3, [&](const PoseRow& row) { return !IsFix(row); })) << serve.Errors();
  EXPECT_NE(serve.Errors().find("the map goes without this tile"), std::string::npos);
  const auto page = httplib::Client("127.0.0.1", kHttpPort).Get("/metrics");
  ASSERT_TRUE(page);
  EXPECT_EQ(page->body.find("\npanofix_tile_failures_total 0\n"), std::string::npos);
  EXPECT_NE(page->body.find("\npanofix_tile_failures_total "), std::string::npos);
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(kPatience_s), 0) << serve.Errors();
}

// Frames come faster than they are worked off, so that it is always in the middle of one.
TEST_F(MapFaults, ToldToStopInTheMiddleOfAFrameItEndsAtOnce) {
  Process serve(ServeCommand({"--record", (data_->root() / "run.mcap").string()}));
  Process play(PlayCommand("20"));
  Subscriber poses = Poses();
  ASSERT_TRUE(Sees(poses, 1, [](const PoseRow&) { return true; })) << serve.Errors();
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(kStop_s), 0) << serve.Errors();
}

}  // namespace
}  // namespace panofix::e2e
