#include "bare_embree.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace cloudrenderer {
namespace {

constexpr std::size_t kWide = 8;

template <class Rays>
void fill(Rays& r, int* valid, std::span<const OcclusionRay> rays) {
  for (std::size_t i = 0; i < kWide; ++i) {
    const OcclusionRay& from = rays[std::min(i, rays.size() - 1)];
    valid[i] = i < rays.size() ? -1 : 0;
    r.org_x[i] = from.origin.x;
    r.org_y[i] = from.origin.y;
    r.org_z[i] = from.origin.z;
    r.dir_x[i] = from.direction.x;
    r.dir_y[i] = from.direction.y;
    r.dir_z[i] = from.direction.z;
    r.tnear[i] = 0;
    r.tfar[i] = from.t_max;
    r.time[i] = 0;
    r.mask[i] = 0xffffffffu;
    r.id[i] = 0;
    r.flags[i] = 0;
  }
}

RTCRay single(const OcclusionRay& from) {
  RTCRay r{};
  r.org_x = from.origin.x;
  r.org_y = from.origin.y;
  r.org_z = from.origin.z;
  r.dir_x = from.direction.x;
  r.dir_y = from.direction.y;
  r.dir_z = from.direction.z;
  r.tfar = from.t_max;
  r.mask = 0xffffffffu;
  return r;
}

}  // namespace

BareEmbree::BareEmbree(bool robust, const char* isa)
    : device_(rtcNewDevice((std::string("threads=1,set_affinity=0,max_isa=") + isa).c_str())), robust_(robust) {
  if (!device_) throw std::runtime_error("Embree cannot make a device");
  rtcSetDeviceMemoryMonitorFunction(
      device_,
      [](void* self, ssize_t bytes, bool) {
        static_cast<BareEmbree*>(self)->bytes_ += static_cast<std::size_t>(bytes);
        return true;
      },
      this);
  scene_ = rtcNewScene(device_);
  rtcSetSceneFlags(scene_, robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
}

BareEmbree::~BareEmbree() {
  for (RTCScene s : prototypes_) rtcReleaseScene(s);
  rtcReleaseScene(scene_);
  rtcReleaseDevice(device_);
}

void BareEmbree::add_triangles(RTCScene to, const Part& part) {
  left_out_ += part.quadrics.size() + part.curves.segments.size() + part.bricks.size() + part.motions.size();
  if (part.triangles.empty()) return;
  RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, part.positions.data(), 0, sizeof(Vec3),
                             part.positions.size());
  rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, part.triangles.data(), 0, sizeof(Triangle),
                             part.triangles.size());
  rtcCommitGeometry(g);
  rtcAttachGeometry(to, g);
  rtcReleaseGeometry(g);
}

void BareEmbree::add_prototype(const Part& part) {
  RTCScene s = rtcNewScene(device_);
  rtcSetSceneFlags(s, robust_ ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
  add_triangles(s, part);
  left_out_ += part.instances.size();
  rtcCommitScene(s);
  prototypes_.push_back(s);
}

void BareEmbree::add_part(const Part& part) {
  add_triangles(scene_, part);
  for (const InstanceRecord& instance : part.instances) {
    RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(g, prototypes_.at(instance.prototype));
    const glm::mat4 m(instance.to_world.matrix());
    rtcSetGeometryTransform(g, 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, &m[0][0]);
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene_, g);
    rtcReleaseGeometry(g);
  }
}

void BareEmbree::commit() { rtcCommitScene(scene_); }

std::uint64_t BareEmbree::intersect(std::span<const OcclusionRay> rays, bool packets, bool alike) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (alike) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  std::uint64_t hits = 0;
  if (!packets) {
    for (const OcclusionRay& from : rays) {
      RTCRayHit r;
      r.ray = single(from);
      r.hit.geomID = r.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      rtcIntersect1(scene_, &context, &r);
      hits += r.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    }
    return hits;
  }
  for (std::size_t i = 0; i < rays.size(); i += kWide) {
    RTCRayHit8 r;
    alignas(32) int valid[kWide];
    fill(r.ray, valid, rays.subspan(i, std::min(kWide, rays.size() - i)));
    for (std::size_t k = 0; k < kWide; ++k) r.hit.geomID[k] = r.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect8(valid, scene_, &context, &r);
    for (std::size_t k = 0; k < kWide; ++k) hits += valid[k] && r.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
  }
  return hits;
}

std::uint64_t BareEmbree::occluded(std::span<const OcclusionRay> rays, bool packets) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  std::uint64_t hits = 0;
  if (!packets) {
    for (const OcclusionRay& from : rays) {
      RTCRay r = single(from);
      rtcOccluded1(scene_, &context, &r);
      hits += r.tfar < 0;
    }
    return hits;
  }
  for (std::size_t i = 0; i < rays.size(); i += kWide) {
    RTCRay8 r;
    alignas(32) int valid[kWide];
    fill(r, valid, rays.subspan(i, std::min(kWide, rays.size() - i)));
    rtcOccluded8(valid, scene_, &context, &r);
    for (std::size_t k = 0; k < kWide; ++k) hits += valid[k] && r.tfar[k] < 0;
  }
  return hits;
}

}  // namespace cloudrenderer
