# cmake -DOUT=HEADER -DFOLDER=DIR -DFILES=A|B -P EmbedBytes.cmake: binary files as constants in a
# header, kBytes_A_EXT for A.EXT.
string(REPLACE "|" ";" _files "${FILES}")
set(_text "#pragma once\n// Made by EmbedBytes.cmake.\nnamespace panofix {\n")
foreach(_file ${_files})
  file(READ "${FOLDER}/${_file}" _content HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," _content "${_content}")
  string(REGEX REPLACE "[^A-Za-z0-9]" "_" _name "${_file}")
  string(APPEND _text "inline constexpr unsigned char kBytes_${_name}[] = {${_content}};\n")
endforeach()
string(APPEND _text "}  // namespace panofix\n")
file(WRITE "${OUT}" "${_text}")
