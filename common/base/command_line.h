#pragma once
// What both programs' command lines share.

#include <string>

namespace panofix {

// "unknown command 'WORD'" for the first word of a command line that names none, where the parser
// only says that none is there; "" where there is no such word. --log-level takes the next word.
[[nodiscard]] std::string UnknownCommand(int argc, const char* const* argv);

}  // namespace panofix
