#include "runtime/store/activate.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include "common/io/atomic_file.h"
#include "tests/runtime/store/store_kit.h"

namespace panofix {
namespace {

const Status kSick{ErrorCode::kBadData, "it coughs; mend it"};
const HealthProbe kFails = [](const std::filesystem::path&) { return kSick; };

class ActivateTest : public StoreKit {};

TEST_F(ActivateTest, TheNewestComesIntoForceAndTheOldOneStays) {
  const std::string one = Run(1);
  EXPECT_EQ(State().active, one);
  EXPECT_TRUE(State().is_proven);
  EXPECT_EQ(BuildInForce(), 1);
  const std::string two = IdOf(Bundle(2));
  ASSERT_TRUE(InstallFolder(Bundle(2)).ok());
  EXPECT_EQ(BuildInForce(), 1);
  ASSERT_TRUE(ActivateHere("").ok());
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().previous, one);
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(ActivateTest, BackAndForth) {
  const std::string one = Run(1), two = Run(2);
  ASSERT_TRUE(Rollback(layout_, OpeningProbe(layout_)).ok());
  EXPECT_EQ(BuildInForce(), 1);
  EXPECT_EQ(State().previous, two);
  ASSERT_TRUE(Rollback(layout_, OpeningProbe(layout_)).ok());
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(ActivateTest, WithoutAVersionBeforeThereIsNoWayBack) {
  Run(1);
  EXPECT_EQ(Rollback(layout_, OpeningProbe(layout_)).code(), ErrorCode::kNotFound);
  EXPECT_EQ(BuildInForce(), 1);
}

TEST_F(ActivateTest, AFailedProbeBringsTheOldVersionBack) {
  const std::string one = Run(1);
  ASSERT_TRUE(InstallFolder(Bundle(2)).ok());
  const Status status = Activate(layout_, "", kFails);
  EXPECT_EQ(status.code(), ErrorCode::kUnhealthy);
  EXPECT_NE(status.message().find("it coughs"), std::string::npos);
  EXPECT_NE(status.message().find("is back in force"), std::string::npos);
  EXPECT_EQ(State().active, one);
  EXPECT_TRUE(State().is_proven);
  EXPECT_EQ(BuildInForce(), 1);
  // It may be tried again.
  EXPECT_TRUE(ActivateHere("").ok());
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(ActivateTest, AFailedProbeOfTheFirstVersionLeavesNone) {
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  EXPECT_EQ(Activate(layout_, "", kFails).code(), ErrorCode::kUnhealthy);
  EXPECT_EQ(State().active, "");
}

TEST_F(ActivateTest, AFailedRollbackStaysWhereItWas) {
  const std::string one = Run(1), two = Run(2);
  EXPECT_EQ(Rollback(layout_, kFails).code(), ErrorCode::kUnhealthy);
  EXPECT_EQ(State().active, two);
  // The way back is still open, and stays so when the next one fails.
  EXPECT_EQ(State().previous, one);
  ASSERT_TRUE(InstallFolder(Bundle(3)).ok());
  EXPECT_EQ(Activate(layout_, "", kFails).code(), ErrorCode::kUnhealthy);
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().previous, one);
  ASSERT_TRUE(Rollback(layout_, OpeningProbe(layout_)).ok());
  EXPECT_EQ(BuildInForce(), 1);
}

TEST_F(ActivateTest, ARollbackCutOffBeforeItsProbeKeepsTheWayBack) {
  const std::string one = Run(1), two = Run(2);
  const HealthProbe stopped = [](const std::filesystem::path&) {
    return Status(ErrorCode::kCancelled, "stopped");
  };
  EXPECT_EQ(Rollback(layout_, stopped).code(), ErrorCode::kCancelled);
  EXPECT_EQ(State().active, one);
  EXPECT_EQ(SettleActivation(layout_, kFails).code(), ErrorCode::kUnhealthy);
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().previous, one);
}

TEST_F(ActivateTest, AnUnprovenVersionIsNothingToGoBackTo) {
  const std::string one = Run(1), two = Run(2);
  StoreState cut = State();
  cut.active = IdOf(Bundle(3)), cut.previous = two, cut.before_previous = one;
  cut.is_proven = false;
  ASSERT_TRUE(WriteStoreState(layout_, cut).ok());
  ASSERT_TRUE(ActivateHere(two).ok());
  EXPECT_EQ(State().active, two);
  EXPECT_EQ(State().previous, one);
}

TEST_F(ActivateTest, OlderOnesComeBackByRollbackOnly) {
  const std::string one = Run(1);
  Run(2);
  EXPECT_EQ(ActivateHere(one).code(), ErrorCode::kDowngrade);
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(ActivateTest, WhatIsNotInstalledIsNotFound) {
  EXPECT_EQ(ActivateHere("").code(), ErrorCode::kNotFound);
  for (const std::string& id : {std::string(64, 'a'), std::string("../../etc"), std::string("..")})
    EXPECT_EQ(ActivateHere(id).code(), ErrorCode::kNotFound) << id;
  EXPECT_EQ(RunnableVersions(layout_).status().code(), ErrorCode::kNotFound);
}

TEST_F(ActivateTest, TheBeginningOfAnIdWillDo) {
  const std::string one = InstallFolder(Bundle(1)).value().id;
  EXPECT_EQ(ActivateHere(one.substr(0, 5)).code(), ErrorCode::kInvalidArgument);
  const std::string other = (one[0] == 'a' ? "b" : "a") + one.substr(1, 9);
  EXPECT_EQ(ActivateHere(other).code(), ErrorCode::kNotFound);
  std::filesystem::create_directory(layout_.version(one.substr(0, 60) + "0000"));
  EXPECT_EQ(ActivateHere(one.substr(0, 60)).code(), ErrorCode::kInvalidArgument);
  std::filesystem::remove(layout_.version(one.substr(0, 60) + "0000"));
  EXPECT_TRUE(ActivateHere(one.substr(0, 6)).ok());
  EXPECT_EQ(State().active, one);
}

TEST_F(ActivateTest, ExpiryIsAskedAgain) {
  const std::string one = Run(1);
  const auto report = InstallFolder(Bundle(2));
  StoreState state = State();
  state.time_floor_s = 4000000001;
  ASSERT_TRUE(WriteStoreState(layout_, state).ok());
  EXPECT_EQ(ActivateHere(report.value().id).code(), ErrorCode::kExpired);
  EXPECT_NE(ActivateHere(report.value().id).message().find("time_floor"), std::string::npos);
  // What is in force stays in force: better an old map than none.
  EXPECT_EQ(BuildInForce(), 1);
}

TEST_F(ActivateTest, AnInterruptedActivationIsSettledAtTheNextStart) {
  const std::string one = Run(1), two = IdOf(Bundle(2));
  ASSERT_TRUE(InstallFolder(Bundle(2)).ok());
  StoreState cut = State();
  cut.previous = one, cut.active = two, cut.is_proven = false;
  ASSERT_TRUE(WriteStoreState(layout_, cut).ok());
  EXPECT_EQ(SettleActivation(layout_, kFails).code(), ErrorCode::kUnhealthy);
  EXPECT_EQ(State().active, one);
  ASSERT_TRUE(WriteStoreState(layout_, cut).ok());
  EXPECT_TRUE(SettleActivation(layout_, OpeningProbe(layout_)).ok());
  EXPECT_EQ(State().active, two);
  EXPECT_TRUE(State().is_proven);
  // Settled: nobody is asked.
  EXPECT_TRUE(SettleActivation(layout_, kFails).ok());
}

TEST_F(ActivateTest, RevocationsCountOnceTheReleaseRuns) {
  Run(1);
  ASSERT_TRUE(
      TrustKey(layout_, FormatPublicKey(other_.key()), other_.Endorse(other_.key()), "k").code() ==
      ErrorCode::kUntrusted);
  ASSERT_TRUE(
      TrustKey(layout_, FormatPublicKey(other_.key()), signer_.Endorse(other_.key()), "k").ok());
  SignFolder(Bundle(2), other_, [&](ReleaseStatement* s) { s->revoked_keys = {signer_.id()}; });
  ASSERT_TRUE(InstallFolder(Bundle(2)).ok());
  EXPECT_FALSE(ReadStoreKeys(layout_).value().ring.IsRevoked(signer_.id()));
  ASSERT_TRUE(ActivateHere("").ok());
  EXPECT_TRUE(ReadStoreKeys(layout_).value().ring.IsRevoked(signer_.id()));
  EXPECT_EQ(InstallFolder(Bundle(3)).status().code(), ErrorCode::kKeyRevoked);
  // What the revoked key signed is not run again, not even as the way back.
  EXPECT_EQ(Rollback(layout_, OpeningProbe(layout_)).code(), ErrorCode::kKeyRevoked);
  EXPECT_EQ(RunnableVersions(layout_).value().size(), 1U);
  EXPECT_EQ(BuildInForce(), 2);
}

TEST_F(ActivateTest, AKeyDoesNotRevokeItself) {
  SignFolder(Bundle(1), signer_, [&](ReleaseStatement* s) { s->revoked_keys = {signer_.id()}; });
  ASSERT_TRUE(InstallFolder(Bundle(1)).ok());
  ASSERT_TRUE(ActivateHere("").ok());
  EXPECT_EQ(BuildInForce(), 1);
  EXPECT_EQ(RevokeKey(layout_, signer_.id()).code(), ErrorCode::kInvalidArgument);
}

TEST_F(ActivateTest, DamageInForceFallsBackAtTheNextStart) {
  const std::string one = Run(1), two = Run(2);
  // The manifest tells at once; the order is what the runtime tries.
  const auto path = layout_.version(two) / kManifestName;
  WriteText(path, ReadText(path) + " ");
  EXPECT_EQ(RunnableVersions(layout_).value(), std::vector<std::string>{one});
  EXPECT_EQ(BuildInForce(), 1);
  // A state that nobody can read costs the order, not the map.
  WriteText(layout_.state(), "rubbish");
  EXPECT_EQ(BuildInForce(), 1);
}

TEST(RunInChild, BringsTheAnswerBack) {
  EXPECT_TRUE(RunInChild([] { return Status(); }, 60).ok());
  const Status sick = RunInChild([] { return kSick; }, 60);
  EXPECT_EQ(sick.code(), ErrorCode::kBadData);
  EXPECT_EQ(sick.message(), kSick.message());
  EXPECT_EQ(RunInChild([]() -> Status { throw std::runtime_error("oh"); }, 60).code(),
            ErrorCode::kInternal);
}

TEST(RunInChild, OutlivesCrashesAndHangs) {
  const Status crashed = RunInChild(
      []() -> Status {
        ::raise(SIGKILL);
        return {};
      },
      60);
  EXPECT_EQ(crashed.code(), ErrorCode::kUnhealthy);
  EXPECT_NE(crashed.message().find("signal 9"), std::string::npos);
  const Status hung = RunInChild(
      []() -> Status {
        while (true) ::pause();
      },
      0.3);
  EXPECT_EQ(hung.code(), ErrorCode::kUnhealthy);
  EXPECT_NE(hung.message().find("no answer within 0.3 s"), std::string::npos);
}

}  // namespace
}  // namespace panofix
