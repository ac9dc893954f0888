#include "runtime/app/verify.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "common/sign/utc_time.h"
#include "runtime/store/acceptance.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Options {
  fs::path bundle, store;
  std::vector<fs::path> keys;
  bool json = false;
};

std::uint64_t NumBytes(const Manifest& manifest) {
  std::uint64_t bytes = 0;
  for (const BundlePart& part : manifest.parts) bytes += part.num_bytes;
  return bytes;
}

void PrintJson(const SignedManifest& bundle) {
  const ReleaseStatement& s = bundle.release->statement;
  const Json j = {{"id", bundle.id},
                  {"key", bundle.release->key_id},
                  {"created", FormatUtc(s.created_s)},
                  {"expires", FormatUtc(s.expires_s)},
                  {"revoked_keys", s.revoked_keys},
                  {"quality", s.quality},
                  {"manifest", Json::parse(bundle.text)}};
  std::printf("%s\n", j.dump(1).c_str());
}

void PrintText(const SignedManifest& bundle) {
  const Manifest& m = bundle.manifest;
  const BundleRelease& r = *bundle.release;
  const std::string before = m.runtime_before.empty() ? "" : ", before " + m.runtime_before;
  std::printf(
      "bundle      %s\nmap         %s, build %lld\nformat      %d.%d, panofix %s and later%s\n",
      bundle.id.c_str(), m.name.c_str(), static_cast<long long>(m.build), m.major, m.minor,
      m.runtime_min.c_str(), before.c_str());
  std::printf("signed by   key %s\ncreated     %s\nexpires     %s\n", r.key_id.c_str(),
              FormatUtc(r.statement.created_s).c_str(), FormatUtc(r.statement.expires_s).c_str());
  std::printf("vocabulary  %s\nsource      %s (%s), by %s\n", m.vocabulary_release.c_str(),
              m.provenance.source.c_str(), m.provenance.licence.c_str(), m.generator.c_str());
  for (const auto& [name, value] : r.statement.quality)
    std::printf("quality     %s %g\n", name.c_str(), value);
  std::printf("parts       %zu, %.1f MB, all right\n", m.parts.size(),
              static_cast<double>(NumBytes(m)) / 1e6);
}

Status Verify(const Options& o) {
  KeyRing ring;
  StoreState state;
  if (!o.store.empty()) {
    const auto keys = ReadStoreKeys({o.store});
    if (!keys.ok()) return keys.status();
    const auto read = ReadStoreState({o.store});
    if (!read.ok()) return read.status();
    ring = keys->ring, state = *read;
  }
  auto given = ReadKeyRing(o.keys);
  if (!given.ok()) return given.status();
  ring.trusted.insert(ring.trusted.end(), given->trusted.begin(), given->trusted.end());
  if (ring.empty()) {
    return {ErrorCode::kInvalidArgument,
            "verify: no key to verify with; give --trusted-key or --store"};
  }
  const auto bundle = VerifyBundle(o.bundle, ring);
  if (!bundle.ok()) return bundle.status();
  Status status = CheckExpiry(*bundle->manifest.release, state);
  if (status.ok() && !o.store.empty()) {
    const auto config = ReadStoreConfig({o.store});
    if (!config.ok()) return config.status();
    status = CheckMeantForUs(bundle->manifest.manifest, *config);
  }
  if (!status.ok()) return {status.code(), o.bundle.string() + ": " + status.message()};
  o.json ? PrintJson(bundle->manifest) : PrintText(bundle->manifest);
  return {};
}

}  // namespace

StoreCommand AddVerifyCommand(CLI::App* app) {
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "verify", "Check a bundle's signature, expiry, sizes and hashes, and say what it is");
  command->add_option("bundle", o->bundle, "the bundle's folder")->required();
  command->add_option("--trusted-key", o->keys, "public key that counts; may be repeated");
  command->add_option("--store", o->store, "use this store's keys, map name and camera");
  command->add_flag("--json", o->json, "as JSON, with the whole manifest");
  return {command, [=] { return Verify(*o); }};
}

}  // namespace panofix
