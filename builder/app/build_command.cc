#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <memory>

#include "builder/app/commands.h"
#include "builder/pipeline/build.h"
#include "common/base/log.h"

namespace panofix {
namespace {

// The published method's numbers, for ablation rows; an option that is given wins.
void ApplyPaperPreset(const CLI::App& command, BuildOptions* o) {
  const auto preset = [&](const char* option, auto value, auto* target) {
    if (command.count(option) == 0) *target = value;
  };
  preset("--views", 8, &o->num_views);
  preset("--sift-words", 5000, &o->num_sift_words);
  preset("--mser-words", 2000, &o->num_mser_words);
  preset("--dist-max", 48, &o->similarity.dist_max);
  o->extract.features.equalization = Equalization::kGlobal;
  preset("--root-sift", false, &o->extract.features.root_sift);
  preset("--max-sift", 2000, &o->extract.features.max_sift);
  preset("--max-words", 0, &o->max_words);
  preset("--station-spacing-m", 0.0, &o->stations.spacing_m);
  preset("--merge", false, &o->landmarks.merge);
  preset("--refine", false, &o->landmarks.refine);
  preset("--landmarks-per-view", 0, &o->landmarks.max_per_view);
  preset("--pack-descriptors", false, &o->pack_descriptors);
  preset("--keep-view-images", true, &o->keep_view_images);
}

// Options of `build` and `plan`; the function returned makes them whole once they are parsed.
std::function<BuildOptions()> AddBuildOptions(CLI::App* command) {
  auto o = std::make_shared<BuildOptions>();
  auto preset = std::make_shared<std::string>("default");
  auto equalization = std::make_shared<std::string>();
  command->add_option("--panoramas", o->panoramas, "panoramas.geojson or .geojsonl")->required();
  command->add_option("--camera", o->camera, "camera.yaml of the vehicle's camera")->required();
  command
      ->add_option("--out", o->out,
                   "folder of the bundle; one that is there is replaced in one step")
      ->required();
  command->add_option("--work", o->work,
                      "intermediate files, reused by the next build (default: OUT.work)");
  command->add_option("--name", o->name,
                      "name of the bundle, part of its identity (default: the out folder's name)");
  command->add_option("--build", o->build, "build number, which only grows")->capture_default_str();
  command->add_option("--preset", *preset, "default, or paper: the published method")
      ->capture_default_str();
  command
      ->add_option("--map-frame", o->map_frame,
                   "tangent (cone at the data's centroid) or a grid: EPSG:2154")
      ->capture_default_str();
  command->add_option("--views", o->num_views, "rectilinear views a panorama")
      ->capture_default_str();
  command->add_option("--view-pitch-deg", o->view_pitch_deg, "their pitch, up positive")
      ->capture_default_str();
  command->add_option("--equalization", *equalization, "none, global or clahe (default clahe)");
  command->add_option("--max-sift", o->extract.features.max_sift, "SIFT features looked at a view")
      ->capture_default_str();
  command
      ->add_option("--sift-contrast-threshold", o->extract.features.sift_contrast_threshold,
                   "lower finds more and weaker features")
      ->capture_default_str();
  command
      ->add_option("--station-spacing-m", o->stations.spacing_m,
                   "distance of the views rendered between panoramas; 0 = none")
      ->capture_default_str();
  command
      ->add_option("--station-lanes-m", o->stations.lanes_m,
                   "rows of them: metres to the right of the panoramas' track")
      ->capture_default_str()
      ->delimiter(',');
  command
      ->add_option("--landmarks-per-view", o->landmarks.max_per_view,
                   "landmarks kept for a view: the bundle's size; 0 = all")
      ->capture_default_str();
  command->add_flag("--merge,!--no-merge", o->landmarks.merge,
                    "one landmark where several views and panoramas saw one point (default on)");
  command->add_flag("--refine,!--no-refine", o->landmarks.refine,
                    "panorama poses and depth planes refined jointly (default on; needs --merge)");
  command->add_flag("--root-sift,!--plain-sift", o->extract.features.root_sift,
                    "the descriptors' kind (default RootSIFT)");
  command->add_flag("--pack-descriptors,!--no-pack-descriptors", o->pack_descriptors,
                    "four bits an entry of a descriptor instead of eight (default on)");
  command->add_flag("--keep-view-images,!--no-view-images", o->keep_view_images,
                    "keep the views' pictures, which the runtime's kVLD needs (default off)");
  command->add_option(
      "--vocabulary", o->vocabulary,
      "a vocabulary release to use, vocabulary.h5 or a bundle (default: train one)");
  command->add_option("--max-words", o->max_words, "heaviest words kept of a view; 0 = all")
      ->capture_default_str();
  command->add_option("--sift-words", o->num_sift_words, "visual words of SIFT features")
      ->capture_default_str();
  command->add_option("--mser-words", o->num_mser_words, "visual words of MSER regions")
      ->capture_default_str();
  command
      ->add_option("--similar", o->similarity.num_similar,
                   "r of the similarity index: similar views kept a view")
      ->capture_default_str();
  command
      ->add_option("--dist-max", o->similarity.dist_max,
                   "appearance radius in view index steps (paper: 48 or 64)")
      ->capture_default_str();
  command
      ->add_option("--range-sigma-share", o->extract.errors.range_sigma_share,
                   "depth error as a share of the range, 1 sigma")
      ->capture_default_str();
  command
      ->add_option("--geotag-sigma-m", o->extract.errors.panorama_position_sigma_m,
                   "error of the panoramas' positions, 1 sigma")
      ->capture_default_str();
  command
      ->add_option("--heading-sigma-deg", o->extract.errors.panorama_heading_sigma_deg,
                   "error of the panoramas' headings, 1 sigma")
      ->capture_default_str();
  command
      ->add_option("--max-set-aside-share", o->max_set_aside_share,
                   "more unusable panoramas than this fail the build")
      ->capture_default_str();
  command
      ->add_option("--shard-level", o->shard_level,
                   "quadkey level of the shards: 15 = some 800 m a side; changes no byte")
      ->capture_default_str();
  command->add_option("--threads", o->num_threads, "processors to use; 0 = all")
      ->capture_default_str();
  command->add_option("--seed", o->seed, "seed of the training; same inputs, same bytes")
      ->capture_default_str();
  return [=] {
    if (*preset == "paper") {
      ApplyPaperPreset(*command, o.get());
    } else if (*preset != "default") {
      throw Error(ErrorCode::kInvalidArgument,
                  "--preset " + *preset + ": unknown; use default or paper");
    }
    if (!equalization->empty())
      o->extract.features.equalization = ValueOrThrow(ParseEqualization(*equalization));
    // "map/" is "map": what lies beside the bundle (its work folder, its report) takes its name.
    if (!o->out.has_filename()) o->out = o->out.parent_path();
    return *o;
  };
}

}  // namespace

Command AddBuildCommand(CLI::App* app) {
  CLI::App* command = app->add_subcommand("build", "Build a map bundle from panoramas");
  const auto options_of = AddBuildOptions(command);
  return [=] {
    const BuildOptions options = options_of();
    const RunReport report = Build(options);
    std::fputs(report.ToTable().c_str(), stdout);
    std::printf("bundle %s is ready; see it with: panofix-builder inspect %s\n",
                options.out.c_str(), options.out.c_str());
    return 0;
  };
}

Command AddPlanCommand(CLI::App* app) {
  CLI::App* command = app->add_subcommand(
      "plan", "Plan a build whose stages run as programs of their own: the first stage");
  const auto options_of = AddBuildOptions(command);
  return [=] {
    BuildOptions options = options_of();
    if (options.work.empty()) options.work = options.out.string() + ".work";
    const ThreadLimit threads(options.num_threads);
    PlanBuild(options);
    std::fputs(DescribePlan(options.work).c_str(), stdout);
    return 0;
  };
}

}  // namespace panofix
