// keygen, endorse and sign: what makes a bundle one that vehicles accept.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "builder/app/commands.h"
#include "builder/ship/release.h"
#include "common/base/log.h"
#include "common/io/read_file.h"
#include "common/sign/utc_time.h"

namespace panofix {
namespace {

namespace fs = std::filesystem;

void AddPasswordOption(CLI::App* command, fs::path* file) {
  command->add_option("--password-file", *file,
                      "file whose first line is the secret key's password (default: "
                      "PANOFIX_KEY_PASSWORD of the environment, else none)");
}

std::string Password(const fs::path& file) {
  if (file.empty()) {
    const char* value = std::getenv("PANOFIX_KEY_PASSWORD");
    return value == nullptr ? "" : value;
  }
  constexpr std::size_t kMaxBytes = 4096;
  const std::string text = ValueOrThrow(ReadFileText(file, kMaxBytes));
  return text.substr(0, text.find_first_of("\r\n"));
}

}  // namespace

Command AddKeygenCommand(CLI::App* app) {
  struct Options {
    fs::path secret, public_key, password;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "keygen", "Make a pair of signing keys, as minisign -G does; keep the secret one off line");
  command->add_option("--key", o->secret, "secret key to write, e.g. map.key")->required();
  command->add_option("--public", o->public_key, "public key to write, e.g. map.pub")->required();
  AddPasswordOption(command, &o->password);
  return [=] {
    const std::string password = Password(o->password);
    const PublicKey key = WriteKeyPair(o->secret, o->public_key, password);
    std::printf("key %s: %s signs, %s is for vehicles%s\n", KeyIdText(key.id).c_str(),
                o->secret.c_str(), o->public_key.c_str(),
                password.empty() ? "; the secret key is not encrypted" : "");
    return 0;
  };
}

Command AddEndorseCommand(CLI::App* app) {
  struct Options {
    fs::path public_key, secret, password;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = app->add_subcommand(
      "endorse", "Let vehicles that trust the old key trust a new one: writes PUBLIC.minisig");
  command->add_option("public", o->public_key, "the new public key")->required();
  command->add_option("--key", o->secret, "the old secret key")->required();
  AddPasswordOption(command, &o->password);
  return [=] {
    EndorseKey(o->public_key, SecretKey::Read(o->secret, Password(o->password)));
    std::printf("%s%s is ready; hand both to panofix-runtime trust, or to delta --endorsed\n",
                o->public_key.c_str(), kSignatureSuffix);
    return 0;
  };
}

Command AddSignCommand(CLI::App* app) {
  struct Options {
    fs::path bundle, secret, password;
    std::string created;
    bool allow_future = false;
    ReleaseOptions release;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      app->add_subcommand("sign", "Sign a bundle for vehicles; again to renew its expiry");
  command->add_option("bundle", o->bundle, "the bundle's folder")->required();
  command->add_option("--key", o->secret, "secret key, of minisign -G or keygen")->required();
  AddPasswordOption(command, &o->password);
  command
      ->add_option("--expires-days", o->release.expires_days,
                   "vehicles refuse to install it after so many days")
      ->capture_default_str();
  command->add_option("--created", o->created,
                      "time of the release, such as 2026-11-22T09:30:00Z (default: now)");
  command->add_flag("--allow-future", o->allow_future,
                    "take a --created that is more than a day ahead of this clock");
  command->add_option("--scores", o->release.scores, "score table of validate --json to state");
  command->add_option("--revoke", o->release.revoked_keys,
                      "id of a key that vehicles shall no longer trust; may be repeated");
  return [=] {
    constexpr std::int64_t kDay_s = 86400;
    o->release.created_s = NowUtc_s();
    if (!o->allow_future) o->release.latest_created_s = o->release.created_s + kDay_s;
    if (!o->created.empty()) {
      const auto created_s = ParseUtc(o->created);
      if (!created_s) {
        throw Error(ErrorCode::kInvalidArgument,
                    "--created " + o->created + ": no time such as 2026-11-22T09:30:00Z");
      }
      o->release.created_s = *created_s;
    }
    const SecretKey key = SecretKey::Read(o->secret, Password(o->password));
    const ReleaseStatement s = SignBundle(o->bundle, key, o->release);
    std::printf("build %lld of '%s' signed with key %s, expires %s\n",
                static_cast<long long>(s.build), s.name.c_str(),
                KeyIdText(key.public_key().id).c_str(), FormatUtc(s.expires_s).c_str());
    return 0;
  };
}

}  // namespace panofix
