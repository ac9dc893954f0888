// JPEG and PNG: header, completeness walk and the bounded decoders behind them.

#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/image/gray_image.h"
#include "tests/fuzz/fuzz_target.h"

namespace panofix {
namespace {

std::string Encoded(const char* extension, const cv::Mat& mat, const std::vector<int>& parameters) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(extension, mat, bytes, parameters);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

FuzzCorpus SeedCorpus() {
  cv::Mat grey(24, 48, CV_8UC1), color(24, 48, CV_8UC3), deep(8, 16, CV_16UC1, cv::Scalar(700));
  cv::theRNG().state = 1;
  cv::randu(grey, 0, 255);
  cv::randu(color, 0, 255);
  FuzzCorpus corpus;
  corpus.inputs = {Encoded(".jpg", grey, {}),
                   Encoded(".jpg", color, {}),
                   Encoded(".jpg", color, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}),
                   Encoded(".jpg", color, {cv::IMWRITE_JPEG_RST_INTERVAL, 2}),
                   Encoded(".png", grey, {}),
                   Encoded(".png", color, {}),
                   Encoded(".png", deep, {})};
  corpus.words = {"\xFF\xD8", "\xFF\xD9", "\xFF\xDA",
                  "\xFF\xC0", "\xFF\xC4", "\xFF\xFF",
                  "IDAT",     "IEND",     std::string("\0\0", 2)};
  return corpus;
}

}  // namespace panofix

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  panofix::DecodeLimits limits;
  limits.max_pixels = 1 << 16;  // a decoder's time is not what is looked for
  const auto stated = panofix::ReadImageSize({data, size});
  for (const int reduction : {1, 4}) {
    const auto image = panofix::DecodeGray({data, size}, reduction, limits);
    if (!image.ok()) continue;
    if (!stated.ok() || image->width_px != (stated->width_px + reduction - 1) / reduction)
      std::abort();
    if (image->pixels.size() !=
        static_cast<std::size_t>(image->width_px) * static_cast<std::size_t>(image->height_px)) {
      std::abort();
    }
  }
  const auto deep = panofix::DecodePng16({data, size}, limits);
  if (deep.ok() && deep->pixels.empty()) std::abort();
  return 0;
}
