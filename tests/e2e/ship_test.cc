// From the builder to the vehicle through the real programs: keys, signatures, packages, the store,
// and every threat to them, each refused with its own exit code.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <memory>
#include <thread>

#include "common/base/rng.h"
#include "common/drive/poses_csv.h"
#include "common/io/sha256.h"
#include "tests/e2e/data_set.h"

namespace panofix::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr double kPatience_s = 60 * PANOFIX_SLOWDOWN;
constexpr char kCreated[] = "2026-01-01T00:00:00Z";
constexpr char kManyYears_days[] = "3650";

class Ship : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<TownData>(EasyTown());
    for (const char* name : {"map", "next"}) {
      ExpectDone(Builder({"keygen", "--key", Path(std::string(name) + ".key"), "--public",
                          Path(std::string(name) + ".pub")}));
    }
    // Build 2 has another tile than build 1.
    for (const int build : {1, 2}) {
      const Outcome built = data_->Build(data_->panoramas(), Map(build),
                                         {"--name", "city", "--build", std::to_string(build),
                                          "--landmarks-per-view", std::to_string(150 + build)});
      ExpectDone(built);
      Sign(Map(build), "map");
    }
  }
  static void TearDownTestSuite() { data_.reset(); }

  static std::string Path(const std::string& name) { return data_->root() / name; }
  static fs::path Map(int build) { return Path("city-" + std::to_string(build)); }
  static void ExpectDone(const Outcome& outcome) {
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
  }
  static void Sign(const fs::path& bundle, const std::string& key,
                   const std::vector<std::string>& options = {},
                   const std::string& days = kManyYears_days) {
    std::vector<std::string> command{"sign",      bundle,   "--key",          Path(key + ".key"),
                                     "--created", kCreated, "--expires-days", days};
    command.insert(command.end(), options.begin(), options.end());
    ExpectDone(Builder(command));
  }
  static std::string IdOf(const fs::path& bundle) {
    return Sha256Hex(ReadText(bundle / "manifest.json"));
  }

  Ship() {
    ExpectDone(Runtime({"init", "--store", store_, "--map", "city", "--camera", data_->camera(),
                        "--key", Path("map.pub")}));
  }
  ~Ship() override { fs::remove_all(store_); }
  [[nodiscard]] Outcome Install(const std::string& from,
                                const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{"install", "--store", store_, from};
    command.insert(command.end(), more.begin(), more.end());
    return Runtime(command);
  }
  // A copy of build 1 that a test may bend.
  [[nodiscard]] fs::path Copy(int build = 1) const { return CopyFolder(Map(build), Path("bent")); }
  void ExpectRefused(const Outcome& outcome, int exit_code, const std::string& word) {
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr("panofix-runtime: "));
    EXPECT_THAT(outcome.errors, HasSubstr(word));
  }
  [[nodiscard]] Json State() const { return ReadJson(fs::path(store_) / "state.json"); }

  static inline std::unique_ptr<TownData> data_;
  const std::string store_ = Path("store");
};

TEST_F(Ship, MinisignAndWeVerifyEachOther) {
  const auto minisign = [](const std::vector<std::string>& arguments) {
    std::vector<std::string> command{"/usr/bin/minisign"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return RunProgram(command);
  };
  const fs::path bundle = Copy();
  const std::string manifest = bundle / "manifest.json";
  const Outcome theirs = minisign({"-V", "-p", Path("map.pub"), "-m", manifest});
  EXPECT_EQ(theirs.exit_code, 0) << theirs.errors;
  EXPECT_THAT(theirs.output, HasSubstr("\"build\":1"));
  // Signed by minisign with a key of minisign's, our statement as trusted comment.
  std::istringstream lines(ReadText(manifest + ".minisig"));
  std::string line, statement;
  for (int i = 0; i < 3; ++i) std::getline(lines, line);
  statement = line.substr(std::string("trusted comment: ").size());
  const std::string secret = Path("their.key"), open = Path("their.pub");
  ASSERT_EQ(minisign({"-G", "-W", "-f", "-p", open, "-s", secret}).exit_code, 0);
  ASSERT_EQ(minisign({"-S", "-W", "-s", secret, "-m", manifest, "-t", statement}).exit_code, 0);
  ExpectDone(Runtime({"verify", bundle, "--trusted-key", open}));
  ExpectRefused(Runtime({"verify", bundle, "--trusted-key", Path("map.pub")}), 77, "not trusted");
  Sign(bundle, "their");
  EXPECT_EQ(minisign({"-V", "-p", open, "-m", manifest}).exit_code, 0);
}

TEST_F(Ship, VerifySaysWhatItIs) {
  const Outcome outcome = Runtime({"verify", Map(1), "--trusted-key", Path("map.pub"), "--json"});
  ExpectDone(outcome);
  const Json json = Json::parse(outcome.output);
  EXPECT_EQ(json["id"], IdOf(Map(1)));
  EXPECT_EQ(json["created"], kCreated);
  EXPECT_EQ(json["manifest"]["build"], 1);
  ExpectRefused(Runtime({"verify", Map(1)}), 64, "--trusted-key");
  const fs::path old = fs::path(PANOFIX_SOURCE_DIR) / "schemas/golden/bundle-1.0";
  ExpectRefused(Runtime({"verify", old, "--trusted-key", Path("map.pub")}), 76, "bundle format 1");
}

TEST_F(Ship, InspectSaysWhoseSignatureItIs) {
  const auto inspect = [](const fs::path& bundle, const std::vector<std::string>& more) {
    std::vector<std::string> command{"inspect", bundle, "--json"};
    command.insert(command.end(), more.begin(), more.end());
    return Builder(command);
  };
  const auto state = [](const Outcome& outcome) {
    return Json::parse(outcome.output)["signature"]["state"].get<std::string>();
  };
  const Outcome ours = inspect(Map(1), {"--trusted-key", Path("map.pub")});
  ExpectDone(ours);
  EXPECT_EQ(state(ours), "verified");
  EXPECT_EQ(Json::parse(ours.output)["signature"]["created"], kCreated);
  EXPECT_EQ(Json::parse(ours.output)["manifest"]["build"], 1);
  EXPECT_EQ(state(inspect(Map(1), {})), "not verified");
  const Outcome theirs = inspect(Map(1), {"--trusted-key", Path("next.pub")});
  EXPECT_EQ(theirs.exit_code, 77) << theirs.errors;
  EXPECT_THAT(theirs.errors, HasSubstr(Map(1).string()));
  EXPECT_EQ(state(theirs), "bad");
  const fs::path bare = Copy();
  fs::remove(bare / "manifest.json.minisig");
  EXPECT_EQ(state(inspect(bare, {})), "unsigned");
  EXPECT_EQ(inspect(bare, {"--trusted-key", Path("map.pub")}).exit_code, 77);
}

TEST_F(Ship, AnOldFormatIsMigratedSignedAnewAndVerified) {
  const fs::path golden = fs::path(PANOFIX_SOURCE_DIR) / "schemas/golden";
  const std::string migrated = Path("migrated");
  ExpectDone(Builder({"migrate", golden / "bundle-2.0", "--out", migrated + "/", "--build", "8"}));
  EXPECT_EQ(Runtime({"verify", migrated, "--trusted-key", Path("map.pub")}).exit_code, 77);
  Sign(migrated, "map");
  const Outcome verified =
      Runtime({"verify", migrated, "--trusted-key", Path("map.pub"), "--json"});
  ExpectDone(verified);
  EXPECT_EQ(Json::parse(verified.output)["manifest"]["format"]["minor"], 2);
  EXPECT_EQ(Json::parse(verified.output)["manifest"]["build"], 8);
  const Outcome refused = Builder({"migrate", golden / "bundle-1.0", "--out", Path("migrated-1")});
  EXPECT_EQ(refused.exit_code, 76);
  EXPECT_THAT(refused.errors, HasSubstr("build the bundle again"));
}

TEST_F(Ship, ADeltaBringsTheNextBuildByteForByte) {
  ExpectDone(Install(Map(1), {"--activate"}));
  EXPECT_EQ(State()["active"], IdOf(Map(1)));
  const std::string delta = Path("delta.pfb");
  ExpectDone(Builder({"delta", Map(1), Map(2), "--out", delta}));
  EXPECT_LT(fs::file_size(delta), 200000U);
  ExpectDone(Install("file://" + delta, {"--activate"}));
  EXPECT_EQ(State()["active"], IdOf(Map(2)));
  const fs::path version = fs::path(store_) / "versions" / IdOf(Map(2));
  for (const auto& entry : fs::recursive_directory_iterator(Map(2))) {
    if (!entry.is_regular_file()) continue;
    const fs::path path = fs::relative(entry.path(), Map(2));
    EXPECT_TRUE(ReadText(version / path) == ReadText(entry.path())) << path;
  }
  // A probe that has no time to answer changes nothing.
  ExpectRefused(Runtime({"rollback", "--store", store_, "--probe-timeout-s", "0.001"}), 88,
                "within 0.001 s");
  EXPECT_EQ(State()["previous"], IdOf(Map(1)));
  const Outcome back = Runtime({"rollback", "--store", store_});
  ExpectDone(back);
  EXPECT_THAT(back.output, HasSubstr("in force: build 1"));
  EXPECT_EQ(State()["active"], IdOf(Map(1)));
  ExpectDone(Runtime({"fsck", "--store", store_}));
  const Outcome list = Runtime({"list", "--store", store_});
  EXPECT_THAT(list.output, HasSubstr("build 2"));
  EXPECT_THAT(list.output, testing::Not(HasSubstr(" \n")));
  ExpectDone(Runtime({"gc", "--store", store_}));
}

TEST_F(Ship, EveryThreatHasItsExitCode) {
  // Arbitrary bundle: unsigned, and signed with a key that the vehicle does not know.
  fs::path bent = Copy();
  fs::remove(bent / "manifest.json.minisig");
  ExpectRefused(Install(bent), 77, "not signed");
  Sign(bent, "next");
  ExpectRefused(Install(bent), 77, "not trusted");
  // Freeze: an old release, still well signed.
  Sign(bent, "map", {}, "1");
  ExpectRefused(Install(bent), 82, "expired");
  // Mix and match: a part of another build.
  bent = Copy();
  fs::copy_file(Map(2) / "graph.h5", bent / "graph.h5", fs::copy_options::overwrite_existing);
  FlipMiddleByte(bent / "graph.h5");
  ExpectRefused(Install(bent), 83, "graph.h5");
  // Endless data, partial install.
  bent = Copy();
  WriteText(bent / "graph.h5", ReadText(bent / "graph.h5") + std::string(1000, 'x'));
  ExpectRefused(Install(bent), 84, "graph.h5");
  fs::remove(bent / "graph.h5");
  ExpectRefused(Install(bent), 85, "graph.h5");
  // Wrong camera, wrong map, wrong format.
  const std::string other = Path("other-store");
  const fs::path camera = Path("other.yaml");
  fs::copy_file(data_->camera(), camera, fs::copy_options::overwrite_existing);
  ReplaceInFile(camera, "image_width: 400", "image_width: 640");
  ExpectDone(Runtime(
      {"init", "--store", other, "--map", "city", "--camera", camera, "--key", Path("map.pub")}));
  ExpectRefused(Runtime({"install", "--store", other, Map(1)}), 86, "camera");
  const std::string moon = Path("moon-store");
  ExpectDone(Runtime({"init", "--store", moon, "--map", "moon", "--camera", data_->camera(),
                      "--key", Path("map.pub")}));
  ExpectRefused(Runtime({"install", "--store", moon, Map(1)}), 87, "'moon'");
  bent = Copy();
  ReplaceInFile(bent / "manifest.json", "\"major\": 2", "\"major\": 3");
  ASSERT_EQ(RunProgram({"/usr/bin/minisign", "-S", "-W", "-s", Path("map.key"), "-m",
                        bent / "manifest.json", "-t",
                        R"({"panofix":"bundle release 1","name":"city","build":1,)"
                        R"("created":"2026-01-01T00:00:00Z","expires":"2096-01-01T00:00:00Z"})"})
                .exit_code,
            0);
  ExpectRefused(Install(bent), 76, "bundle format 3");
  // Rollback.
  ExpectDone(Install(Map(2)));
  ExpectRefused(Install(Map(1)), 81, "build 2 was here already");
  // None of it left anything but the one good build.
  ExpectDone(Runtime({"activate", "--store", store_}));
  EXPECT_EQ(State()["active"], IdOf(Map(2)));
  ExpectDone(Runtime({"fsck", "--store", store_}));
}

TEST_F(Ship, KeysRotateAndAreRevoked) {
  const fs::path first = Copy(1);
  ExpectDone(Install(first, {"--activate"}));
  // The next key comes by hand, endorsed by the old one; not without.
  fs::remove(Path("next.pub.minisig"));
  ExpectRefused(Runtime({"trust", "--store", store_, Path("next.pub")}), 77, "endorse");
  ExpectDone(Builder({"endorse", Path("next.pub"), "--key", Path("map.key")}));
  // Or along with the first bundle that it signs.
  const fs::path second = CopyFolder(Map(2), Path("second"));
  const std::string map_id =
      ReadText(Path("map.pub"))
          .substr(std::string("untrusted comment: minisign public key ").size(), 16);
  Sign(second, "next", {"--revoke", map_id});
  const std::string package = Path("rotation.pfb");
  ExpectDone(Builder({"delta", first, second, "--out", package, "--endorsed", Path("next.pub")}));
  ExpectRefused(Install(second), 77, "not trusted");
  ExpectDone(Install(package, {"--activate"}));
  EXPECT_EQ(State()["active"], IdOf(second));
  // From now on the old key's word counts for nothing.
  ExpectRefused(Install(Map(1)), 80, "revoked");
  ExpectRefused(Runtime({"rollback", "--store", store_}), 80, "revoked");
  const std::string list = Runtime({"list", "--store", store_}).output;
  EXPECT_THAT(list, HasSubstr("build 1  key " + map_id));
  EXPECT_THAT(list, HasSubstr("key " + map_id + "  revoked"));
  EXPECT_THAT(list, testing::Not(HasSubstr("key " + map_id + "  put in by hand")));
  // It is garbage, and no damage.
  ExpectDone(Runtime({"fsck", "--store", store_}));
  ExpectDone(Runtime({"gc", "--store", store_}));
  EXPECT_THAT(Runtime({"list", "--store", store_}).output,
              testing::Not(HasSubstr("build 1  key " + map_id)));
  EXPECT_EQ(State()["active"], IdOf(second));
}

TEST_F(Ship, WrongUseIsNamed) {
  EXPECT_THAT(Builder({"biuld"}).errors, HasSubstr("unknown command 'biuld'; see panofix-builder"));
  EXPECT_THAT(Runtime({"--log-level", "info", "serv"}).errors, HasSubstr("command 'serv'; see"));
  const Outcome ahead =
      Builder({"sign", Copy(), "--key", Path("map.key"), "--created", "2199-01-01T00:00:00Z"});
  EXPECT_EQ(ahead.exit_code, 64);
  EXPECT_THAT(ahead.errors, HasSubstr("--allow-future"));
  const Outcome unknown = Runtime({"revoke", "--store", store_, "00000000000000AA"});
  ExpectDone(unknown);
  EXPECT_THAT(unknown.errors, HasSubstr("not known here"));
  ExpectRefused(Runtime({"revoke", "--store", store_, "AA"}), 64, "16 hex digits");
}

TEST_F(Ship, AMapThatDoesNotRunIsTakenBack) {
  ExpectDone(Install(Map(1), {"--activate"}));
  // Well signed, and its tile is no HDF5 file.
  const fs::path sick = Copy(2);
  Json manifest = ReadJson(sick / "manifest.json");
  for (Json& part : manifest["parts"]) {
    const std::string path = part["path"];
    if (!path.starts_with("tiles/")) continue;
    WriteText(sick / path, "rubbish");
    part["sha256"] = Sha256Hex("rubbish"), part["num_bytes"] = 7;
  }
  WriteText(sick / "manifest.json", manifest.dump(1) + "\n");
  WriteText(sick / "manifest.json.sha256",
            Sha256Hex(manifest.dump(1) + "\n") + "  manifest.json\n");
  Sign(sick, "map");
  ExpectRefused(Install(sick, {"--activate"}), 88, "is back in force");
  EXPECT_EQ(State()["active"], IdOf(Map(1)));
}

TEST_F(Ship, ServeRunsFromTheStoreAndFallsBack) {
  ExpectDone(Install(Map(1), {"--activate"}));
  ExpectDone(Install(Map(2), {"--activate"}));
  const auto ipc = [](const std::string& name) { return "ipc://" + Path(name); };
  const auto drive = [&](const std::vector<std::string>& map, const std::string& poses) {
    std::vector<std::string> command{"serve",      "--frames", ipc("frames"),  "--poses",
                                     ipc("poses"), "--camera", data_->camera()};
    command.insert(command.end(), map.begin(), map.end());
    Process serve(RuntimeCommand(command));
    Process record(
        RuntimeCommand({"record", "--poses", ipc("poses"), "--out", poses, "--count", "1"}));
    Process play(RuntimeCommand({"play", "--drive", data_->drive(), "--bind", ipc("frames"),
                                 "--rate", "2", "--loop", "--wait-for-subscriber"}));
    // Until the recorder has one: it misses what is published before its subscription arrives.
    EXPECT_EQ(record.Wait(kPatience_s).value_or(-1), 0) << record.Errors();
    serve.Signal(SIGTERM);
    EXPECT_EQ(serve.Wait(kPatience_s).value_or(-1), 0) << serve.Errors();
    return serve.Errors();
  };
  const std::string poses = Path("poses.csv");
  std::string log = drive({"--store", store_}, poses);
  EXPECT_THAT(log, HasSubstr("build 2"));
  EXPECT_THAT(log, testing::Not(HasSubstr("UNSIGNED")));
  EXPECT_FALSE(ReadPosesCsv(poses).value().at(0).map_is_unsigned);
  // Damage in the active map.
  for (const auto& tile :
       fs::directory_iterator(fs::path(store_) / "versions" / IdOf(Map(2)) / "tiles")) {
    fs::permissions(tile, fs::perms::owner_all);
    FlipMiddleByte(tile);
  }
  log = drive({"--store", store_}, poses);
  EXPECT_THAT(log, HasSubstr("does not open"));
  EXPECT_THAT(log, HasSubstr("build 1"));
  // By its path, for development.
  log = drive({"--bundle", Map(1)}, poses);
  EXPECT_THAT(log, HasSubstr("UNSIGNED"));
  EXPECT_THAT(log, HasSubstr("signature is not verified"));
  EXPECT_TRUE(ReadPosesCsv(poses).value().at(0).map_is_unsigned);
  log = drive({"--bundle", Map(1), "--trusted-key", Path("map.pub")}, poses);
  EXPECT_FALSE(ReadPosesCsv(poses).value().at(0).map_is_unsigned);
  ExpectRefused(Runtime({"serve", "--frames", ipc("f"), "--poses", ipc("p")}), 64, "--store");
}

TEST_F(Ship, KilledAtAnyMomentThereIsAWholeMap) {
  ExpectDone(Install(Map(1), {"--activate"}));
  const std::string pristine = Path("pristine");
  fs::copy(store_, pristine, fs::copy_options::recursive);
  // How long an undisturbed one takes.
  const auto start = std::chrono::steady_clock::now();
  ExpectDone(Install(Map(2), {"--activate"}));
  const double whole_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  Rng rng(1, "tests/kills");
  constexpr int kKills = 40;
  int num_killed = 0;
  for (int i = 0; i < kKills; ++i) {
    SCOPED_TRACE(i);
    fs::remove_all(store_);
    fs::copy(pristine, store_, fs::copy_options::recursive);
    {
      Process install(RuntimeCommand({"install", "--store", store_, Map(2), "--activate"}));
      std::this_thread::sleep_for(std::chrono::duration<double>(rng.Uniform() * whole_s));
      num_killed += install.Running() ? 1 : 0;
      install.Signal(SIGKILL);
      static_cast<void>(install.Wait(kPatience_s));
    }
    const std::string active = State()["active"];
    ASSERT_TRUE(active == IdOf(Map(1)) || active == IdOf(Map(2))) << active;
    ExpectDone(Runtime({"verify", fs::path(store_) / "versions" / active, "--store", store_}));
    // What the killed one had started may need a moment to be gone.
    Outcome again = Install(Map(2), {"--activate"});
    for (int tries = 0; again.exit_code == 75 && tries < 100; ++tries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      again = Install(Map(2), {"--activate"});
    }
    ExpectDone(again);
    EXPECT_EQ(State()["active"], IdOf(Map(2)));
  }
  EXPECT_GT(num_killed, kKills / 4) << "most of them came too late";
}

}  // namespace
}  // namespace panofix::e2e
