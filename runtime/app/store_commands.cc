#include "runtime/app/store_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/sign/utc_time.h"
#include "runtime/app/health_probe.h"
#include "runtime/app/verify.h"
#include "runtime/store/download.h"
#include "runtime/store/install.h"
#include "runtime/store/upkeep.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxKeyBytes = 4096;
constexpr double kDefaultProbe_s = 300;

std::string NameOf(const StoreLayout& layout, const std::string& id) {
  const auto version = ReadVersion(layout, id);
  if (!version.ok()) return Format("version %.12s", id.c_str());
  return Format("build %lld (%.12s)", static_cast<long long>(version->manifest.build), id.c_str());
}

// One line: what a change of the store has led to.
Status ThenSayInForce(const StoreLayout& layout, const Status& done) {
  if (!done.ok()) return done;
  const auto state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  const std::string active = state->active.empty() ? "nothing; see panofix-runtime activate"
                                                   : NameOf(layout, state->active);
  const std::string back =
      state->previous.empty() ? "" : "; rollback leads to " + NameOf(layout, state->previous);
  std::printf("in force: %s%s\n", active.c_str(), back.c_str());
  return {};
}

Status ThenSay(const Status& done, const std::string& line) {
  if (done.ok()) std::printf("%s\n", line.c_str());
  return done;
}

void AddStore(CLI::App* command, fs::path* store) {
  command->add_option("--store", *store, "the vehicle's store")->required();
}

void AddProbeTimeout(CLI::App* command, double* timeout_s) {
  command
      ->add_option("--probe-timeout-s", *timeout_s,
                   "a version that does not answer within this is taken back")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
}

StoreCommand AddInit(CLI::App* app) {
  struct Options {
    fs::path store, camera;
    std::string map;
    std::vector<fs::path> keys;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand("init", "Make a store for maps on this vehicle");
  AddStore(command, &o->store);
  command->add_option("--map", o->map, "name of the map that it takes (build --name)")->required();
  command->add_option("--camera", o->camera, "camera.yaml of the vehicle's camera")->required();
  command->add_option("--key", o->keys, "public key that maps must be signed with; may be repeated")
      ->required();
  return {command, [=]() -> Status {
            const auto ring = ReadKeyRing(o->keys);
            if (!ring.ok()) return ring.status();
            const auto camera = ReadCameraYaml(o->camera);
            if (!camera.ok()) return camera.status();
            return ThenSay(InitStore({o->store}, {o->map, *camera}, *ring),
                           o->store.string() + " takes maps of '" + o->map +
                               "'; next: panofix-runtime install");
          }};
}

StoreCommand AddTrust(CLI::App* app) {
  struct Options {
    fs::path store, key;
    bool by_hand = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "trust", "Take in a new public key that an old one endorses (KEY.minisig beside it)");
  AddStore(command, &o->store);
  command->add_option("key", o->key, "the new public key")->required();
  command->add_flag("--by-hand", o->by_hand, "without an endorsement: you vouch for it");
  return {command, [=]() -> Status {
            const auto key = ReadFileText(o->key, kMaxKeyBytes);
            if (!key.ok()) return key.status();
            const std::string done = o->key.string() + " is trusted here";
            if (o->by_hand) return ThenSay(TrustKey({o->store}, *key, "", o->key.string()), done);
            const auto signature =
                ReadFileText(o->key.string() + kSignatureSuffix, kMaxSignatureBytes);
            if (signature.status().code() == ErrorCode::kNotFound) {
              return {ErrorCode::kUntrusted,
                      o->key.string() +
                          ": no endorsement beside it; make one with panofix-builder "
                          "endorse, or vouch for the key with --by-hand"};
            }
            if (!signature.ok()) return signature.status();
            return ThenSay(TrustKey({o->store}, *key, *signature, o->key.string()), done);
          }};
}

StoreCommand AddRevoke(CLI::App* app) {
  struct Options {
    fs::path store;
    std::string id;
    bool force = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app->add_subcommand("revoke", "Refuse all that a key has signed, from now on");
  AddStore(command, &o->store);
  command->add_option("id", o->id, "the key's id, 16 hex digits")->required();
  command->add_flag("--force", o->force, "even the key that signed the version in force");
  return {command, [=] {
            return ThenSay(RevokeKey({o->store}, o->id, o->force),
                           "key " + o->id + " is revoked: what it signed is refused");
          }};
}

StoreCommand AddInstall(CLI::App* app) {
  struct Options {
    fs::path store;
    std::string from;
    bool activate = false;
    double probe_s = kDefaultProbe_s;
    InstallOptions install;
    DownloadOptions download;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "install", "Put a signed bundle beside the others: a folder, a .pfb package, or its URL");
  AddStore(command, &o->store);
  command->add_option("from", o->from, "folder, .pfb file, http://…, https://… or file://…")
      ->required();
  command->add_flag("--activate", o->activate, "and run it from the next start on");
  AddProbeTimeout(command, &o->probe_s);
  command->add_option("--max-bytes", o->install.max_bytes, "refuse larger bundles and downloads")
      ->capture_default_str();
  command
      ->add_option("--timeout-s", o->download.timeout_s,
                   "give a download up after this; run again to go on with it")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  return {command, [=]() -> Status {
            const StoreLayout layout{o->store};
            o->download.max_bytes = o->install.max_bytes;
            const auto report = InstallFrom(layout, o->from, o->install, o->download);
            if (!report.ok()) return report.status();
            std::printf("build %lld is installed: %zu of %zu parts were new, %.1f of %.1f MB\n%s\n",
                        static_cast<long long>(report->build), report->num_new_parts,
                        report->num_parts, static_cast<double>(report->num_new_bytes) / 1e6,
                        static_cast<double>(report->num_bytes) / 1e6, report->id.c_str());
            return ThenSayInForce(
                layout, o->activate
                            ? Activate(layout, report->id, MakeHealthProbe(layout, o->probe_s))
                            : Status());
          }};
}

StoreCommand AddActivate(CLI::App* app) {
  struct Options {
    fs::path store;
    std::string id;
    double probe_s = kDefaultProbe_s;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "activate", "Run an installed version; the one before is back if it does not start");
  AddStore(command, &o->store);
  command->add_option("id", o->id,
                      "the version's id, or its first digits, 6 at least (default: the newest)");
  AddProbeTimeout(command, &o->probe_s);
  return {command, [=] {
            return ThenSayInForce(
                {o->store}, Activate({o->store}, o->id, MakeHealthProbe({o->store}, o->probe_s)));
          }};
}

StoreCommand AddRollback(CLI::App* app) {
  struct Options {
    fs::path store;
    double probe_s = kDefaultProbe_s;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app->add_subcommand("rollback", "Run the version that was active before this one");
  AddStore(command, &o->store);
  AddProbeTimeout(command, &o->probe_s);
  return {command, [=] {
            return ThenSayInForce({o->store},
                                  Rollback({o->store}, MakeHealthProbe({o->store}, o->probe_s)));
          }};
}

Status PrintList(const StoreLayout& layout) {
  const auto versions = ListVersions(layout);
  if (!versions.ok()) return versions.status();
  const auto state = ReadStoreState(layout);
  const auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  for (const StoreVersion& v : *versions) {
    std::string line = v.id;
    if (v.is_known)
      line += Format("  build %lld", static_cast<long long>(v.manifest.manifest.build));
    if (const auto& release = v.manifest.release) {
      const std::int64_t expires_s = release->statement.expires_s;
      line += "  key " + release->key_id + "  expires " + FormatUtc(expires_s) +
              (expires_s <= NowUtc_s() ? " (EXPIRED)" : "");
    }
    if (state.ok() && v.id == state->active)
      line += state->is_proven ? "  active" : "  active, not proven";
    if (state.ok() && v.id == state->previous) line += "  previous";
    if (!v.status.ok()) line += "  unusable: " + v.status.message();
    std::printf("%s\n", line.c_str());
  }
  for (std::size_t i = 0; i < keys->ring.trusted.size(); ++i) {
    const std::string id = KeyIdText(keys->ring.trusted[i].id);
    const std::string& by = keys->endorsed_by[i];
    if (keys->ring.IsRevoked(id)) continue;  // below
    std::printf("key %s  %s%s\n", id.c_str(), by.empty() ? "put in by hand" : "endorsed by ",
                by.c_str());
  }
  for (const std::string& id : keys->ring.revoked) std::printf("key %s  revoked\n", id.c_str());
  return state.status();
}

StoreCommand AddList(CLI::App* app) {
  auto store = std::make_shared<fs::path>();
  CLI::App* command = app->add_subcommand("list", "Say what versions and keys a store holds");
  AddStore(command, store.get());
  return {command, [=] { return PrintList({*store}); }};
}

StoreCommand AddGc(CLI::App* app) {
  auto store = std::make_shared<fs::path>();
  CLI::App* command = app->add_subcommand(
      "gc", "Remove versions but the active, the previous and the newest, and what none uses");
  AddStore(command, store.get());
  return {command, [=]() -> Status {
            const auto report = CollectGarbage({*store});
            if (!report.ok()) return report.status();
            for (const std::string& id : report->removed_versions)
              std::printf("%s  removed\n", id.c_str());
            std::printf("%zu objects removed, %.1f MB\n", report->num_removed_objects,
                        static_cast<double>(report->num_freed_bytes) / 1e6);
            return {};
          }};
}

StoreCommand AddFsck(CLI::App* app) {
  struct Options {
    fs::path store;
    bool repair = false;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand("fsck", "Read all of a store and say what is damaged");
  AddStore(command, &o->store);
  command->add_flag("--repair", o->repair, "mend it from what is good");
  return {command, [=]() -> Status {
            const auto report = CheckStore({o->store}, o->repair);
            if (!report.ok()) return report.status();
            for (const std::string& line : report->faults) std::printf("fault: %s\n", line.c_str());
            for (const std::string& line : report->repairs)
              std::printf("mended: %s\n", line.c_str());
            std::printf("%zu versions, %zu objects, %zu faults\n", report->num_versions,
                        report->num_objects, report->faults.size());
            if (o->repair) return report->in_force;
            if (report->faults.empty()) return {};
            return {ErrorCode::kChecksumMismatch, Format("%s: %zu faults; mend them with --repair",
                                                         o->store.c_str(), report->faults.size())};
          }};
}

}  // namespace

std::vector<StoreCommand> AddStoreCommands(CLI::App* app) {
  return {AddVerifyCommand(app), AddInit(app), AddInstall(app), AddActivate(app), AddRollback(app),
          AddList(app),          AddGc(app),   AddFsck(app),    AddTrust(app),    AddRevoke(app)};
}

}  // namespace panofix
