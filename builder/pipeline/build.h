#pragma once
// The whole build in one process: the plan, every unit of every stage, and publishing.

#include <memory>

#include "builder/pipeline/build_options.h"
#include "builder/pipeline/run_report.h"

namespace panofix {

// Bounds the threads that the process works with while it lives; 0 = all processors.
class ThreadLimit {
 public:
  explicit ThreadLimit(int num_threads);
  ~ThreadLimit();
  ThreadLimit(const ThreadLimit&) = delete;
  ThreadLimit& operator=(const ThreadLimit&) = delete;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Whether a bundle can be put at `out`: what is there is replaced, so it must be a bundle, or
// nothing that anybody could miss. Throws Error.
void CheckOut(const std::filesystem::path& out);

// Checks the options and plans: what `plan` does, and the first step of Build. `work` is OUT.work
// where it is empty. Throws Error or std::invalid_argument.
void PlanBuild(BuildOptions options);

// What the plan in a work folder asks for, in a few lines.
[[nodiscard]] std::string DescribePlan(const std::filesystem::path& work);

// Runs or resumes a build and publishes the bundle. Equal inputs and options give equal bytes for
// any thread count, shards and input order. Throws Error (kCancelled on Ctrl-C: what was done is
// kept).
RunReport Build(BuildOptions options);

}  // namespace panofix
