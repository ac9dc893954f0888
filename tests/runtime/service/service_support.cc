#include "tests/runtime/service/service_support.h"

#include <fstream>
#include <opencv2/imgcodecs.hpp>

namespace panofix::service_test {
namespace {

std::vector<std::uint8_t> Encode(const char* extension, int width_px, int height_px, int offset) {
  cv::Mat image(height_px, width_px, CV_8UC1);
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(2 * x + y + offset);
    }
  }
  std::vector<std::uint8_t> bytes;
  cv::imencode(extension, image, bytes);
  return bytes;
}

class FakeEngine : public FrameEngine {
 public:
  FakeEngine(FakeSource& source, const Camera& camera,
             const BundleIdentity& bundle = SampleBundle())
      : source_(source), camera_(camera), bundle_(bundle) {}
  ~FakeEngine() override {
    while (!source_.may_free) SleepMs(1);
    ++source_.num_freed;
  }
  FrameResult Localize(std::int64_t timestamp_ns, const GrayImage& frame,
                       const TimeIsUp& time_is_up) override {
    ++source_.num_begun;
    if (source_.is_memory_out) throw std::bad_alloc();
    // Steps of a millisecond, so that there is something to end between.
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(source_.work_ms);
    do {
      if (time_is_up && time_is_up()) {
        FrameResult late = SampleNoFix(timestamp_ns);
        late.reason = "deadline";
        return late;
      }
      SleepMs(1);
    } while (std::chrono::steady_clock::now() < end);
    ++source_.num_localized;
    if (frame.width_px == camera_.width_px && frame.height_px == camera_.height_px) {
      return SampleFix(timestamp_ns);
    }
    FrameResult result = SampleNoFix(timestamp_ns);
    result.reason = "frame_size_differs_from_camera";
    return result;
  }
  FrameResult Undecodable(std::int64_t timestamp_ns) const override {
    FrameResult result = SampleNoFix(timestamp_ns);
    result.reason = "frame_undecodable";
    return result;
  }
  const BundleIdentity& bundle() const override { return bundle_; }
  const Camera& camera() const override { return camera_; }
  void Forget() override { ++source_.num_forgotten; }
  Result<std::unique_ptr<FrameEngine>> Another() const override {
    ++source_.num_shared;
    return std::unique_ptr<FrameEngine>(std::make_unique<FakeEngine>(source_, camera_, bundle_));
  }
  MapFacts facts() const override {
    MapFacts facts;
    facts.bundle = bundle_;
    facts.num_tiles = 3;
    facts.panoramas = {{48.8462, 2.3371, 90}, {48.8463, 2.3372, 90}};
    facts.links = {{0, 1}};
    return facts;
  }

 private:
  FakeSource& source_;
  const Camera camera_;
  const BundleIdentity bundle_;
};

}  // namespace

GrayImage SampleImage(int width_px, int height_px) {
  GrayImage image{width_px, height_px, {}};
  for (int y = 0; y < height_px; ++y) {
    for (int x = 0; x < width_px; ++x) {
      image.pixels.push_back(static_cast<std::uint8_t>(3 * x + 5 * y));
    }
  }
  return image;
}

std::vector<std::uint8_t> SampleJpeg(int width_px, int height_px) {
  return Encode(".jpg", width_px, height_px, 0);
}
std::vector<std::uint8_t> SamplePng() { return Encode(".png", 64, 48, 0); }

FramePose SamplePose() {
  FramePose pose;
  pose.position = {48.8462, 2.3371, 94.25};
  pose.attitude = {123.5, -1.25, 0.5};
  pose.enu_from_cam = Eigen::Quaterniond(EnuFromBody(pose.attitude) * BodyFromCam()).normalized();
  pose.position_in_map = {1234.5, -678.9, 94.25};
  // The grid's axes stand 0.3 rad off true north: far more than any real convergence.
  pose.map_from_cam =
      Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ())) * pose.enu_from_cam;
  Eigen::Matrix<double, 6, 6> factor;
  for (int i = 0; i < 36; ++i) factor(i / 6, i % 6) = 0.01 * ((7 * i) % 11 - 4) + (i % 7 ? 0 : 0.2);
  pose.covariance_in_map = factor * factor.transpose();
  return pose;
}

FrameResult SampleFix(std::int64_t timestamp_ns) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.status = FixStatus::kFix;
  result.pose = SamplePose();
  result.num_inliers = 87, result.num_views = 4, result.best_panorama = "pano_17";
  result.latency = {1.5, 30.25, 4, 9.5, 12, 58};
  result.num_compared = 320, result.num_database = 25'000;
  return result;
}

FrameResult SampleNoFix(std::int64_t timestamp_ns) {
  FrameResult result;
  result.timestamp_ns = timestamp_ns;
  result.reason = "too_few_inliers";
  result.num_inliers = 7;
  return result;
}

BundleIdentity SampleBundle() {
  BundleIdentity bundle;
  bundle.name = "town";
  bundle.id = std::string(64, 'a');
  bundle.build = 42;
  return bundle;
}

void WriteDrive(const std::filesystem::path& folder, int num_frames) {
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "camera.yaml") << ToCameraYaml(SampleCamera(), "sample");
  std::ofstream frames(folder / "frames.csv");
  frames << "timestamp_ns,image\n";
  for (int i = 0; i < num_frames; ++i) {
    const std::string name = "frame_" + std::to_string(i) + ".jpg";
    frames << kDriveStartNs + i * kDriveStepNs << ',' << name << '\n';
    const auto bytes = Encode(".jpg", 64, 48, 10 * i);
    std::ofstream(folder / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }
}

Result<std::unique_ptr<FrameEngine>> FakeSource::Open(const Camera& camera) {
  const std::lock_guard lock(mutex_);
  opened_.push_back(camera);
  return std::unique_ptr<FrameEngine>(std::make_unique<FakeEngine>(*this, camera));
}

Result<std::unique_ptr<FrameEngine>> FakeSource::OpenUpdate(const Camera& camera) {
  ++num_updates;
  SleepMs(update_ms);
  if (opening_ < 0 && !is_mended) {
    ++num_failed;
    return Status(ErrorCode::kBadData, "the newer map is broken");
  }
  BundleIdentity bundle = SampleBundle();
  bundle.build = opening_;
  std::int64_t opened = opening_;
  next_build.compare_exchange_strong(opened, 0);
  return std::unique_ptr<FrameEngine>(std::make_unique<FakeEngine>(*this, camera, bundle));
}

std::vector<Camera> FakeSource::opened() const {
  const std::lock_guard lock(mutex_);
  return opened_;
}

Result<std::unique_ptr<FrameEngine>> SlowSource::Open(const Camera& camera) {
  ++num_tried;
  while (!may_open && !CancelRequested()) SleepMs(1);
  if (CancelRequested()) return Status(ErrorCode::kCancelled, "interrupted");
  if (is_broken) return Status(ErrorCode::kBadData, "the map is broken");
  return FakeSource::Open(camera);
}

RunningServe::RunningServe(ServeOptions options, EngineSource& source) {
  options.on_ready = [this](const std::string& poses) {
    const std::lock_guard lock(mutex_);
    poses_ = poses;
    ready_ = true;
  };
  thread_ = std::thread([this, options, &source] {
    Status status = ServeFrom(options, source);
    const std::lock_guard lock(mutex_);
    status_ = std::move(status);
    ended_ = true;
  });
  EXPECT_TRUE(Eventually([this] {
    SleepMs(2);
    return ready_ || ended_;
  }));
}

std::string RunningServe::poses() const {
  const std::lock_guard lock(mutex_);
  return poses_;
}

Status RunningServe::Stop() {
  RequestCancel();
  if (thread_.joinable()) thread_.join();
  ClearCancel();
  return status_;
}

ServeOptions ServeOptionsFor(const std::string& frames) {
  ServeOptions options;
  options.bundle = "fake";
  options.frames = frames;
  options.poses = kAnyPort;
  options.camera_wait_s = 0;
  options.max_rate_hz = 0;
  return options;
}

Publisher OpenPublisher(const std::string& endpoint) {
  PublisherOptions options;
  options.linger_ms = 0;
  return ValueOrThrow(Publisher::Bind(endpoint, options));
}

Subscriber OpenSubscriber(const std::string& endpoint, std::vector<std::string_view> topics) {
  SubscriberOptions options;
  options.topics = std::move(topics);
  options.receive_queue_messages = 0;
  return ValueOrThrow(Subscriber::Open(endpoint, options));
}

std::optional<WireMessage> ReceiveOne(Subscriber& subscriber, int timeout_ms) {
  auto message = subscriber.Receive(timeout_ms);
  EXPECT_TRUE(message.ok()) << message.status().message();
  return message.ok() ? *message : std::nullopt;
}

}  // namespace panofix::service_test
