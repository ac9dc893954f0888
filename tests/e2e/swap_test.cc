// A newer map activated, and rolled back, under a runtime that serves from the store: encrypted,
// watched, recorded; and the record replayed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <thread>

#include "common/drive/poses_csv.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"
#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;

class Swap : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* build : {"1", "2"}) {
      const Outcome built =
          data_.Build(data_.panoramas(), Path("map") + build, {"--name", "town", "--build", build});
      ASSERT_EQ(built.exit_code, 0) << built.errors;
    }
    Done(Builder({"keygen", "--key", Path("map.key"), "--public", Path("map.pub")}));
    for (const char* build : {"1", "2"})
      Done(Builder({"sign", Path("map") + build, "--key", Path("map.key")}));
    Done(Runtime({"init", "--store", Path("store"), "--map", "town", "--camera",
                  data_.camera().string(), "--key", Path("map.pub")}));
    for (const char* name : {"camera", "vehicle", "display"})
      Done(Runtime({"wire-key", Path(name)}));
    Done(Runtime({"install", "--store", Path("store"), Path("map1"), "--activate"}));
  }
  static void Done(const Outcome& outcome) { ASSERT_EQ(outcome.exit_code, 0) << outcome.errors; }
  [[nodiscard]] std::string Path(const std::string& name) const { return data_.root() / name; }
  // Waits for a pose of this build.
  [[nodiscard]] bool SeesBuild(Subscriber& poses, std::int64_t build) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
    while (std::chrono::steady_clock::now() < end) {
      const auto message = ValueOrThrow(poses.Receive(100));
      if (message && ValueOrThrow(UnpackResult(message->payload)).bundle.build == build)
        return true;
    }
    return false;
  }

  const TownData data_{EasyTown()};
};

TEST_F(Swap, MapsChangeUnderARunningService) {
  const std::string frames = "ipc://" + Path("f"), poses = "ipc://" + Path("p");
  Process serve(
      RuntimeCommand({"serve", "--store", Path("store"), "--frames", frames, "--poses", poses,
                      "--secret-key", Path("vehicle.key"), "--camera-key", Path("camera.pub"),
                      "--client-key", Path("display.pub"), "--record", Path("run.mcap")}));
  Process play(RuntimeCommand({"play", "--drive", data_.drive().string(), "--bind", frames,
                               "--rate", "2", "--loop", "--now", "--secret-key", Path("camera.key"),
                               "--client-key", Path("vehicle.pub")}));
  SubscriberOptions options;
  options.topics = {kPoseTopic};
  options.security.own = ValueOrThrow(ReadWireKeys(Path("display.key")));
  options.security.server_key = ValueOrThrow(ReadWirePublicKey(Path("vehicle.pub")));
  Subscriber subscriber = ValueOrThrow(Subscriber::Open(poses, options));
  EXPECT_TRUE(SeesBuild(subscriber, 1)) << serve.Errors();
  Done(Runtime({"install", "--store", Path("store"), Path("map2"), "--activate"}));
  EXPECT_TRUE(SeesBuild(subscriber, 2)) << serve.Errors();
  Done(Runtime({"rollback", "--store", Path("store")}));
  EXPECT_TRUE(SeesBuild(subscriber, 1)) << serve.Errors();
  serve.Signal(SIGTERM);
  ASSERT_EQ(serve.Wait(kPatience_s), 0) << serve.Errors();
  play.Signal(SIGINT);
  // Three engines, two maps.
  const Outcome replay = Runtime({"replay", Path("run.mcap"), "--bundle", Path("map1"), "--bundle",
                                  Path("map2"), "--trusted-key", Path("map.pub")});
  EXPECT_EQ(replay.exit_code, 0) << replay.errors;
  EXPECT_THAT(replay.output, HasSubstr(" 0 answers differ"));
  const Outcome lacking = Runtime({"replay", Path("run.mcap"), "--bundle", Path("map1")});
  EXPECT_EQ(lacking.exit_code, 66);
  EXPECT_THAT(lacking.errors, HasSubstr("--bundle"));
}

TEST_F(Swap, ADamagedMapIsTakenOnceItIsMended) {
  Done(Runtime({"install", "--store", Path("store"), Path("map2"), "--activate"}));
  // A tile of that version alone: the versions share equal files.
  fs::path tile;
  for (const auto& version : fs::directory_iterator(fs::path(Path("store")) / "versions")) {
    if (ReadJson(version.path() / "manifest.json").at("build") == 2)
      tile = fs::directory_iterator(version.path() / "tiles")->path();
  }
  fs::rename(tile, Path("whole"));
  fs::copy_file(Path("whole"), tile);
  fs::permissions(tile, fs::perms::owner_all);
  FlipMiddleByte(tile);
  const std::string frames = "ipc://" + Path("f"), poses = "ipc://" + Path("p");
  Process serve(
      RuntimeCommand({"serve", "--store", Path("store"), "--frames", frames, "--poses", poses}));
  Process play(RuntimeCommand({"play", "--drive", data_.drive().string(), "--bind", frames,
                               "--rate", "2", "--loop", "--now"}));
  SubscriberOptions options;
  options.topics = {kPoseTopic};
  Subscriber subscriber = ValueOrThrow(Subscriber::Open(poses, options));
  EXPECT_TRUE(SeesBuild(subscriber, 1)) << serve.Errors();
  fs::rename(Path("whole"), tile);
  EXPECT_TRUE(SeesBuild(subscriber, 2)) << serve.Errors();
  serve.Signal(SIGTERM);
  EXPECT_EQ(serve.Wait(kPatience_s), 0) << serve.Errors();
}

TEST_F(Swap, KeysThatAreMissingAreNamed) {
  const auto serve = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments{"serve",
                                       "--store",
                                       Path("store"),
                                       "--frames",
                                       "ipc://" + Path("f"),
                                       "--poses",
                                       "tcp://192.0.2.1:5602"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Runtime(arguments);
  };
  EXPECT_THAT(serve({}).errors, HasSubstr("--insecure-bind"));
  EXPECT_EQ(serve({}).exit_code, 64);
  EXPECT_THAT(serve({"--client-key", Path("display.pub")}).errors, HasSubstr("--secret-key"));
  EXPECT_THAT(serve({"--secret-key", Path("vehicle.key"), "--client-key", Path("none.pub")}).errors,
              HasSubstr("none.pub"));
  EXPECT_THAT(
      serve({"--secret-key", Path("vehicle.pub"), "--client-key", Path("display.pub")}).errors,
      HasSubstr("vehicle.pub"));
}

}  // namespace
}  // namespace panofix::e2e
