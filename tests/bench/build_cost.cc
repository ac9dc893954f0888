// What a panorama costs the builder beside what it cannot do without (its decode and its features),
// and what the similarity index and retrieval cost as views grow.
#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "builder/extract/panorama_features.h"
#include "builder/similarity/similarity_index.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/rng.h"
#include "common/image/gray_image.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

double Seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Of this process, all threads: what a busy machine does not change much.
double CpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// A panorama with as much to see as a street: blobs of all sizes.
void WritePicture(const fs::path& path, int width_px, std::uint64_t seed) {
  Rng rng(seed, "bench/panorama");
  cv::Mat image(width_px / 2, width_px, CV_8UC3, cv::Scalar(120, 125, 130));
  for (int i = 0; i < 40000; ++i) {
    const int size_px = 4 + static_cast<int>(0.01 * width_px * rng.Uniform() * rng.Uniform());
    const cv::Point at(static_cast<int>(rng.Below(static_cast<std::uint64_t>(width_px))),
                       static_cast<int>(rng.Below(static_cast<std::uint64_t>(width_px / 2))));
    const cv::Scalar colour(rng.Uniform(0, 255), rng.Uniform(0, 255), rng.Uniform(0, 255));
    if (i % 2 == 0) {
      cv::rectangle(image, cv::Rect(at.x, at.y, size_px, 1 + size_px / 2), colour, cv::FILLED);
    } else {
      cv::circle(image, at, size_px / 2, colour, cv::FILLED);
    }
  }
  cv::imwrite(path.string(), image, {cv::IMWRITE_JPEG_QUALITY, 90});
}

// One panorama as the extract stage does it, against decoding and describing alone.
void MeasurePanorama(const fs::path& folder, int width_px, int num_panoramas) {
  const Camera camera = Camera::FromHorizontalFov(800, 600, 70);
  const Rectifier rectifier(camera, RingOfViews(8, 0));
  std::vector<PanoramaRecord> records;
  for (int i = 0; i < num_panoramas; ++i) {
    PanoramaRecord record;
    record.id = std::to_string(i);
    record.image = folder / (record.id + ".jpg");
    WritePicture(record.image, width_px, static_cast<std::uint64_t>(i));
    records.push_back(record);
  }
  const ExtractOptions options;
  double decode_s = 0, features_s = 0, whole_s = 0;
  const int reduction = PanoramaReduction(width_px, camera);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    for (const PanoramaRecord& record : records) {
      GrayImage image;
      decode_s += Seconds([&] {
        const auto bytes = ValueOrThrow(ReadFileBytes(record.image, std::size_t{1} << 30));
        image = ValueOrThrow(DecodeGray(bytes, reduction));
      });
      const GrayImage panorama = ValueOrThrow(DecodePanorama(record.image, camera));
      for (int v = 0; v < 8; ++v) {
        const GrayImage view = rectifier.Cut(panorama, v);
        features_s += Seconds([&] {
          const GrayImage ready = Preprocess(view, options.features);
          (void)ExtractSift(ready, options.features);
          (void)ExtractMser(ready, options.features);
        });
      }
      whole_s += Seconds([&] { (void)ValueOrThrow(ExtractPanorama(record, rectifier, options)); });
    }
  }
  const auto all = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return Seconds([&] {
      tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        (void)ValueOrThrow(ExtractPanorama(records[i], rectifier, options));
      });
    });
  };
  const double cpu_before_s = CpuSeconds();
  const double one_s = all(1), one_cpu_s = CpuSeconds() - cpu_before_s;
  const double two_s = all(2), two_cpu_s = CpuSeconds() - cpu_before_s - one_cpu_s;
  const double n = num_panoramas;
  std::printf("panorama %d x %d px, 8 views of 800 x 600, decoded at 1/%d; seconds a panorama\n",
              width_px, width_px / 2, reduction);
  std::printf("decode %.3f, features %.3f, whole %.3f: ratio %.2f\n", decode_s / n, features_s / n,
              whole_s / n, whole_s / (decode_s + features_s));
  std::printf(
      "%d panoramas: 1 thread %.2f s, 2 threads %.2f s: speed-up %.2f; processor time %.2f "
      "and %.2f s\n",
      num_panoramas, one_s, two_s, one_s / two_s, one_cpu_s, two_cpu_s);
  std::printf("peak memory %.0f MB with 2 at work\n\n",
              static_cast<double>(PeakMemoryBytes()) / 1e6);
}

// Streets of linked panoramas with bags that change along them.
void MeasureSimilarity(std::uint32_t num_panoramas) {
  constexpr std::uint32_t kViews = 8, kWords = 64000, kWordsAView = 150;
  std::vector<std::vector<std::uint32_t>> links(num_panoramas);
  std::vector<std::array<double, 3>> positions(num_panoramas);
  std::vector<BagOfWords> bags(std::size_t{num_panoramas} * kViews);
  std::vector<std::uint32_t> panorama_of_view;
  for (std::uint32_t p = 0; p < num_panoramas; ++p) {
    positions[p] = {11.0 * p, 0, 0};
    if (p > 0) links[p].push_back(p - 1);
    if (p + 1 < num_panoramas) links[p].push_back(p + 1);
    panorama_of_view.insert(panorama_of_view.end(), kViews, p);
  }
  tbb::parallel_for(std::size_t{0}, bags.size(), [&](std::size_t v) {
    Rng rng(v / (5 * kViews), "bench/words");  // a scene
    Rng own(v, "bench/words");
    std::set<std::uint32_t> words;
    while (words.size() < kWordsAView)
      words.insert(static_cast<std::uint32_t>((words.size() % 2 == 0 ? rng : own).Below(kWords)));
    for (const std::uint32_t word : words)
      bags[v].push_back({word, 1 / std::sqrt(static_cast<float>(kWordsAView))});
  });
  const SimilarityOptions options;
  SimilarityIndex index;
  const double seconds = Seconds([&] {
    const auto near = AppearanceNeighbourhoods(links, positions, static_cast<int>(kViews), options);
    index = SimilarityRows(bags, panorama_of_view, near, options, 0, bags.size());
  });
  // A frame that is lost is compared with all of them.
  constexpr std::size_t kQueries = 100;
  const InvertedIndex inverted(bags);
  std::size_t num_right = 0;
  const double queries_s = Seconds([&] {
    for (std::size_t q = 0; q < kQueries; ++q) {
      const std::size_t v = q * bags.size() / kQueries;
      const std::vector<float> scores = inverted.Score(bags[v]);
      num_right += std::max_element(scores.begin(), scores.end()) - scores.begin() ==
                   static_cast<std::ptrdiff_t>(v);
    }
  });
  std::printf(
      "%9zu views %9.2f s %9.1f us a view %12zu entries; retrieval %8.2f ms a query, %zu of %zu "
      "right; %8.0f MB\n",
      bags.size(), seconds, 1e6 * seconds / static_cast<double>(bags.size()), index.views.size(),
      1e3 * queries_s / kQueries, num_right, kQueries,
      static_cast<double>(PeakMemoryBytes()) / 1e6);
  std::fflush(stdout);
}

int Main(int argc, char** argv) {
  CLI::App app("build_cost: what panoramas and views cost the builder");
  fs::path folder = fs::temp_directory_path() / "panofix_build_cost";
  int width_px = 13312, num_panoramas = 6;
  std::uint32_t max_views = 1'000'000;
  app.add_option("--folder", folder, "for pictures, removed at the end")->capture_default_str();
  app.add_option("--width-px", width_px, "of the panoramas")->capture_default_str();
  app.add_option("--panoramas", num_panoramas, "number of them")->capture_default_str();
  app.add_option("--max-views", max_views, "of the similarity index")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  fs::create_directories(folder);
  MeasurePanorama(folder, width_px, num_panoramas);
  fs::remove_all(folder);
  std::printf("similarity index, all processors; retrieval, one\n");
  for (std::uint32_t views = 1000; views <= max_views; views *= 10) MeasureSimilarity(views / 8);
  return 0;
}

}  // namespace
}  // namespace panofix

int main(int argc, char** argv) {
  try {
    return panofix::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "build_cost: %s\n", error.what());
    return 1;
  }
}
