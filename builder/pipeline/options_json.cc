// Options as JSON: in a bundle's provenance, and in a plan.
#include <nlohmann/json.hpp>

#include "builder/pipeline/build_options.h"

namespace panofix {
namespace {

using Json = nlohmann::ordered_json;

// Visits the options that decide a bundle's bytes and do not stand elsewhere in its manifest.
template <typename Options, typename Visit>
void VisitProvenance(Options& o, const Visit& visit) {
  visit("map_frame", o.map_frame);
  visit("num_views", o.num_views);
  visit("view_pitch_deg", o.view_pitch_deg);
  visit("max_range_m", o.extract.max_range_m);
  visit("max_incidence_deg", o.extract.max_incidence_deg);
  visit("num_sift_words", o.num_sift_words);
  visit("num_mser_words", o.num_mser_words);
  visit("max_words", o.max_words);
  visit("station_spacing_m", o.stations.spacing_m);
  visit("station_lanes_m", o.stations.lanes_m);
  visit("station_beyond_m", o.stations.beyond_m);
  visit("station_max_link_m", o.stations.max_link_m);
  visit("render_max_stretch", o.render.max_stretch);
  visit("render_good_stretch", o.render.good_stretch);
  visit("render_max_incidence_deg", o.render.max_incidence_deg);
  visit("render_max_range_m", o.render.max_range_m);
  visit("merge", o.landmarks.merge);
  visit("refine", o.landmarks.refine);
  visit("max_merge_distance", o.landmarks.max_merge_descriptor_distance);
  visit("max_per_view", o.landmarks.max_per_view);
  visit("max_shift_m", o.landmarks.max_shift_m);
  visit("max_turn_deg", o.landmarks.max_turn_deg);
  visit("pack_descriptors", o.pack_descriptors);
  visit("keep_view_images", o.keep_view_images);
  visit("num_similar", o.similarity.num_similar);
  visit("dist_max", o.similarity.dist_max);
  visit("dist_max_m", o.similarity.dist_max_m);
  visit("seed", o.seed);
}

// The others: those in the manifest itself, and those that change no byte.
template <typename Options, typename Visit>
void VisitOthers(Options& o, const Visit& visit) {
  visit("name", o.name);
  visit("build", o.build);
  visit("clahe_clip_limit", o.extract.features.clahe_clip_limit);
  visit("clahe_tiles", o.extract.features.clahe_tiles);
  visit("max_sift", o.extract.features.max_sift);
  visit("sift_contrast_threshold", o.extract.features.sift_contrast_threshold);
  visit("max_mser", o.extract.features.max_mser);
  visit("root_sift", o.extract.features.root_sift);
  visit("range_sigma_share", o.extract.errors.range_sigma_share);
  visit("normal_sigma_deg", o.extract.errors.normal_sigma_deg);
  visit("relief_sigma_m", o.extract.errors.relief_sigma_m);
  visit("panorama_position_sigma_m", o.extract.errors.panorama_position_sigma_m);
  visit("panorama_heading_sigma_deg", o.extract.errors.panorama_heading_sigma_deg);
  visit("max_set_aside_share", o.max_set_aside_share);
  visit("shard_level", o.shard_level);
}

}  // namespace

std::string OptionsJson(const BuildOptions& options) {
  Json j;
  VisitProvenance(options, [&](const char* name, const auto& value) { j[name] = value; });
  return j.dump();
}

std::string FormatOptions(const BuildOptions& options) {
  Json j;
  const auto write = [&](const char* name, const auto& value) { j[name] = value; };
  VisitProvenance(options, write);
  VisitOthers(options, write);
  j["equalization"] = EqualizationName(options.extract.features.equalization);
  return j.dump();
}

BuildOptions ParseOptions(const std::string& json) {
  BuildOptions options;
  std::size_t num_read = 1;
  try {
    const Json j = Json::parse(json);
    const auto read = [&](const char* name, auto& value) {
      j.at(name).get_to(value);
      ++num_read;
    };
    VisitProvenance(options, read);
    VisitOthers(options, read);
    options.extract.features.equalization =
        ValueOrThrow(ParseEqualization(j.at("equalization").get<std::string>()));
    if (j.size() != num_read)
      throw Error(ErrorCode::kBadData, "options that this program does not know");
  } catch (const Json::exception& error) {
    throw Error(ErrorCode::kBadData, std::string("options: ") + error.what());
  }
  return options;
}

}  // namespace panofix
