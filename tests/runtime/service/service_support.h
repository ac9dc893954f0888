#pragma once
// What the service's tests share: sample messages, an engine that answers without a map, and
// sockets on free addresses.

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/base/cancel.h"
#include "common/base/log.h"
#include "runtime/service/messages.h"
#include "runtime/service/serve.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"

namespace panofix::service_test {

// Sockets answer in milliseconds; a loaded machine may take long. Only a failing test waits this
// long.
inline constexpr std::chrono::seconds kPatience(20);
inline constexpr const char* kAnyPort = "tcp://127.0.0.1:*";

// Repeats `step` until it returns true; false where patience ends first.
template <typename Step>
bool Eventually(Step step) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (std::chrono::steady_clock::now() < end) {
    if (step()) return true;
  }
  return false;
}

inline void SleepMs(int duration_ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(duration_ms));
}

// A folder of its own for each test, gone afterwards. Short, because ipc paths end at 107
// characters.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    char name[] = "/tmp/panofix_service_XXXXXX";
    path_ = mkdtemp(name);
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline Camera SampleCamera() { return Camera::FromHorizontalFov(64, 48, 70); }

// A gradient, so that a wrong stride or channel order shows.
GrayImage SampleImage(int width_px = 64, int height_px = 48);
std::vector<std::uint8_t> SampleJpeg(int width_px = 64, int height_px = 48);
std::vector<std::uint8_t> SamplePng();
FramePose SamplePose();
FrameResult SampleFix(std::int64_t timestamp_ns);
FrameResult SampleNoFix(std::int64_t timestamp_ns);
BundleIdentity SampleBundle();
// frames.csv, camera.yaml and `num_frames` JPEGs of different content; times step by 0.1 s.
void WriteDrive(const std::filesystem::path& folder, int num_frames);
inline constexpr std::int64_t kDriveStartNs = 1'700'000'000'000'000'000;
inline constexpr std::int64_t kDriveStepNs = 100'000'000;

// Answers every frame of its camera's size with SampleFix, and remembers what it was asked.
class FakeSource : public EngineSource {
 public:
  Result<Camera> BundleCamera() override { return SampleCamera(); }
  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override;
  std::string NewerMap() override {
    opening_ = next_build;
    return opening_ == 0 ? "" : std::to_string(opening_);
  }
  Result<std::unique_ptr<FrameEngine>> OpenUpdate(const Camera& camera) override;

  [[nodiscard]] std::vector<Camera> opened() const;
  std::atomic<bool> is_memory_out{false};  // frames throw then
  std::atomic<int> work_ms{0};             // how long a frame takes
  std::atomic<int> num_begun{0}, num_localized{0}, num_forgotten{0};
  std::atomic<int> num_shared{0};  // engines over a map that was open already
  std::atomic<int> update_ms{0};   // how long a newer map takes to open
  // A newer map of this build is there, until it has been opened; negative: a bad one.
  std::atomic<std::int64_t> next_build{0};
  std::atomic<bool> may_free{true};  // engines end
  std::atomic<int> num_freed{0};
  std::atomic<bool> is_mended{false};              // the bad one opens
  std::atomic<int> num_updates{0}, num_failed{0};  // times that it was opened, that it did not open

 private:
  mutable std::mutex mutex_;
  std::vector<Camera> opened_;
  std::int64_t opening_ = 0;
};

// Opens when it is let, or told to stop.
class SlowSource : public FakeSource {
 public:
  Result<std::unique_ptr<FrameEngine>> Open(const Camera& camera) override;
  std::atomic<bool> may_open{false}, is_broken{false};
  std::atomic<int> num_tried{0};
};

// Runs ServeFrom in a thread; the destructor stops it.
class RunningServe {
 public:
  RunningServe(ServeOptions options, EngineSource& source);
  ~RunningServe() { static_cast<void>(Stop()); }
  RunningServe(const RunningServe&) = delete;
  RunningServe& operator=(const RunningServe&) = delete;
  [[nodiscard]] std::string poses() const;  // endpoint
  [[nodiscard]] bool ended() const { return ended_; }
  Status Stop();

 private:
  std::string poses_;
  Status status_;
  mutable std::mutex mutex_;
  std::atomic<bool> ready_{false}, ended_{false};
  std::thread thread_;
};

ServeOptions ServeOptionsFor(const std::string& frames);
Publisher OpenPublisher(const std::string& endpoint = kAnyPort);
Subscriber OpenSubscriber(const std::string& endpoint, std::vector<std::string_view> topics);
// The next message, or nullopt where none comes within `timeout_ms`.
std::optional<WireMessage> ReceiveOne(Subscriber& subscriber, int timeout_ms = 100);
// Sends `payload` on `topic` again and again until `subscriber` has a result for which `wanted`
// holds.
template <typename Wanted>
std::optional<ReceivedResult> SendUntil(Publisher& publisher, std::string_view topic,
                                        std::span<const std::uint8_t> payload,
                                        Subscriber& subscriber, Wanted wanted) {
  std::optional<ReceivedResult> found;
  Eventually([&] {
    EXPECT_TRUE(publisher.Send(topic, payload).ok());
    static_cast<void>(publisher.TakeSubscriptions(0));
    const auto message = ReceiveOne(subscriber, 30);
    if (!message || message->topic != kPoseTopic) return false;
    auto result = UnpackResult(message->payload);
    if (result.ok() && wanted(*result)) found = *result;
    return found.has_value();
  });
  return found;
}

// Clears a stop request before and after each test.
class ServiceTest : public testing::Test {
 protected:
  void SetUp() override {
    ClearCancel();
    SetLogLevel("off");
  }
  void TearDown() override { ClearCancel(); }
};

}  // namespace panofix::service_test
