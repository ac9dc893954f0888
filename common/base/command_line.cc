#include "common/base/command_line.h"

namespace panofix {

std::string UnknownCommand(int argc, const char* const* argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--log-level")
      ++i;
    else if (!word.starts_with("-"))
      return "unknown command '" + word + "'";
  }
  return {};
}

}  // namespace panofix
