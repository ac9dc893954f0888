#pragma once
// Ctrl-C and SIGTERM as a flag that long work asks between units, so that nothing is left half
// done.

namespace panofix {

// Installs handlers for SIGINT and SIGTERM; a second signal ends the process at once (exit 130).
void InstallCancelHandlers();
[[nodiscard]] bool CancelRequested();
// What the handlers call; tests call it too.
void RequestCancel();
void ClearCancel();

}  // namespace panofix
