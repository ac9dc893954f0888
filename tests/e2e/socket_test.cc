// serve, play and record as three processes over TCP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "common/drive/drive.h"
#include "common/drive/poses_csv.h"
#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Only a failing test waits this long.
constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;
// SIGTERM is to end a waiting serve within this.
constexpr double kStop_s = 2;
// Frames a second, so slow that a loaded machine drops none: an answer takes a tenth of the gap.
constexpr const char* kSlowRate_hz = PANOFIX_SLOWDOWN > 1 ? "0.05" : "0.5";
// Half a unit of the last decimal of poses.csv, doubled.
constexpr double kPositionTolerance_deg = 1e-9, kAngleTolerance_deg = 1e-5;

sockaddr_in Loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  return address;
}

// A listening socket on a port that the system chose.
class Listener {
 public:
  Listener() : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address = Loopback(0);
    socklen_t size = sizeof(address);
    auto* any = reinterpret_cast<sockaddr*>(&address);
    const bool ok =
        ::bind(fd_, any, size) == 0 && ::listen(fd_, 1) == 0 && ::getsockname(fd_, any, &size) == 0;
    EXPECT_TRUE(ok) << "no free port";
    port_ = ntohs(address.sin_port);
  }
  ~Listener() { ::close(fd_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  [[nodiscard]] std::uint16_t port() const { return port_; }

 private:
  int fd_;
  std::uint16_t port_ = 0;
};

std::uint16_t FreePort() { return Listener().port(); }
std::string Tcp(std::uint16_t port) { return "tcp://127.0.0.1:" + std::to_string(port); }

bool IsOpen(std::uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = Loopback(port);
  const bool open =
      ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
  ::close(fd);
  return open;
}

template <typename Condition>
bool Eventually(Condition condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  while (std::chrono::steady_clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return false;
}

std::int64_t NowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class Sockets : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(EasyTown());
    built_ = data_->Build(data_->panoramas(), bundle());
  }
  static void TearDownTestSuite() { data_.reset(); }
  void SetUp() override { ASSERT_EQ(built_.exit_code, 0) << built_.errors; }

  static fs::path bundle() { return data_->root() / "map"; }
  [[nodiscard]] std::vector<std::string> ServeCommand() const {
    return RuntimeCommand({"serve", "--bundle", bundle().string(), "--frames", Tcp(frames_port_),
                           "--poses", Tcp(poses_port_)});
  }
  [[nodiscard]] std::vector<std::string> RecordCommand(const fs::path& out) const {
    return RuntimeCommand({"record", "--poses", Tcp(poses_port_), "--out", out.string()});
  }
  [[nodiscard]] std::vector<std::string> PlayCommand(const std::string& rate_hz) const {
    return RuntimeCommand({"play", "--drive", data_->drive().string(), "--bind", Tcp(frames_port_),
                           "--rate", rate_hz, "--wait-for-subscriber", "--subscriber-timeout-s",
                           "60"});
  }
  static void ExpectEnds(Process& process, int signal) {
    process.Signal(signal);
    EXPECT_EQ(process.Wait(kPatience_s), 0) << process.Errors();
  }

  const std::uint16_t frames_port_ = FreePort(), poses_port_ = FreePort();
  static inline std::unique_ptr<TownData> data_;
  static inline Outcome built_;
};

TEST_F(Sockets, PosesAreThoseOfLocalize) {
  const fs::path direct = data_->root() / "direct.csv", out = data_->root() / "wire.csv";
  ASSERT_EQ(data_->Localize(bundle(), data_->drive(), direct).exit_code, 0);
  const std::vector<PoseRow> expected = ReadPosesCsv(direct).value();

  Process serve(ServeCommand());
  // With the map open: until then frames are answered "map_loading".
  ASSERT_TRUE(Eventually([&] {
    return serve.Errors().find("bundle map, build") != std::string::npos && IsOpen(poses_port_);
  })) << serve.Errors();
  std::vector<std::string> command = RecordCommand(out);
  command.insert(command.end(), {"--count", std::to_string(expected.size()), "--idle-timeout-s",
                                 std::to_string(kPatience_s)});
  Process record(command);
  ASSERT_TRUE(Eventually([&] { return fs::exists(out.string() + ".part"); }));
  Process play(PlayCommand(kSlowRate_hz));
  EXPECT_EQ(play.Wait(kPatience_s), 0) << play.Errors();
  ASSERT_EQ(record.Wait(kPatience_s), 0) << record.Errors() << serve.Errors();
  ExpectEnds(serve, SIGTERM);

  const std::vector<PoseRow> rows = ReadPosesCsv(out).value();
  ASSERT_EQ(rows.size(), expected.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(rows[i].timestamp_ns, expected[i].timestamp_ns);
    EXPECT_EQ(rows[i].status, expected[i].status);
    EXPECT_EQ(rows[i].reason, expected[i].reason);
    EXPECT_EQ(rows[i].best_panorama, expected[i].best_panorama);
    ASSERT_EQ(rows[i].pose.has_value(), expected[i].pose.has_value());
    if (!rows[i].pose) continue;
    const PoseColumns &wire = *rows[i].pose, &file = *expected[i].pose;
    EXPECT_NEAR(wire.position.lat_deg, file.position.lat_deg, kPositionTolerance_deg);
    EXPECT_NEAR(wire.position.lon_deg, file.position.lon_deg, kPositionTolerance_deg);
    EXPECT_NEAR(AngleDifferenceDeg(wire.attitude.heading_deg, file.attitude.heading_deg), 0,
                kAngleTolerance_deg);
  }
}

TEST_F(Sockets, PublisherDiesAndReturns) {
  const fs::path out = data_->root() / "returns.csv";
  const std::int64_t start_ns = NowNs();
  ASSERT_LT(ReadDrive(data_->drive()).value().frames.back().timestamp_ns, start_ns);
  const auto latest_ns = [&](const fs::path& path) {
    const auto rows = ReadPosesCsv(path);
    return rows.ok() && !rows->empty() ? rows->back().timestamp_ns : 0;
  };
  Process serve(ServeCommand());
  Process record(RecordCommand(out));
  {
    std::vector<std::string> command = PlayCommand("2");
    command.push_back("--loop");
    Process dies(command);
    EXPECT_TRUE(Eventually([&] { return latest_ns(out.string() + ".part") > 0; }))
        << serve.Errors();
    dies.Signal(SIGKILL);
    EXPECT_EQ(dies.Wait(kPatience_s), 128 + SIGKILL);
  }
  std::vector<std::string> command = PlayCommand("2");
  command.insert(command.end(), {"--loop", "--now"});  // told apart by its timestamps
  Process returns(command);
  EXPECT_TRUE(Eventually([&] { return latest_ns(out.string() + ".part") > start_ns; }))
      << serve.Errors();
  EXPECT_TRUE(serve.Running());
  ExpectEnds(returns, SIGINT);
  ExpectEnds(record, SIGINT);
  ExpectEnds(serve, SIGTERM);
  EXPECT_GT(latest_ns(out), start_ns);
}

TEST_F(Sockets, ServeWaitsForAPublisherAndStopsWhenTold) {
  Process serve(ServeCommand());
  // A line says what is missing, and serve waits on.
  EXPECT_TRUE(Eventually([&] {
    return serve.Errors().find(Tcp(frames_port_) + ": no frame for") != std::string::npos;
  })) << serve.Errors();
  ASSERT_TRUE(serve.Running()) << serve.Errors();
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(kStop_s), 0) << serve.Errors();
}

TEST_F(Sockets, PlayGivesUpOnSubscribersWhereAskedTo) {
  std::vector<std::string> command = PlayCommand("10");
  command.back() = "0.2";
  const Outcome outcome = RunProgram(command);
  EXPECT_EQ(outcome.exit_code, 66);
  EXPECT_THAT(outcome.errors, HasSubstr("nobody subscribed"));
}

TEST_F(Sockets, AnEndpointThatCannotBeHadIsNamed) {
  const Listener taken;
  const Outcome serve = Runtime({"serve", "--bundle", bundle().string(), "--frames",
                                 Tcp(frames_port_), "--poses", Tcp(taken.port())});
  EXPECT_EQ(serve.exit_code, 74);
  EXPECT_THAT(serve.errors, HasSubstr("panofix-runtime: "));
  EXPECT_THAT(serve.errors, HasSubstr(Tcp(taken.port())));
  const Outcome play =
      Runtime({"play", "--drive", data_->drive().string(), "--bind", "udp:/nowhere"});
  EXPECT_EQ(play.exit_code, 64);
  EXPECT_THAT(play.errors, HasSubstr("udp:/nowhere"));
  const Outcome record =
      Runtime({"record", "--poses", Tcp(poses_port_), "--out",
               (data_->root() / "none.csv").string(), "--idle-timeout-s", "0.3"});
  EXPECT_EQ(record.exit_code, 66);
  EXPECT_THAT(record.errors, HasSubstr(Tcp(poses_port_)));
  EXPECT_FALSE(fs::exists(data_->root() / "none.csv"));
}

}  // namespace
}  // namespace panofix::e2e
