// delta and pack: signed bundles as one file to carry; migrate: bundles of an older format.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "builder/app/commands.h"
#include "builder/publish/migrate.h"
#include "builder/ship/package.h"
#include "common/io/atomic_file.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

struct Options {
  fs::path base, target, out;
  std::vector<fs::path> keys;
};

void AddOptions(CLI::App* command, Options* o) {
  command->add_option("--out", o->out, "package to write, .pfb: a tar that tar -tf lists")
      ->required();
  command->add_option("--endorsed", o->keys,
                      "public key to hand on, its .minisig (panofix-builder endorse) beside it; "
                      "may be repeated");
}

int Run(const Options& o) {
  ThrowIfError(CheckFileCanBeWritten(o.out, "--out"));
  const PackageReport report = WritePackage(o.base, o.target, o.keys, o.out);
  std::printf(
      "%s: %.2f MB, %.2f %% of the bundle's %.2f MB; of %zu parts %zu whole, %zu as patches\n",
      o.out.c_str(), static_cast<double>(report.num_package_bytes) / 1e6,
      100 * static_cast<double>(report.num_package_bytes) /
          static_cast<double>(std::max<std::uint64_t>(report.num_bundle_bytes, 1)),
      static_cast<double>(report.num_bundle_bytes) / 1e6, report.num_parts, report.num_objects,
      report.num_patches);
  return 0;
}

}  // namespace

Command AddDeltaCommand(CLI::App* app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "delta", "Pack what changed between two bundles, for vehicles that have the old one");
  command->add_option("old", o->base, "bundle that the vehicles have")->required();
  command->add_option("new", o->target, "signed bundle that they shall have")->required();
  AddOptions(command, o.get());
  return [=] { return Run(*o); };
}

Command AddPackCommand(CLI::App* app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand("pack", "Pack a whole signed bundle into one file");
  command->add_option("bundle", o->target, "the signed bundle's folder")->required();
  AddOptions(command, o.get());
  return [=] { return Run(*o); };
}

Command AddMigrateCommand(CLI::App* app) {
  struct MigrateOptions {
    fs::path from, out;
    std::optional<std::int64_t> build;
  };
  auto o = std::make_shared<MigrateOptions>();
  CLI::App* command = app->add_subcommand(
      "migrate", "Write a bundle of an older format in this one, where that needs no panoramas");
  command->add_option("old", o->from, "the old bundle's folder")->required();
  command->add_option("--out", o->out, "folder to write, a new one")->required();
  command->add_option("--build", o->build,
                      "build number (default: the old one's); above it where vehicles have the "
                      "old bundle, as they take each number once");
  return [=] {
    if (!o->out.has_filename()) o->out = o->out.parent_path();
    const Manifest m = MigrateBundle(o->from, o->out, o->build);
    std::printf(
        "bundle %s has format %d.%d and is not signed; sign it with: panofix-builder sign %s\n",
        o->out.c_str(), m.major, m.minor, o->out.c_str());
    return 0;
  };
}

}  // namespace panofix
