#pragma once
// Inside src/trace only: what shapes with an intersection test of our own share.
#include "trace/loaded_part.h"

namespace cloudrenderer {

struct LaneRay {
  Vec3 origin, direction;
  float t_near, t_far;
};
inline LaneRay lane_ray(RTCRayN* ray, unsigned n, unsigned i) {
  return {{RTCRayN_org_x(ray, n, i), RTCRayN_org_y(ray, n, i), RTCRayN_org_z(ray, n, i)},
          {RTCRayN_dir_x(ray, n, i), RTCRayN_dir_y(ray, n, i), RTCRayN_dir_z(ray, n, i)},
          RTCRayN_tnear(ray, n, i),
          RTCRayN_tfar(ray, n, i)};
}

// Asks the filter whether a hit of lane `i` at t counts, and keeps it if so. False where it does not: behind a surface
// that alpha takes away, the same primitive may be met once more.
inline bool offer_hit(const RTCIntersectFunctionNArguments* args, unsigned i, const LaneRay& r, float t, float u, float v) {
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  RTCHitN* hits = RTCRayHitN_HitN(args->rayhit, args->N);
  RTCHit hit{};
  hit.u = u;
  hit.v = v;
  hit.geomID = args->geomID;
  hit.primID = args->primID;
  hit.instID[0] = args->context->instID[0];
  // The filter decides about ties and alpha; it wants the candidate's distance in the ray.
  RTCRayN_tfar(rays, args->N, i) = t;
  int valid = -1;
  if (args->N == 1) {
    RTCFilterFunctionNArguments f{&valid, args->geometryUserPtr, args->context, rays, reinterpret_cast<RTCHitN*>(&hit), 1};
    intersect_filter(&f);
  } else {
    RTCRay single = rtcGetRayFromRayN(rays, args->N, i);
    RTCFilterFunctionNArguments f{&valid, args->geometryUserPtr, args->context, reinterpret_cast<RTCRayN*>(&single),
                                  reinterpret_cast<RTCHitN*>(&hit), 1};
    intersect_filter(&f);
    if (valid) RTCRayN_tfar(rays, args->N, i) = single.tfar;
  }
  if (valid)
    rtcCopyHitToHitN(hits, &hit, args->N, i);
  else
    RTCRayN_tfar(rays, args->N, i) = r.t_far;
  return valid != 0;
}

}  // namespace cloudrenderer
