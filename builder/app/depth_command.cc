#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "builder/app/commands.h"
#include "builder/ingest/depth_report.h"

namespace panofix {

Command AddDepthCommand(CLI::App* app) {
  struct Options {
    std::filesystem::path file;
    std::vector<std::string> pixels;
    double scale_m = 0.001;
    bool json = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app->add_subcommand("depth", "Decode one depth file: planes, ground, range at given pixels");
  command->add_option("file", o->file, "depth file, .gsv or 16-bit .png")->required();
  command
      ->add_option("--pixel", o->pixels,
                   "COL,ROW of the depth map (512 x 256 in a .gsv); may be repeated")
      ->take_all()
      ->delimiter(' ');
  command->add_option("--depth-scale", o->scale_m, "metres a unit of a .png")
      ->capture_default_str();
  command->add_flag("--json", o->json, "as JSON");
  return [=] {
    const DepthMap depth = ValueOrThrow(DepthMap::Read(o->file, o->scale_m));
    std::vector<DepthPixel> pixels;
    for (const std::string& text : o->pixels)
      pixels.push_back(ValueOrThrow(ParseDepthPixel(text, depth)));
    const std::string report = o->json ? DepthReportJson(depth, o->file.string(), pixels)
                                       : DepthReportText(depth, o->file.string(), pixels);
    std::fputs(report.c_str(), stdout);
    return 0;
  };
}

}  // namespace panofix
