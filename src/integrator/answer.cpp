// Nearest hits for other hosts, and what becomes of their answers.
#include <algorithm>
#include <array>

#include "integrator/shader.h"
#include "integrator/timer.h"
#include "parts/part_triangle.h"

namespace cloudrenderer {
namespace {

// False: the hit is on something else than a triangle of the world, which no host that only intersects is given.
bool describe(const ResidentSet& set, const Hit& hit, AnsweredHit& out) {
  if (hit.geometry != 0 || hit.instance != kNone) return false;
  out.t = hit.t;
  out.u = hit.u;
  out.v = hit.v;
  out.shape = hit.shape;
  out.primitive = hit.primitive;
  const Part& part = set.part(hit.part);
  const MeshChunk& c = part.chunk_of(hit.index);
  AnsweredSurface& s = out.surface;
  s.material = c.material;
  s.light = c.light;
  if (c.flip != 0) s.flags |= kAnsweredFlip;
  const TriangleVertices tri = vertices_of(part, c, hit.index);
  if (tri.has_normals) s.flags |= kAnsweredNormals;
  if (tri.has_uvs) s.flags |= kAnsweredUvs;
  s.p = tri.p;
  s.n = tri.n;
  s.uv = tri.uv;
  return true;
}

}  // namespace

void PathTracer::nearest(std::span<const OcclusionRay> rays, std::span<AnsweredHit> hits) const {
  const BatchTimer timer(time_.trace);
  const auto set = resident_.snapshot();
  std::vector<Candidate> list(map_.part_count());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const OcclusionRay& r = rays[i];
    hits[i] = {};
    if (!traceable(r.origin, r.direction)) continue;
    Hit hit;
    hit.t = r.t_max;
    const TraceRay ray{r.origin, kInfinity, r.direction};
    const std::size_t n = map_.candidates(r.origin, r.direction, r.t_max, list);
    for (std::size_t c = 0; c < n && list[c].t_enter <= hit.t; ++c)
      if (set->has(list[c].part)) set->intersect(list[c].part, ray, hit);
    if (hit.part != kNone && !describe(*set, hit, hits[i])) hits[i] = {};
  }
}

void PathTracer::mark_tested(PathSegment& s, float t_max, const std::vector<bool>& answered) const {
  const std::size_t skip = kWindow * s.window;
  std::array<Candidate, kWindow> small;
  std::vector<Candidate> large(skip == 0 ? 0 : skip + kWindow);
  const std::span<Candidate> list = skip == 0 ? std::span<Candidate>(small) : std::span<Candidate>(large);
  const std::size_t n = map_.candidates(s.origin, s.direction, t_max, list);
  for (std::size_t i = skip; i < n; ++i)
    if (list[i].part < answered.size() && answered[list[i].part]) s.tested |= std::uint64_t{1} << (i - skip);
}

// What names a material or a light that is not there comes from a host with another scene, and is as good as none.
SurfacePoint PathTracer::Shader::surface(const AnsweredSurface& s, const Hit& hit, std::uint32_t& material,
                                         std::uint32_t& light, bool derivatives) const {
  material = s.material;
  light = s.light < tracer.shape_lights_ ? s.light : kNone;
  TriangleVertices tri{};
  tri.p = s.p;
  tri.n = s.n;
  tri.uv = s.uv;
  tri.has_normals = s.flags & kAnsweredNormals;
  tri.has_uvs = (s.flags & kAnsweredUvs) && (derivatives || tracer.dialect_ == Dialect::v2);
  return triangle_point(tri, s.flags & kAnsweredFlip, tracer.dialect_, hit.u, hit.v, derivatives);
}

}  // namespace cloudrenderer
