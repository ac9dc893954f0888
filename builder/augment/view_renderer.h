#pragma once
// Views from where no panorama was taken, rendered from the depth planes of those around.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "builder/ingest/depth_map.h"
#include "builder/rectify/rectifier.h"
#include "common/camera/camera.h"
#include "common/geometry/rigid3.h"
#include "common/image/gray_image.h"

namespace panofix {

struct RenderOptions {
  // How much larger a piece of panorama may appear from the station than from the panorama, as an
  // angle, in its most stretched direction; beyond, the content is smeared.
  double max_stretch = 2.5;
  double good_stretch = 1.6;  // up to here the nearest panorama is taken, else a clearly finer one
  double max_incidence_deg =
      78;  // of the station's and of the panorama's sight to the surface normal
  double max_range_m = 60;
  void Check() const;  // throws std::invalid_argument naming field, value and rule
};

// A panorama that views are rendered from, prepared once: image pyramid, mask, and its depth. Depth
// without planes (a raster, a placeholder) shows nothing. Immutable and thread-safe; throws
// std::invalid_argument where the panorama is empty.
class RenderSource {
 public:
  RenderSource(GrayImage panorama, GrayImage mask, DepthMap depth);
  ~RenderSource();
  RenderSource(RenderSource&&) noexcept;
  struct Impl;
  [[nodiscard]] const Impl& impl() const { return *impl_; }
  [[nodiscard]] const DepthMap& depth() const;

 private:
  std::unique_ptr<Impl> impl_;
};

// What a rendered pixel shows.
struct RenderedPoint {
  int source_idx = 0;   // into the sources given to the renderer
  int surface_idx = 0;  // depth plane of that source
  Eigen::Vector3d point_in_source = Eigen::Vector3d::Zero();  // metres, the source's pano frame
  double metres_per_px = 0;  // of the source's pixels at the surface, across its sight
};

class RenderedView {
 public:
  GrayImage image;  // pixels that show nothing are filled so that no strong edge arises
  // The point under a pixel, from the plane itself; nullopt where nothing is known there.
  [[nodiscard]] std::optional<RenderedPoint> At(const Eigen::Vector2d& px) const;
  // Whether all of a disc shows one piece of surface of one source: nothing smeared, no hole, no
  // depth step, no seam between sources. Features that fail hold what no camera ever sees.
  [[nodiscard]] bool IsWhole(const Eigen::Vector2d& px, double radius_px) const;
  // Share of the pixels that show something, [0, 1].
  [[nodiscard]] double coverage() const;
  struct Impl;
  std::shared_ptr<const Impl> impl;
};

// Renders pinhole views at stations. Immutable, thread-safe, deterministic.
class ViewRenderer {
 public:
  // `view_camera` must have no distortion (std::invalid_argument).
  ViewRenderer(const Camera& view_camera, std::vector<ViewDirection> directions,
               const RenderOptions& options);
  // View `view_idx` at a station. `station_from_source[i]` places sources[i]'s pano frame in the
  // station's (parallel to its own panorama's pano frame, origin at the station); sources are in
  // order of preference, nearest first. A surface hides what lies behind it, whichever source it
  // comes from.
  [[nodiscard]] RenderedView Render(std::span<const RenderSource* const> sources,
                                    std::span<const Rigid3> station_from_source,
                                    int view_idx) const;

 private:
  Camera camera_;
  std::vector<ViewDirection> directions_;
  RenderOptions options_;
};

}  // namespace panofix
