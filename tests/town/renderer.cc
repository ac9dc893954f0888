#include "tests/town/renderer.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "tests/town/textures.h"

namespace panofix::town {

using Eigen::Vector3d;
using Eigen::Vector3f;

struct Renderer::Sample {
  std::uint32_t quad = kNoQuad;
  float range = 0;
  bool lit = false;
  Vector3f ray;
};

// Traced rows of a picture with a margin above and below, so that edges across rows are seen.
struct Renderer::Strip {
  int first_row = 0, num_rows = 0, width = 0;
  std::vector<Sample> samples;
  [[nodiscard]] Sample& At(int row, int x) {
    return samples[static_cast<std::size_t>(row - first_row) * static_cast<std::size_t>(width) +
                   static_cast<std::size_t>(x)];
  }
};

Renderer::Renderer(const World& world, const Light& light, int edge_samples)
    : world_(world), light_(light), edge_samples_(edge_samples), scene_(world.quads) {
  // Points of the plastic sequence: even over the pixel for any count. Their mean is taken out, or
  // every edge of a picture would lie a few hundredths of a pixel off.
  Eigen::Vector2f mean(0, 0);
  for (int k = 1; k <= edge_samples; ++k) {
    const float x = static_cast<float>(k) * 0.7548777f, y = static_cast<float>(k) * 0.5698403f;
    edge_offsets_px_.emplace_back(x - std::floor(x), y - std::floor(y));
    mean += edge_offsets_px_.back() / static_cast<float>(edge_samples);
  }
  for (auto& offset : edge_offsets_px_) offset -= mean;
}

void Renderer::PanoramaRows(const Rigid3& town_from_pano, int width_px, int row0, int row1,
                            Rgb* out) const {
  const Eigen::Matrix3f R = town_from_pano.rotation.toRotationMatrix().cast<float>();
  const float step = 2 * std::numbers::pi_v<float> / static_cast<float>(width_px);
  const auto ray = [&](float x, float y) {
    const float azimuth = (x + 0.5f) * step - std::numbers::pi_v<float>;
    const float elevation = 0.5f * std::numbers::pi_v<float> - (y + 0.5f) * step;
    const float c = std::cos(elevation);
    return Vector3f(R *
                    Vector3f(c * std::sin(azimuth), c * std::cos(azimuth), std::sin(elevation)));
  };
  std::vector<std::pair<float, float>> azimuths(static_cast<std::size_t>(width_px));
  for (int x = 0; x < width_px; ++x) {
    const float azimuth = (static_cast<float>(x) + 0.5f) * step - std::numbers::pi_v<float>;
    azimuths[static_cast<std::size_t>(x)] = {std::sin(azimuth), std::cos(azimuth)};
  }
  View view;
  view.origin = town_from_pano.translation;
  view.ray = ray;
  view.ray_run = [&](int y, int x0, int count, Vector3f* rays) {
    const float elevation =
        0.5f * std::numbers::pi_v<float> - (static_cast<float>(y) + 0.5f) * step;
    const float c = std::cos(elevation), s = std::sin(elevation);
    for (int i = 0; i < count; ++i) {
      const auto& [sin_a, cos_a] = azimuths[static_cast<std::size_t>((x0 + i) % width_px)];
      rays[i] = R * Vector3f(c * sin_a, c * cos_a, s);
    }
  };
  view.width = width_px;
  view.height = width_px / 2;
  view.wraps = true;
  view.pixel_rad = step;
  RenderRows(view, row0, row1, out);
}

LinearImage Renderer::Frame(const Rigid3& town_from_cam, const Camera& camera) const {
  const Eigen::Matrix3d R = town_from_cam.rotation.toRotationMatrix();
  View view;
  view.origin = town_from_cam.translation;
  view.ray = [&](float x, float y) {
    const Eigen::Vector2d n = camera.Normalize({x, y});
    return Vector3f((R * Vector3d(n.x(), n.y(), 1).normalized()).cast<float>());
  };
  view.ray_run = [&](int y, int x0, int count, Vector3f* rays) {
    for (int i = 0; i < count; ++i)
      rays[i] = view.ray(static_cast<float>(x0 + i), static_cast<float>(y));
  };
  view.width = camera.width_px;
  view.height = camera.height_px;
  view.pixel_rad = static_cast<float>(1 / camera.fx_px);
  LinearImage image{camera.width_px, camera.height_px, {}};
  image.pixels.resize(static_cast<std::size_t>(image.width) *
                      static_cast<std::size_t>(image.height));
  RenderRows(view, 0, image.height, image.pixels.data());
  return image;
}

void Renderer::RenderRows(const View& view, int row0, int row1, Rgb* out) const {
  Strip strip;
  strip.first_row = std::max(0, row0 - 1);
  strip.num_rows = std::min(view.height, row1 + 1) - strip.first_row;
  strip.width = view.width;
  strip.samples.resize(static_cast<std::size_t>(strip.num_rows) *
                       static_cast<std::size_t>(strip.width));
  TraceStrip(view, strip);
  const int last_row = strip.first_row + strip.num_rows - 1;
  for (int y = row0; y < row1; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const Sample& centre = strip.At(y, x);
      const int left = x > 0 ? x - 1 : (view.wraps ? view.width - 1 : 0);
      const int right = x + 1 < view.width ? x + 1 : (view.wraps ? 0 : x);
      const bool edge = edge_samples_ > 1 &&
                        (IsEdge(centre, strip.At(y, left)) || IsEdge(centre, strip.At(y, right)) ||
                         IsEdge(centre, strip.At(std::max(strip.first_row, y - 1), x)) ||
                         IsEdge(centre, strip.At(std::min(last_row, y + 1), x)));
      *out++ = edge ? EdgeColour(view, x, y, centre) : Shade(view, centre);
    }
  }
}

void Renderer::TraceStrip(const View& view, Strip& strip) const {
  constexpr int kSide = 4;  // a packet is a 4 x 4 block: coherent in both directions
  RayPacket packet;
  Sample samples[RayPacket::kSize];
  for (int y = 0; y < strip.num_rows; y += kSide) {
    for (int x = 0; x < strip.width; x += kSide) {
      for (int dy = 0; dy < kSide; ++dy) {
        Vector3f rays[kSide];
        const int row = std::min(y + dy, strip.num_rows - 1),
                  count = std::min(kSide, strip.width - x);
        view.ray_run(strip.first_row + row, x, count, rays);
        for (int dx = 0; dx < kSide; ++dx) {
          const int k = dy * kSide + dx;
          packet.active[k] = dx < count && y + dy < strip.num_rows ? -1 : 0;
          samples[k].ray = rays[std::min(dx, count - 1)];
        }
      }
      TracePacket(view, packet, samples);
      for (int k = 0; k < RayPacket::kSize; ++k) {
        if (packet.active[k] == 0) continue;
        strip.At(strip.first_row + y + k / kSide, x + k % kSide) = samples[k];
      }
    }
  }
}

// Casts the samples' rays, then asks for each hit whether it sees the sun.
void Renderer::TracePacket(const View& view, RayPacket& packet, Sample* samples) const {
  const Vector3f origin = view.origin.cast<float>();
  for (int k = 0; k < RayPacket::kSize; ++k) {
    packet.ox[k] = origin.x(), packet.oy[k] = origin.y(), packet.oz[k] = origin.z();
    packet.dx[k] = samples[k].ray.x(), packet.dy[k] = samples[k].ray.y(),
    packet.dz[k] = samples[k].ray.z();
  }
  scene_.Cast(packet);
  RayPacket shadow;
  bool any = false;
  for (int k = 0; k < RayPacket::kSize; ++k) {
    Sample& s = samples[k];
    s.quad = packet.active[k] != 0 ? packet.quad[k] : kNoQuad;
    s.range = packet.range[k];
    s.lit = false;
    shadow.active[k] = 0;
    shadow.ox[k] = shadow.oy[k] = shadow.oz[k] = 0;
    shadow.dx[k] = light_.to_sun.x(), shadow.dy[k] = light_.to_sun.y(),
    shadow.dz[k] = light_.to_sun.z();
    if (s.quad == kNoQuad) continue;
    Vector3f normal = world_.quads[s.quad].normal.cast<float>();
    if (normal.dot(s.ray) > 0) normal = -normal;
    if (normal.dot(light_.to_sun) <= 0) continue;
    constexpr float kLift_m = 0.004f;
    const Vector3f from = origin + s.range * s.ray + kLift_m * normal;
    shadow.ox[k] = from.x(), shadow.oy[k] = from.y(), shadow.oz[k] = from.z();
    shadow.active[k] = -1;
    any = true;
  }
  if (!any) return;
  scene_.Block(shadow);
  for (int k = 0; k < RayPacket::kSize; ++k) {
    samples[k].lit = shadow.active[k] != 0 && shadow.quad[k] == kNoQuad;
  }
}

bool Renderer::IsEdge(const Sample& a, const Sample& b) const {
  if (a.lit != b.lit) return true;
  if (a.quad == b.quad) return false;
  if (a.quad == kNoQuad || b.quad == kNoQuad) return true;
  const Quad &p = world_.quads[a.quad], &q = world_.quads[b.quad];
  return p.material != q.material || p.normal.dot(q.normal) < 0.999 || std::abs(p.d - q.d) > 0.005;
}

Rgb Renderer::EdgeColour(const View& view, int x, int y, const Sample& centre) const {
  RayPacket packet;
  Sample samples[RayPacket::kSize];
  for (int k = 0; k < RayPacket::kSize; ++k) packet.active[k] = k < edge_samples_ ? -1 : 0;
  for (int k = 0; k < edge_samples_; ++k) {
    const Eigen::Vector2f& offset = edge_offsets_px_[static_cast<std::size_t>(k)];
    samples[k].ray =
        view.ray(static_cast<float>(x) + offset.x(), static_cast<float>(y) + offset.y());
  }
  for (int k = edge_samples_; k < RayPacket::kSize; ++k) samples[k].ray = centre.ray;
  TracePacket(view, packet, samples);
  Rgb sum;
  for (int k = 0; k < edge_samples_; ++k) sum = sum + Shade(view, samples[k]);
  return sum * (1 / static_cast<float>(edge_samples_));
}

Rgb Renderer::Shade(const View& view, const Sample& sample) const {
  if (sample.quad == kNoQuad) return Sky(sample.ray);
  const Quad& quad = world_.quads[sample.quad];
  Vector3f normal = quad.normal.cast<float>();
  float cosine = normal.dot(sample.ray);
  if (cosine > 0) normal = -normal;
  cosine = std::max(0.05f, std::abs(cosine));
  const Vector3f at = view.origin.cast<float>() + sample.range * sample.ray;
  const Vector3f local = at - quad.origin;
  const float u = local.dot(quad.u_axis) + quad.u0, v = local.dot(quad.v_axis) + quad.v0;
  // Footprint: the pixel's disc, stretched along the ray's trace on the plane.
  const float size = sample.range * view.pixel_rad;
  const Vector3f trace = (sample.ray + cosine * normal) * (1 / cosine);
  const float stretch_u = trace.dot(quad.u_axis), stretch_v = trace.dot(quad.v_axis);
  const Footprint footprint{size * std::sqrt(1 + stretch_u * stretch_u),
                            size * std::sqrt(1 + stretch_v * stretch_v)};
  const SurfaceColour surface =
      EvaluateMaterial(world_, world_.materials[quad.material], u, v, footprint);
  // Sky from above, bounce from below and from the walls across.
  const Rgb ambient =
      Mix(light_.sun * 0.09f + light_.sky * 0.25f, light_.sky, 0.5f + 0.5f * normal.z());
  Rgb light = ambient;
  if (sample.lit) light = light + light_.sun * std::max(0.0f, normal.dot(light_.to_sun));
  Rgb colour = surface.albedo * light;
  if (surface.mirror > 0) {
    const Vector3f mirrored = sample.ray + 2 * cosine * normal;
    const Rgb seen = mirrored.z() > 0.25f
                         ? Sky(mirrored)
                         : light_.sky * (0.22f + 0.3f * std::max(0.0f, mirrored.z()));
    const float fresnel = surface.mirror + (1 - surface.mirror) * 0.5f *
                                               std::pow(1 - cosine, 4.0f) *
                                               (surface.mirror > 0.05f ? 1.0f : 0.2f);
    colour = Mix(colour, seen, std::min(0.9f, fresnel));
  }
  return colour;
}

Rgb Renderer::Sky(const Vector3f& ray) const {
  const float up = std::max(0.0f, ray.z());
  const Rgb blue = Mix(Rgb{0.62f, 0.68f, 0.74f}, Rgb{0.2f, 0.34f, 0.62f}, std::sqrt(up)) * 1.15f;
  const float scale = 1.6f / (0.25f + up);
  const float x = ray.x() * scale, y = ray.y() * scale;
  const float cloud = ValueNoise(x, y, light_.cloud_seed) +
                      0.5f * ValueNoise(2.1f * x, 2.1f * y, light_.cloud_seed ^ 1u) +
                      0.25f * ValueNoise(4.3f * x, 4.3f * y, light_.cloud_seed ^ 2u);
  const float cover = Clamp01(0.9f * cloud + 2 * light_.cloud_cover - 0.7f);
  const Rgb white = Rgb{0.95f, 0.95f, 0.96f} * (0.95f + 0.12f * cloud);
  const Rgb tint{light_.sky.r / 0.5f, light_.sky.g / 0.55f, light_.sky.b / 0.65f};
  return Mix(blue, white, cover) * Mix(Rgb{1, 1, 1}, tint, 0.7f);
}

}  // namespace panofix::town
