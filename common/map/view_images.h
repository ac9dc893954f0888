#pragma once
// Pictures of the panoramas' own views, where a bundle keeps them (parts images/QUADKEY.h5).

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/base/status.h"
#include "common/camera/camera.h"
#include "common/image/gray_image.h"
#include "common/io/hdf5_file.h"

namespace panofix {

// Encoded images as the parts hold them; mapped, decoded on demand. Immutable once loaded,
// thread-safe.
class ViewImages {
 public:
  // One part more. `panorama_idx` names a panorama's index by its id. kBadData where arrays
  // disagree, an index points outside its array or a panorama comes twice.
  [[nodiscard]] Status Load(const Hdf5Reader& file,
                            const std::unordered_map<std::string, std::uint32_t>& panorama_idx,
                            std::size_t views_per_panorama);
  [[nodiscard]] std::size_t num_panoramas() const { return place_of_.size(); }
  // View `view` of a panorama as it was described (equalised), of the camera's size. kNotFound
  // where it is not kept, kBadData where it is no JPEG of that size. Costs a decode.
  [[nodiscard]] Result<GrayImage> Decode(std::uint32_t panorama_idx, std::size_t view,
                                         const Camera& camera) const;

 private:
  struct Part {
    MappedArray<std::uint32_t> offsets;
    MappedArray<std::uint8_t> bytes;
  };
  struct Place {
    std::size_t part = 0, first_row = 0;
  };
  std::vector<Part> parts_;
  std::unordered_map<std::uint32_t, Place> place_of_;  // of each panorama
};

}  // namespace panofix
