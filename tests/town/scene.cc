#include "tests/town/scene.h"

#include <embree3/rtcore.h>

#include <cstring>
#include <limits>

#include "common/base/status.h"

namespace panofix::town {
namespace {

constexpr float kFarthest_m = 5000;

}  // namespace

struct Scene::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::vector<std::pair<Eigen::Vector3d, double>> planes;
  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

Scene::Scene(const std::vector<Face>& faces) : impl_(std::make_unique<Impl>()) {
  // One build thread: the tree, and with it the choice between equally near quads, is then fixed.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl_->device == nullptr)
    throw Error(ErrorCode::kInternal, "embree: no device on this processor");
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  if (!faces.empty()) {
    RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_QUAD);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), 4 * faces.size()));
    auto* indices = static_cast<std::uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4,
                                4 * sizeof(std::uint32_t), faces.size()));
    for (std::size_t i = 0; i < faces.size(); ++i) {
      const Face& face = faces[i];
      for (std::size_t k = 0; k < 4; ++k) {
        std::memcpy(vertices + 3 * (4 * i + k), face.corners[k].data(), 3 * sizeof(float));
        indices[4 * i + k] = static_cast<std::uint32_t>(4 * i + k);
      }
      // A repeated last corner makes a triangle.
      if (face.corners[3] == face.corners[2]) indices[4 * i + 3] = indices[4 * i + 2];
      impl_->planes.emplace_back(face.normal, face.d);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(impl_->scene, geometry);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(impl_->scene);
  if (rtcGetDeviceError(impl_->device) != RTC_ERROR_NONE) {
    throw Error(ErrorCode::kInternal, "embree: the scene could not be built; free some memory");
  }
}

Scene::~Scene() = default;
Scene::Scene(Scene&&) noexcept = default;

std::optional<Scene::Hit> Scene::Cast(const Eigen::Vector3d& origin,
                                      const Eigen::Vector3d& unit_ray) const {
  RTCRayHit query{};
  const Eigen::Vector3f o = origin.cast<float>(), d = unit_ray.cast<float>();
  query.ray.org_x = o.x(), query.ray.org_y = o.y(), query.ray.org_z = o.z();
  query.ray.dir_x = d.x(), query.ray.dir_y = d.y(), query.ray.dir_z = d.z();
  query.ray.tfar = kFarthest_m;
  query.ray.mask = ~0u;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.primID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(impl_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const auto& [normal, plane_d] = impl_->planes[query.hit.primID];
  return Hit{query.hit.primID, (plane_d - normal.dot(origin)) / normal.dot(unit_ray)};
}

void Scene::Cast(RayPacket& p) const {
  constexpr auto kBytes = sizeof(float) * RayPacket::kSize;
  RTCRayHit16 query;
  std::memcpy(query.ray.org_x, p.ox, kBytes);
  std::memcpy(query.ray.org_y, p.oy, kBytes);
  std::memcpy(query.ray.org_z, p.oz, kBytes);
  std::memcpy(query.ray.dir_x, p.dx, kBytes);
  std::memcpy(query.ray.dir_y, p.dy, kBytes);
  std::memcpy(query.ray.dir_z, p.dz, kBytes);
  for (int i = 0; i < RayPacket::kSize; ++i) {
    query.ray.tnear[i] = 0;
    query.ray.tfar[i] = kFarthest_m;
    query.ray.time[i] = 0;
    query.ray.mask[i] = ~0u;
    query.ray.flags[i] = 0;
    query.hit.geomID[i] = query.hit.primID[i] = query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(p.active, impl_->scene, &context, &query);
  std::memcpy(p.range, query.ray.tfar, kBytes);
  for (int i = 0; i < RayPacket::kSize; ++i) p.quad[i] = query.hit.primID[i];
}

void Scene::Block(RayPacket& p) const {
  constexpr auto kBytes = sizeof(float) * RayPacket::kSize;
  RTCRay16 query;
  std::memcpy(query.org_x, p.ox, kBytes);
  std::memcpy(query.org_y, p.oy, kBytes);
  std::memcpy(query.org_z, p.oz, kBytes);
  std::memcpy(query.dir_x, p.dx, kBytes);
  std::memcpy(query.dir_y, p.dy, kBytes);
  std::memcpy(query.dir_z, p.dz, kBytes);
  for (int i = 0; i < RayPacket::kSize; ++i) {
    query.tnear[i] = 0;
    query.tfar[i] = kFarthest_m;
    query.time[i] = 0;
    query.mask[i] = ~0u;
    query.flags[i] = 0;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcOccluded16(p.active, impl_->scene, &context, &query);
  for (int i = 0; i < RayPacket::kSize; ++i) p.quad[i] = query.tfar[i] < 0 ? 0 : kNoQuad;
}

}  // namespace panofix::town
