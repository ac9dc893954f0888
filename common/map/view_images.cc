#include "common/map/view_images.h"

#include "common/base/log.h"
#include "common/map/map_arrays.h"

namespace panofix {

using namespace map_internal;

Status ViewImages::Load(const Hdf5Reader& file,
                        const std::unordered_map<std::string, std::uint32_t>& panorama_idx,
                        std::size_t views_per_panorama) {
  auto ids = file.ReadStrings("panorama_ids");
  if (!ids.ok()) return ids.status();
  PANOFIX_READ(offsets, file, std::uint32_t, "views/offsets", 1);
  PANOFIX_READ(bytes, file, std::uint8_t, "views/jpeg", 1);
  if (!AreOffsets(offsets.values, ids->size() * views_per_panorama, bytes.values.size()))
    return Bad("view images disagree");
  for (std::size_t i = 0; i < ids->size(); ++i) {
    const auto found = panorama_idx.find((*ids)[i]);
    if (found == panorama_idx.end()) return Bad("panorama " + (*ids)[i] + " is not in graph.h5");
    if (!place_of_.try_emplace(found->second, Place{parts_.size(), i * views_per_panorama}).second)
      return Bad("images of panorama " + (*ids)[i] + " are there twice");
  }
  parts_.push_back({std::move(offsets), std::move(bytes)});
  return {};
}

#undef PANOFIX_READ

Result<GrayImage> ViewImages::Decode(std::uint32_t panorama_idx, std::size_t view,
                                     const Camera& camera) const {
  const auto place = place_of_.find(panorama_idx);
  if (place == place_of_.end()) {
    return Status(ErrorCode::kNotFound,
                  "the map keeps no image of this view; build it with --keep-view-images");
  }
  const Part& part = parts_[place->second.part];
  const std::size_t row = place->second.first_row + view;
  const std::uint32_t begin = part.offsets.values[row], end = part.offsets.values[row + 1];
  auto image = DecodeGray(part.bytes.values.subspan(begin, end - begin));
  if (!image.ok()) return Status(ErrorCode::kBadData, image.status().message());
  if (image->width_px != camera.width_px || image->height_px != camera.height_px) {
    return Bad(Format("view image of %dx%d pixels, the camera has %dx%d", image->width_px,
                      image->height_px, camera.width_px, camera.height_px));
  }
  return image;
}

}  // namespace panofix
