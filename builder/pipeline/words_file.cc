// Work files of the vocabulary's stages: samples and words.
#include <algorithm>

#include "builder/pipeline/vocabulary_stage.h"
#include "common/io/hdf5_file.h"

namespace panofix {
namespace {

struct WordLists {
  std::vector<std::uint32_t> offsets{0}, words;
  void Add(const std::vector<std::uint32_t>& view) {
    words.insert(words.end(), view.begin(), view.end());
    offsets.push_back(static_cast<std::uint32_t>(words.size()));
  }
};

Result<WordLists> ReadLists(const Hdf5Reader& file, const std::string& group) {
  const auto offsets = file.Read<std::uint32_t>(group + "/offsets");
  if (!offsets.ok()) return offsets.status();
  const auto words = file.Read<std::uint32_t>(group + "/words");
  if (!words.ok()) return words.status();
  const auto& o = offsets->values;
  if (o.empty() || o.front() != 0 || o.back() != words->values.size() ||
      !std::is_sorted(o.begin(), o.end())) {
    return Status(ErrorCode::kBadData, group + ": offsets do not fit; delete the file");
  }
  WordLists lists;
  lists.offsets.assign(o.begin(), o.end());
  lists.words.assign(words->values.begin(), words->values.end());
  return lists;
}

}  // namespace

void WriteSamples(const std::filesystem::path& path, std::span<const std::string> ids,
                  std::span<const TrainingSample> samples) {
  std::vector<std::uint32_t> num_sift, num_mser;
  std::vector<std::uint8_t> sift, mser;
  for (const TrainingSample& sample : samples) {
    sift.insert(sift.end(), sample.sift.begin(), sample.sift.end());
    mser.insert(mser.end(), sample.mser.begin(), sample.mser.end());
    num_sift.push_back(static_cast<std::uint32_t>(sample.sift.size() / kDescriptorSize));
    num_mser.push_back(static_cast<std::uint32_t>(sample.mser.size() / kDescriptorSize));
  }
  Hdf5Writer file(path);
  file.WriteStrings("ids", {ids.begin(), ids.end()});
  file.Write<std::uint32_t>("sift/count", num_sift);
  file.Write<std::uint8_t>("sift/descriptors", sift, kDescriptorSize);
  file.Write<std::uint32_t>("mser/count", num_mser);
  file.Write<std::uint8_t>("mser/descriptors", mser, kDescriptorSize);
  file.Close();
}

Status ReadSamples(const std::filesystem::path& path,
                   std::map<std::string, TrainingSample>* samples) {
  const auto file = Hdf5Reader::Open(path);
  if (!file.ok()) return file.status();
  const auto ids = file->ReadStrings("ids");
  if (!ids.ok()) return ids.status();
  for (const char* kind : {"sift", "mser"}) {
    const auto counts = file->Read<std::uint32_t>(std::string(kind) + "/count");
    if (!counts.ok()) return counts.status();
    const auto rows = file->Read<std::uint8_t>(std::string(kind) + "/descriptors", kDescriptorSize);
    if (!rows.ok()) return rows.status();
    std::uint64_t total = 0;
    for (const std::uint32_t count : counts->values) total += count;
    if (counts->values.size() != ids->size() || total != static_cast<std::uint64_t>(rows->rows))
      return {ErrorCode::kBadData, path.string() + ": counts do not fit; delete the file"};
    std::size_t at = 0;
    for (std::size_t i = 0; i < ids->size(); ++i) {
      const auto part = rows->values.subspan(at, counts->values[i] * kDescriptorSize);
      TrainingSample& sample = (*samples)[(*ids)[i]];
      (kind[0] == 's' ? sample.sift : sample.mser).assign(part.begin(), part.end());
      at += part.size();
    }
  }
  return {};
}

void WriteWords(const std::filesystem::path& path, std::span<const ViewWords> views) {
  WordLists sift, mser;
  for (const ViewWords& view : views) sift.Add(view.sift), mser.Add(view.mser);
  Hdf5Writer file(path);
  file.Write<std::uint32_t>("sift/offsets", sift.offsets);
  file.Write<std::uint32_t>("sift/words", sift.words);
  file.Write<std::uint32_t>("mser/offsets", mser.offsets);
  file.Write<std::uint32_t>("mser/words", mser.words);
  file.Close();
}

Result<std::vector<ViewWords>> ReadWords(const std::filesystem::path& path) {
  const auto file = Hdf5Reader::Open(path);
  if (!file.ok()) return file.status();
  const auto sift = ReadLists(*file, "sift"), mser = ReadLists(*file, "mser");
  if (!sift.ok()) return sift.status();
  if (!mser.ok()) return mser.status();
  if (sift->offsets.size() != mser->offsets.size())
    return Status(ErrorCode::kBadData, path.string() + ": views disagree; delete the file");
  const auto slice = [](const WordLists& lists, std::size_t v) {
    return std::vector<std::uint32_t>(lists.words.begin() + lists.offsets[v],
                                      lists.words.begin() + lists.offsets[v + 1]);
  };
  std::vector<ViewWords> views;
  for (std::size_t v = 0; v + 1 < sift->offsets.size(); ++v)
    views.push_back({slice(*sift, v), slice(*mser, v)});
  return views;
}

}  // namespace panofix
