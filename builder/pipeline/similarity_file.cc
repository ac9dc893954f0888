#include "builder/pipeline/similarity_file.h"

#include <algorithm>
#include <unordered_map>

#include "common/io/hdf5_file.h"

namespace panofix {

void WriteSimilarityRows(const std::filesystem::path& path, const SimilarityIndex& index,
                         std::span<const std::string> ids, std::size_t per_panorama) {
  SimilarityFile rows;
  std::unordered_map<std::size_t, std::uint32_t> number_of;
  for (const std::uint32_t view : index.views) {
    const std::size_t panorama = view / per_panorama;
    const auto [found, is_new] =
        number_of.emplace(panorama, static_cast<std::uint32_t>(rows.ids.size()));
    if (is_new) rows.ids.push_back(ids[panorama]);
    rows.panoramas.push_back(found->second);
    rows.views.push_back(static_cast<std::uint32_t>(view % per_panorama));
  }
  Hdf5Writer file(path);
  file.WriteStrings("ids", rows.ids);
  file.Write<std::uint32_t>("offsets", index.offsets);
  file.Write<std::uint32_t>("panoramas", rows.panoramas);
  file.Write<std::uint32_t>("views", rows.views);
  file.Write<float>("cosine", index.similarity);
  file.Close();
}

Result<SimilarityFile> ReadSimilarityRows(const std::filesystem::path& path) {
  const auto file = Hdf5Reader::Open(path);
  if (!file.ok()) return file.status();
  auto ids = file->ReadStrings("ids");
  const auto offsets = file->Read<std::uint32_t>("offsets");
  const auto panoramas = file->Read<std::uint32_t>("panoramas");
  const auto views = file->Read<std::uint32_t>("views");
  const auto cosine = file->Read<float>("cosine");
  for (const Status& status :
       {ids.status(), offsets.status(), panoramas.status(), views.status(), cosine.status()}) {
    if (!status.ok()) return status;
  }
  const auto& o = offsets->values;
  const std::size_t size = views->values.size();
  if (o.empty() || o.front() != 0 || o.back() != size || !std::is_sorted(o.begin(), o.end()) ||
      panoramas->values.size() != size || cosine->values.size() != size ||
      std::any_of(panoramas->values.begin(), panoramas->values.end(),
                  [&](std::uint32_t p) { return p >= ids->size(); })) {
    return Status(ErrorCode::kBadData, path.string() + ": rows do not fit; delete the file");
  }
  SimilarityFile rows;
  rows.ids = std::move(ids).value();
  rows.offsets.assign(o.begin(), o.end());
  rows.panoramas.assign(panoramas->values.begin(), panoramas->values.end());
  rows.views.assign(views->values.begin(), views->values.end());
  rows.similarity.assign(cosine->values.begin(), cosine->values.end());
  return rows;
}

}  // namespace panofix
