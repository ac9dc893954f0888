#include "runtime/store/activate.h"

#include <algorithm>

#include "common/base/log.h"
#include "runtime/store/acceptance.h"

namespace panofix {
namespace {

std::string Named(const std::string& id) { return "version " + id.substr(0, 12); }

// Revokes what a release in force says, but never the key that it rests on.
Status ApplyRevocations(const StoreLayout& layout, const BundleRelease& release) {
  auto keys = ReadStoreKeys(layout);
  if (!keys.ok()) return keys.status();
  bool changed = false;
  for (const std::string& id : release.statement.revoked_keys) {
    if (id == release.key_id || keys->ring.IsRevoked(id)) continue;
    keys->ring.revoked.push_back(id);
    changed = true;
    LogWarning("key " + id + " is revoked by " + release.key_id);
  }
  return changed ? WriteStoreKeys(layout, *keys) : Status();
}

// Probes the version in force; on failure goes back to the one before.
Status ProveActive(const StoreLayout& layout, StoreState state, const HealthProbe& probe) {
  const Status health = probe(layout.version(state.active));
  // Stopping is no verdict: the next start asks again.
  if (health.code() == ErrorCode::kCancelled) return health;
  if (health.ok()) {
    state.is_proven = true;
    state.before_previous.clear();
    const Status written = WriteStoreState(layout, state);
    if (!written.ok()) return written;
    const auto bundle = ReadVersion(layout, state.active);
    if (!bundle.ok()) return bundle.status();
    return ApplyRevocations(layout, *bundle->release);
  }
  const std::string failed = state.active;
  state.active = state.previous;
  state.previous = state.before_previous;
  state.before_previous.clear();
  state.is_proven = !state.active.empty();  // it ran before
  const Status written = WriteStoreState(layout, state);
  if (!written.ok()) return written;
  return {ErrorCode::kUnhealthy,
          Named(failed) + ": does not run here (" + health.message() + "); " +
              (state.active.empty() ? "no version is in force: install another"
                                    : Named(state.active) + " is back in force")};
}

Status SwitchTo(const StoreLayout& layout, StoreState state, const std::string& id,
                const HealthProbe& probe) {
  // An unproven version is nothing to go back to.
  if (state.is_proven && state.active != id) {
    state.before_previous = state.previous;
    state.previous = state.active;
  } else if (state.previous == id) {
    state.previous = state.before_previous;
    state.before_previous.clear();
  }
  state.active = id;
  state.is_proven = false;
  const Status written = WriteStoreState(layout, state);
  return written.ok() ? ProveActive(layout, state, probe) : written;
}

}  // namespace

Status Activate(const StoreLayout& layout, const std::string& wanted, const HealthProbe& probe) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  const auto config = ReadStoreConfig(layout);
  if (!config.ok()) return config.status();
  const auto state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  std::string id = wanted;
  if (id.empty()) {
    const auto versions = ListVersions(layout);
    if (!versions.ok()) return versions.status();
    if (versions->empty()) {
      return {ErrorCode::kNotFound,
              layout.root.string() + ": holds no map; install one with panofix-runtime install"};
    }
    id = versions->back().id;
  } else {
    const auto found = FindVersion(layout, wanted);
    if (!found.ok()) return found.status();
    id = *found;
  }
  const auto bundle = ReadVersion(layout, id);
  if (!bundle.ok()) return bundle.status();
  if (state->active == id && state->is_proven) return {};
  Status status = CheckMeantForUs(bundle->manifest, *config);
  if (status.ok()) status = CheckExpiry(*bundle->release, *state);
  if (!status.ok()) return {status.code(), Named(id) + ": " + status.message()};
  if (!state->active.empty() && state->active != id) {
    const auto active = ReadVersion(layout, state->active);
    if (active.ok() && bundle->manifest.build < active->manifest.build) {
      return {ErrorCode::kDowngrade,
              Format("%s: is build %lld, build %lld is in force; go back with panofix-runtime "
                     "rollback",
                     Named(id).c_str(), static_cast<long long>(bundle->manifest.build),
                     static_cast<long long>(active->manifest.build))};
    }
  }
  return SwitchTo(layout, *state, id, probe);
}

Status Rollback(const StoreLayout& layout, const HealthProbe& probe) {
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  const auto state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  if (state->previous.empty()) {
    return {ErrorCode::kNotFound,
            layout.root.string() + ": no version was in force before this one; install another"};
  }
  const auto bundle = ReadVersion(layout, state->previous);
  if (!bundle.ok()) return bundle.status();
  return SwitchTo(layout, *state, state->previous, probe);
}

Status SettleActivation(const StoreLayout& layout, const HealthProbe& probe) {
  auto state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  if (state->active.empty() || state->is_proven) return {};
  const auto lock = StoreLock::Take(layout);
  if (!lock.ok()) return lock.status();
  state = ReadStoreState(layout);
  if (!state.ok()) return state.status();
  if (state->active.empty() || state->is_proven) return {};
  return ProveActive(layout, *state, probe);
}

}  // namespace panofix
