#include "runtime/monitor/live_page.h"

#include "runtime/monitor/page_files_generated.h"

namespace panofix {

std::optional<PageFile> FindPageFile(std::string_view name) {
  if (name == "index.html") return PageFile{kText_index_html, "text/html; charset=utf-8"};
  if (name == "live.css") return PageFile{kText_live_css, "text/css; charset=utf-8"};
  if (name == "live.js") return PageFile{kText_live_js, "text/javascript; charset=utf-8"};
  return std::nullopt;
}

std::filesystem::path LeafletFolder() { return "/usr/share/javascript/leaflet"; }

}  // namespace panofix
