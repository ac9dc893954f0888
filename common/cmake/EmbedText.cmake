# cmake -DOUT=HEADER -DFOLDER=DIR -DFILES=A|B -P EmbedText.cmake: text files as constants in a
# header, kText_A_EXT for A.EXT.
string(REPLACE "|" ";" _files "${FILES}")
set(_text "#pragma once\n// Made by EmbedText.cmake.\nnamespace panofix {\n")
foreach(_file ${_files})
  file(READ "${FOLDER}/${_file}" _content)
  string(REGEX REPLACE "[^A-Za-z0-9]" "_" _name "${_file}")
  string(APPEND _text "inline constexpr char kText_${_name}[] = R\"panofix_text(${_content})panofix_text\";\n")
endforeach()
string(APPEND _text "}  // namespace panofix\n")
file(WRITE "${OUT}" "${_text}")
