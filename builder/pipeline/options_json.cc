// The options that decide a bundle's bytes, as they stand in its provenance.
#include <nlohmann/json.hpp>

#include "builder/pipeline/build.h"

namespace panofix {

std::string OptionsJson(const BuildOptions& o) {
  const nlohmann::ordered_json j = {
      {"map_frame", o.map_frame},
      {"num_views", o.num_views},
      {"view_pitch_deg", o.view_pitch_deg},
      {"max_range_m", o.extract.max_range_m},
      {"max_incidence_deg", o.extract.max_incidence_deg},
      {"num_sift_words", o.num_sift_words},
      {"num_mser_words", o.num_mser_words},
      {"max_words", o.max_words},
      {"station_spacing_m", o.stations.spacing_m},
      {"station_lanes_m", o.stations.lanes_m},
      {"station_beyond_m", o.stations.beyond_m},
      {"station_max_link_m", o.stations.max_link_m},
      {"render_max_stretch", o.render.max_stretch},
      {"render_good_stretch", o.render.good_stretch},
      {"render_max_incidence_deg", o.render.max_incidence_deg},
      {"render_max_range_m", o.render.max_range_m},
      {"merge", o.landmarks.merge},
      {"refine", o.landmarks.refine},
      {"max_merge_distance", o.landmarks.max_merge_descriptor_distance},
      {"max_per_view", o.landmarks.max_per_view},
      {"max_shift_m", o.landmarks.max_shift_m},
      {"max_turn_deg", o.landmarks.max_turn_deg},
      {"pack_descriptors", o.pack_descriptors},
      {"keep_view_images", o.keep_view_images},
      {"num_similar", o.similarity.num_similar},
      {"dist_max", o.similarity.dist_max},
      {"dist_max_m", o.similarity.dist_max_m},
      {"seed", o.seed}};
  return j.dump();
}

}  // namespace panofix
