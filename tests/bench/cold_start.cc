// How long a service takes from its start, with nothing of the map in the page cache, to its first
// answer and to the first that a map of any size gave; and what memory it holds then.
//   cold_start MAP --drive DRIVE --runtime PROGRAM --work FOLDER --copies 200 [--memory-mb N]
// lays copies of a real map side by side until it is as large as wanted.
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <thread>

#include "common/drive/drive.h"
#include "common/io/read_file.h"
#include "common/map/landmark_codes.h"
#include "runtime/service/messages.h"
#include "runtime/service/sockets.h"
#include "runtime/service/topics.h"
#include "tests/common/map/crafted_bundle.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kFrameInterval(50);

struct Options {
  fs::path map, drive, runtime, work;
  std::uint32_t num_copies = 200;
  std::string memory_mb;
  double patience_s = 600;
  bool without_words = false;
};

std::string IdOf(const MapPanorama& panorama, std::uint32_t copy) {
  return panorama.id + "-" + std::to_string(copy);
}

void AddPanoramas(const MapBundle& map, std::uint32_t copy, CraftedBundle* city) {
  constexpr double kApart_m = 500;
  const auto first = static_cast<std::uint32_t>(city->ids.size());
  const auto first_view =
      static_cast<std::uint32_t>(city->station_panoramas.size()) * map.views_per_station();
  for (std::uint32_t p = 0; p < map.panoramas().size(); ++p) {
    const MapPanorama& panorama = map.panoramas()[p];
    std::vector<std::uint32_t> links = panorama.links;
    for (std::uint32_t& link : links) link += first;
    Rigid3 pose = panorama.map_from_pano;
    pose.translation.x() += kApart_m * copy;
    city->AddPanorama(IdOf(panorama, copy), pose, links, panorama.has_depth);
    for (std::uint32_t s = map.first_station(p) + 1; s < map.first_station(p + 1); ++s)
      city->AddStation(map.stations()[s].position_in_pano.cast<float>());
    for (std::uint32_t v = 0; v < map.views_per_station(); ++v) {
      for (const std::uint32_t similar :
           map.SimilarViews(map.first_station(p) * map.views_per_station() + v)) {
        city->similar.push_back(first_view + similar);
      }
      city->similar_offsets.push_back(static_cast<std::uint32_t>(city->similar.size()));
    }
  }
}

CraftedTile CopyOf(const MapBundle& map, std::size_t tile_idx, std::uint32_t copy,
                   bool with_words) {
  const MapTile& tile = map.tiles().Get(tile_idx);
  CraftedTile out;
  out.path = "tiles/" + std::to_string(10'000 + copy) + "-" + std::to_string(tile_idx) + ".h5";
  for (const std::uint32_t p : tile.panoramas())
    out.panorama_ids.push_back(IdOf(map.panoramas()[p], copy));
  for (std::size_t i = 0; i < tile.num_landmarks(); ++i) {
    const MapLandmark landmark = tile.Landmark(i);
    std::uint8_t descriptor[kDescriptorSize], packed[kPackedDescriptorSize];
    tile.Descriptor(i, descriptor);
    PackDescriptor(descriptor, packed);
    out.AddLandmark(landmark, packed);
    const std::uint32_t anchor = landmark.panorama_idx;
    if (i + 1 < tile.num_landmarks() && tile.Landmark(i + 1).panorama_idx == anchor) continue;
    std::vector<MapSurface> surfaces;
    for (int s = 0; s < 256; ++s) surfaces.push_back(tile.Surface(anchor, s));
    while (!surfaces.empty() && surfaces.back().normal_in_pano.isZero()) surfaces.pop_back();
    out.EndAnchor(IdOf(map.panoramas()[anchor], copy), surfaces);
  }
  for (std::size_t slot = 0; slot < tile.num_views(); ++slot) {
    const auto shown = tile.LandmarksOf(slot);
    out.EndView({shown.begin(), shown.end()}, tile.Bag(slot));
  }
  if (!with_words) return out;
  out.landmark_words.emplace(tile.words().begin(), tile.words().end());
  if (tile.words().empty()) out.landmark_words = tile.DeriveWords(map.vocabulary().sift);
  return out;
}

void WriteCity(const Options& o, const fs::path& folder) {
  const auto map = ValueOrThrow(MapBundle::Open(o.map));
  CraftedBundle city;
  city.manifest = map->manifest();
  city.manifest.parts.clear();
  city.manifest.num_landmarks = 0;
  city.vocabulary = map->vocabulary();
  for (std::uint32_t v = 0; v < map->views_per_station(); ++v) {
    city.directions.push_back(map->views()[v].yaw_deg);
    city.directions.push_back(map->views()[v].pitch_deg);
  }
  for (std::uint32_t copy = 0; copy < o.num_copies; ++copy) {
    AddPanoramas(*map, copy, &city);
    for (std::size_t tile = 0; tile < map->tiles().size(); ++tile)
      city.tiles.push_back(CopyOf(*map, tile, copy, !o.without_words));
  }
  city.Write(folder);
}

double MegabytesOf(const fs::path& folder) {
  double bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) bytes += static_cast<double>(entry.file_size());
  }
  return bytes / 1e6;
}

double ResidentMegabytes(pid_t pid) {
  std::ifstream file("/proc/" + std::to_string(pid) + "/status");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("VmRSS:")) return std::stod(line.substr(6)) * 1024 / 1e6;
  }
  return 0;
}

// Needs root; otherwise the figures are those of a warm start.
bool DropPageCache() {
  ::sync();
  std::ofstream file("/proc/sys/vm/drop_caches");
  return static_cast<bool>(file << 3 << std::flush);
}

pid_t Start(std::vector<std::string> command) {
  std::vector<char*> argv;
  for (std::string& argument : command) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_t pid = -1;
  if (::posix_spawn(&pid, argv[0], nullptr, nullptr, argv.data(), environ) != 0)
    throw Error(ErrorCode::kNotFound, command[0] + ": cannot be started");
  return pid;
}

void Run(const Options& o) {
  const fs::path city = o.work / "city";
  if (!fs::exists(city)) WriteCity(o, city);
  const Drive drive = ValueOrThrow(ReadDrive(o.drive));
  const std::string jpeg =
      ValueOrThrow(ReadFileText(drive.frames.front().image, std::size_t{64} << 20));
  const std::vector<std::uint8_t> bytes(jpeg.begin(), jpeg.end());
  const std::string frames = "ipc://" + (o.work / "frames").string(),
                    poses = "ipc://" + (o.work / "poses").string();
  Publisher camera = ValueOrThrow(Publisher::Bind(frames, {}));
  SubscriberOptions wanted;
  wanted.topics = {kPoseTopic};
  Subscriber answers = ValueOrThrow(Subscriber::Open(poses, wanted));
  const bool is_cold = DropPageCache();
  std::vector<std::string> command{o.runtime.string(), "serve",
                                   "--bundle",         city.string(),
                                   "--frames",         frames,
                                   "--poses",          poses,
                                   "--camera",         (o.drive / "camera.yaml").string()};
  if (!o.memory_mb.empty()) command.insert(command.end(), {"--memory-mb", o.memory_mb});
  const auto start = Clock::now();
  const auto since_s = [&] { return std::chrono::duration<double>(Clock::now() - start).count(); };
  const pid_t pid = Start(command);
  double first_s = -1;
  auto next = start;
  for (std::int64_t time_ns = 1; since_s() < o.patience_s;) {
    if (Clock::now() >= next) {  // at a camera's rate: answers to more would take the map's time
      next = Clock::now() + kFrameInterval;
      ThrowIfError(camera.Send(kFrameTopic, PackFrame(time_ns++, bytes)));
    }
    static_cast<void>(camera.TakeSubscriptions(0));
    const auto message = ValueOrThrow(answers.Receive(10));
    if (!message) continue;
    const ReceivedResult answer = ValueOrThrow(UnpackResult(message->payload));
    if (first_s < 0) first_s = since_s();
    if (answer.row.reason == "map_loading") continue;
    std::printf(
        "%s start, map of %.0f MB: first answer after %.2f s, first of the map after %.1f s "
        "(%s), %.0f MB resident\n",
        is_cold ? "cold" : "WARM", MegabytesOf(city), first_s, since_s(),
        answer.row.reason.empty() ? "fix" : answer.row.reason.c_str(), ResidentMegabytes(pid));
    break;
  }
  const auto told = Clock::now();
  ::kill(pid, SIGTERM);
  ::waitpid(pid, nullptr, 0);
  std::printf("ended %.2f s after it was told to\n",
              std::chrono::duration<double>(Clock::now() - told).count());
}

}  // namespace
}  // namespace panofix

int main(int argc, char** argv) {
  panofix::Options o;
  CLI::App app("Time from the start of a service to its answers, for a map of any size");
  app.add_option("map", o.map, "a real bundle, copied side by side")->required();
  app.add_option("--drive", o.drive, "its first frame is sent")->required();
  app.add_option("--runtime", o.runtime, "the program panofix-runtime")->required();
  app.add_option("--work", o.work, "folder for the large bundle, which is kept there")->required();
  app.add_option("--copies", o.num_copies)->capture_default_str();
  app.add_option("--memory-mb", o.memory_mb, "handed on");
  app.add_flag("--without-words", o.without_words, "lays it as format 2.1 was");
  CLI11_PARSE(app, argc, argv);
  try {
    std::filesystem::create_directories(o.work);
    panofix::Run(o);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cold_start: %s\n", error.what());
    return 1;
  }
  return 0;
}
