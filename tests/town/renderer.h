#pragma once
// Pictures of the town: linear light along rays, panoramas and camera frames.

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "common/camera/camera.h"
#include "common/geometry/rigid3.h"
#include "tests/town/scene.h"

namespace panofix::town {

// Light of a day and how a camera takes it.
struct Light {
  Eigen::Vector3f to_sun{0, 0, 1};  // unit
  Rgb sun{1.3f, 1.25f, 1.15f};
  Rgb sky{0.5f, 0.55f, 0.65f};  // ambient from above
  std::uint32_t cloud_seed = 1;
  float cloud_cover = 0.5f;  // [0, 1]
  float exposure = 1;
  Rgb white_balance{1, 1, 1};
};

// Linear RGB, row-major.
struct LinearImage {
  int width = 0, height = 0;
  std::vector<Rgb> pixels;
};

class Renderer {
 public:
  // `world` must outlive the renderer.
  Renderer(const World& world, const Light& light, int edge_samples);

  // Rows [row0, row1) of an equirectangular picture (INTERFACES: column 0 is heading - 180
  // degrees).
  void PanoramaRows(const Rigid3& town_from_pano, int width_px, int row0, int row1, Rgb* out) const;
  // A frame through the camera with its distortion; serial.
  [[nodiscard]] LinearImage Frame(const Rigid3& town_from_cam, const Camera& camera) const;

  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] const World& world() const { return world_; }

 private:
  // A picture as a function from fractional pixels to unit rays in the town.
  struct View {
    Eigen::Vector3d origin;
    std::function<Eigen::Vector3f(float x, float y)> ray;
    std::function<void(int y, int x0, int count, Eigen::Vector3f* rays)> ray_run;
    int width = 0, height = 0;
    bool wraps = false;
    float pixel_rad = 0;
  };
  struct Sample;
  struct Strip;
  void RenderRows(const View& view, int row0, int row1, Rgb* out) const;
  void TraceStrip(const View& view, Strip& strip) const;
  void TracePacket(const View& view, RayPacket& packet, Sample* samples) const;
  [[nodiscard]] Rgb EdgeColour(const View& view, int x, int y, const Sample& centre) const;
  [[nodiscard]] bool IsEdge(const Sample& a, const Sample& b) const;
  [[nodiscard]] Rgb Shade(const View& view, const Sample& sample) const;
  [[nodiscard]] Rgb Sky(const Eigen::Vector3f& ray) const;

  const World& world_;
  Light light_;
  int edge_samples_;
  std::vector<Eigen::Vector2f> edge_offsets_px_;  // from the pixel's centre
  Scene scene_;
};

}  // namespace panofix::town
