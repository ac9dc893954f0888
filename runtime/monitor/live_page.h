#pragma once
// The live page's own files, and the folder of the map library beside them.

#include <filesystem>
#include <optional>
#include <string_view>

namespace panofix {

struct PageFile {
  std::string_view text;
  const char* content_type = "";
};
// "index.html", "live.css" or "live.js"; nullopt for any other name.
[[nodiscard]] std::optional<PageFile> FindPageFile(std::string_view name);

// Where Debian's libjs-leaflet puts its files. The page does without where it is not installed.
[[nodiscard]] std::filesystem::path LeafletFolder();

}  // namespace panofix
