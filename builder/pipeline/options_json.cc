// The options that decide a bundle's bytes, as they stand in its provenance.
#include <nlohmann/json.hpp>

#include "builder/pipeline/build.h"

namespace panofix {

std::string OptionsJson(const BuildOptions& o) {
  const nlohmann::ordered_json j = {{"map_frame", o.map_frame},
                                    {"num_views", o.num_views},
                                    {"view_pitch_deg", o.view_pitch_deg},
                                    {"max_range_m", o.extract.max_range_m},
                                    {"max_incidence_deg", o.extract.max_incidence_deg},
                                    {"num_sift_words", o.num_sift_words},
                                    {"num_mser_words", o.num_mser_words},
                                    {"max_features", o.max_features},
                                    {"num_similar", o.similarity.num_similar},
                                    {"dist_max", o.similarity.dist_max},
                                    {"dist_max_m", o.similarity.dist_max_m},
                                    {"seed", o.seed}};
  return j.dump();
}

}  // namespace panofix
