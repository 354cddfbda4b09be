#include "trace/loaded_part.h"

#include <algorithm>
#include <cmath>

#include "parts/part_builder.h"
#include "parts/spool.h"
#include "shapes/geometry.h"
#include "shapes/surface.h"
#include "trace/user_geometry.h"

namespace cloudrenderer {

namespace {

void quadric_bounds(const RTCBoundsFunctionArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const Bounds3 b = world_bounds(self->part().quadrics[args->primID].quadric);
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

void quadric_intersect(const RTCIntersectFunctionNArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  if (is_beside(args->context)) return;
  const Quadric& q = self->part().quadrics[args->primID].quadric;
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    const LaneRay r = lane_ray(rays, args->N, i);
    if (self->surely_misses(args->primID, r.origin, r.direction, r.t_far)) continue;
    QuadricHit found{r.t_near};
    while (intersect(q, r.origin, r.direction, found.t, r.t_far, found))
      if (offer_hit(args, i, r, found.t, 0, 0) || !self->has_alpha()) break;
  }
}

void quadric_occluded(const RTCOccludedFunctionNArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const Quadric& q = self->part().quadrics[args->primID].quadric;
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    const LaneRay r = lane_ray(args->ray, args->N, i);
    if (self->surely_misses(args->primID, r.origin, r.direction, r.t_far)) continue;
    QuadricHit found{r.t_near};
    while (RTCRayN_tfar(args->ray, args->N, i) >= 0 && intersect(q, r.origin, r.direction, found.t, r.t_far, found))
      if (!self->has_alpha() || self->opaque(kQuadrics, args->primID, 0, 0, r.origin, r.direction, found.t, true, scene_of(args->context)))
        RTCRayN_tfar(args->ray, args->N, i) = -kInfinity;
  }
}

void moving_bounds(const RTCBoundsFunctionArguments* args) {
  const Bounds3& b = static_cast<const LoadedPart*>(args->geometryUserPtr)->moving(args->primID).bounds;
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

// A ray of a lane in the space of an instance, as it is at the ray's time. False for one that Embree must not see.
bool enter(const LoadedPart::Moving& m, const QueryContext& context, const LaneRay& r, unsigned id, RTCRay& out) {
  Vec3 o, d;
  if (m.moves.empty()) {
    o = Vec3(m.fixed_inverse.point(r.origin));
    d = Vec3(m.fixed_inverse.m * glm::dvec3(r.direction));
  } else {
    const Mat4 to_object = entering(m.fixed_inverse, m.moves, context.times ? context.times[id] : 0.f);
    o = Vec3(to_object * glm::vec4(r.origin, 1.f));
    d = Vec3(to_object * glm::vec4(r.direction, 0.f));
  }
  out = {o.x, o.y, o.z, r.t_near, d.x, d.y, d.z, 0, r.t_far, 0xffffffffu, id, 0};
  return traceable(o, d);
}

// Rays go into instances that stand still by a matrix in float, whose products cancel where axes are of very different lengths
// and turned: rays then meet another object than the box says, or the very surface that they leave. True where the bound of
// that error, as it is of an inverse by cofactors, is more than eight times what rounding the exact inverse would do.
bool inverts_badly(const Mat4& matrix) {
  const Affine a(matrix);
  const auto cofactors = [&](int i, const glm::dmat3& m) { return glm::cross(m[(i + 1) % 3], m[(i + 2) % 3]); };
  const auto summed = [&](int i) {  // the same products, without their signs
    const glm::dvec3 b = glm::abs(a.m[(i + 1) % 3]), c = glm::abs(a.m[(i + 2) % 3]);
    return glm::dvec3(b.y * c.z + b.z * c.y, b.z * c.x + b.x * c.z, b.x * c.y + b.y * c.x);
  };
  const auto sum = [](const glm::dvec3& v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); };
  const double cancelled = glm::dot(glm::abs(a.m[0]), summed(0)) / std::abs(glm::dot(a.m[0], cofactors(0, a.m)));
  for (int i = 0; i < 3; ++i)
    if (!(sum(summed(i)) / sum(cofactors(i, a.m)) + cancelled <= 8)) return true;
  return false;
}

void moving_intersect(const RTCIntersectFunctionNArguments* args) {
  auto* context = reinterpret_cast<QueryContext*>(args->context);
  if (context->beside) return;
  const LoadedPart::Moving& m = static_cast<const LoadedPart*>(args->geometryUserPtr)->moving(args->primID);
  RTCRayN* rays = RTCRayHitN_RayN(args->rayhit, args->N);
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    RTCRayHit rh;
    if (!enter(m, *context, lane_ray(rays, args->N, i), RTCRayN_id(rays, args->N, i), rh.ray)) continue;
    rh.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    // Hits in there carry this number, and the filter judges them as those of any instance.
    args->context->instID[0] = m.instance;
    rtcIntersect1(m.prototype->scene(), args->context, &rh);
    args->context->instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (rh.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    RTCRayN_tfar(rays, args->N, i) = rh.ray.tfar;
    rtcCopyHitToHitN(RTCRayHitN_HitN(args->rayhit, args->N), &rh.hit, args->N, i);
  }
}

void moving_occluded(const RTCOccludedFunctionNArguments* args) {
  const auto* context = reinterpret_cast<const QueryContext*>(args->context);
  const LoadedPart::Moving& m = static_cast<const LoadedPart*>(args->geometryUserPtr)->moving(args->primID);
  for (unsigned i = 0; i < args->N; ++i) {
    if (!args->valid[i]) continue;
    RTCRay ray;
    if (!enter(m, *context, lane_ray(args->ray, args->N, i), RTCRayN_id(args->ray, args->N, i), ray)) continue;
    args->context->instID[0] = m.instance;
    rtcOccluded1(m.prototype->scene(), args->context, &ray);
    args->context->instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (ray.tfar < 0.f) RTCRayN_tfar(args->ray, args->N, i) = -kInfinity;
  }
}

void brick_bounds(const RTCBoundsFunctionArguments* args) {
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const DensityBrick& brick = self->part().bricks[args->primID].brick;
  const Bounds3 b = grown(Bounds3{brick.low, brick.high}.transformed(brick.object_to_world));
  *args->bounds_o = {b.min.x, b.min.y, b.min.z, 0, b.max.x, b.max.y, b.max.z, 0};
}

// Only single rays come with what they need to collide.
const BrickRay* brick_ray(const RTCIntersectContext* context, unsigned n) {
  return n == 1 ? reinterpret_cast<const QueryContext*>(context)->bricks : nullptr;
}

void brick_intersect(const RTCIntersectFunctionNArguments* args) {
  const BrickRay* bricks = brick_ray(args->context, args->N);
  if (!bricks || !args->valid[0] || is_beside(args->context)) return;
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  RTCRayN* ray = RTCRayHitN_RayN(args->rayhit, 1);
  const LaneRay r = lane_ray(ray, 1, 0);
  const float t = self->collide(args->primID, r.origin, r.direction, r.t_far, *bricks, false, scene_of(args->context));
  if (!(t < r.t_far)) return;
  RTCHit hit{};
  hit.geomID = args->geomID;
  hit.primID = args->primID;
  hit.instID[0] = args->context->instID[0];
  RTCRayN_tfar(ray, 1, 0) = t;
  int valid = -1;
  RTCFilterFunctionNArguments f{&valid, args->geometryUserPtr, args->context, ray, reinterpret_cast<RTCHitN*>(&hit), 1};
  intersect_filter(&f);
  if (valid)
    rtcCopyHitToHitN(RTCRayHitN_HitN(args->rayhit, 1), &hit, 1, 0);
  else
    RTCRayN_tfar(ray, 1, 0) = r.t_far;
}

void brick_occluded(const RTCOccludedFunctionNArguments* args) {
  const BrickRay* bricks = brick_ray(args->context, args->N);
  if (!bricks || !args->valid[0]) return;
  const auto* self = static_cast<const LoadedPart*>(args->geometryUserPtr);
  const LaneRay r = lane_ray(args->ray, 1, 0);
  if (self->collide(args->primID, r.origin, r.direction, r.t_far, *bricks, true, scene_of(args->context)) < r.t_far)
    RTCRayN_tfar(args->ray, 1, 0) = -kInfinity;
}

}  // namespace

LoadedPart::LoadedPart(std::shared_ptr<Device> device, Part part, std::vector<std::shared_ptr<const LoadedPart>> prototypes, BvhForm form)
    : device_(std::move(device)), part_(std::move(part)), prototypes_(std::move(prototypes)) {
  const auto masked = [](const auto& x) { return x.alpha_texture != kNone; };
  has_alpha_ = std::ranges::any_of(part_.chunks, masked) || std::ranges::any_of(part_.quadrics, masked) ||
                          std::ranges::any_of(part_.curves.groups, masked) ||
                          std::ranges::any_of(part_.curves.groups, [](const CurveGroup& g) { return g.shadow_alpha_texture != kNone; }) ||
                          std::ranges::any_of(part_.chunks, [](const MeshChunk& c) { return c.shadow_alpha_texture != kNone; });
  part_.guide_chunks();
  shared_bytes_ = part_.positions.size_bytes() + part_.normals.size_bytes() + part_.uvs.size_bytes() +
                  part_.triangles.size_bytes() + part_.primitive_ids.size_bytes() + part_.chunks.size_bytes() +
                  part_.chunk_guide.size() * sizeof(std::uint32_t) +
                  part_.quadrics.size_bytes() + part_.instances.size_bytes() + loaded_bytes::kSceneObject +
                  part_.quadrics.size() * sizeof(BoundingSphere) + part_.curves.size_bytes() +
                  part_.curves.groups.size() * sizeof(glm::dmat3) + part_.motions.size_bytes() +
                  part_.bricks.size_bytes() + part_.densities.size_bytes() +
                  part_.motions.size() * (sizeof(AnimatedTransform) + sizeof(Moving)) +
                  part_.instances.size() * loaded_bytes::kInstanceObject;
  const std::uint64_t before = device_->bytes();
  device_->add_shared(static_cast<std::int64_t>(shared_bytes_));
  scene_.reset(rtcNewScene(device_->get()));
  rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST |
                                     (has_alpha_ ? RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION : RTC_SCENE_FLAG_NONE));
  // Embree builds a mesh fast only on its own, below a tree of meshes: with other shapes beside it that is no gain.
  if (form == BvhForm::passing && part_.quadrics.empty() && part_.instances.empty() && part_.curves.segments.empty() &&
      part_.bricks.empty())
    quality_ = RTC_BUILD_QUALITY_LOW;
  rtcSetSceneBuildQuality(scene_.get(), quality_);
  add_triangles();
  add_quadrics();
  add_curves();
  add_moving();
  add_instances();
  add_bricks();
  few_quadrics_ = part_.triangles.empty() && part_.instances.empty() && part_.curves.segments.empty() &&
                  part_.bricks.empty() && part_.quadrics.size() <= 4;
  rtcCommitScene(scene_.get());
  device_->check("build");
  const std::uint64_t after = device_->bytes();
  bytes_ = after > before ? after - before : shared_bytes_;
}

LoadedPart::~LoadedPart() {
  scene_.reset();
  device_->add_shared(-static_cast<std::int64_t>(shared_bytes_));
}

void LoadedPart::add_triangles() {
  if (part_.triangles.empty()) return;
  const GeometryHandle g(rtcNewGeometry(device_->get(), RTC_GEOMETRY_TYPE_TRIANGLE));
  rtcSetSharedGeometryBuffer(g.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, part_.positions.data(), 0, sizeof(Vec3),
                             part_.positions.size());
  rtcSetSharedGeometryBuffer(g.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, part_.triangles.data(), 0,
                             sizeof(Triangle), part_.triangles.size());
  rtcSetGeometryUserData(g.get(), this);
  rtcSetGeometryBuildQuality(g.get(), quality_);
  rtcSetGeometryIntersectFilterFunction(g.get(), intersect_filter);
  rtcSetGeometryOccludedFilterFunction(g.get(), occluded_filter);
  rtcCommitGeometry(g.get());
  rtcAttachGeometryByID(scene_.get(), g.get(), kTriangles);
  device_->check("triangles");
}

void LoadedPart::add_quadrics() {
  if (part_.quadrics.empty()) return;
  static_assert(sizeof(BoundingSphere) == loaded_bytes::kQuadricSphere);
  around_.reserve(part_.quadrics.size());
  for (const QuadricRecord& record : part_.quadrics) {
    const Bounds3 box = world_bounds(record.quadric);
    BoundingSphere around{box.center(), 0.5f * glm::length(box.diagonal()) * 1.00001f};
    if (record.quadric.kind == QuadricKind::sphere) {
      // A ball of the longest axis around the centre, if that is smaller than the ball around the box.
      const glm::mat3 m(record.quadric.object_to_world.matrix());
      const float scale2 = glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]) + glm::dot(m[2], m[2]);
      const float uniform = std::sqrt(scale2 / 3.f);
      const bool similar = std::fabs(glm::length(m[0]) - uniform) < 1e-6f * uniform && std::fabs(glm::length(m[1]) - uniform) < 1e-6f * uniform &&
                           std::fabs(glm::dot(m[0], m[1])) < 1e-6f * scale2 && std::fabs(glm::dot(m[1], m[2])) < 1e-6f * scale2 &&
                           std::fabs(glm::dot(m[0], m[2])) < 1e-6f * scale2;
      if (similar) around = {record.quadric.object_to_world.point(Vec3(0.f)), record.quadric.radius * uniform * 1.00001f};
    }
    if (record.quadric.kind == QuadricKind::disk && record.quadric.phi_max >= 2 * kPi) {
      // Of one that is far longer than wide little of the sphere lies beside the ends, so that rounding of the chord would count.
      const glm::dmat3 m(record.quadric.object_to_world.matrix());
      const glm::dvec3 normal = glm::cross(m[0], m[1]);
      const double area = glm::length(normal), lengths2 = glm::dot(m[0], m[0]) + glm::dot(m[1], m[1]);
      if (area > 0.1 * lengths2) around.flat = Vec3(normal / area);
    }
    around_.push_back(around);
  }
  device_->attach(scene_.get(), kQuadrics, part_.quadrics.size(), this, {quadric_bounds, quadric_intersect, quadric_occluded});
  device_->check("quadrics");
}

void LoadedPart::add_moving() {
  std::span<const MotionRecord> motions = part_.motions;
  for (std::uint32_t i = 0; i < part_.instances.size(); ++i) {
    const InstanceRecord& record = part_.instances[i];
    const bool moves = !motions.empty() && motions.front().instance == i;
    if (!moves && !inverts_badly(record.to_world.matrix())) continue;
    if (record.prototype >= prototypes_.size() || !prototypes_[record.prototype])
      throw ClusterError("part loaded before its prototype " + std::to_string(record.prototype));
    Moving& m = moving_.emplace_back(Moving{i, prototypes_[record.prototype].get(), Affine(record.to_world.matrix()), {}, {}, {}});
    m.fixed_inverse = m.fixed.inverse();
    for (; !motions.empty() && motions.front().instance == i; motions = motions.subspan(1)) m.moves.push_back(motions.front().transform());
  }
  if (moving_.empty()) return;
  for (Moving& m : moving_) {
    RTCBounds b;
    rtcGetSceneBounds(m.prototype->scene(), &b);
    const Bounds3 box{{b.lower_x, b.lower_y, b.lower_z}, {b.upper_x, b.upper_y, b.upper_z}};
    m.bounds = grown(moved_bounds(m.fixed, m.moves, box));
  }
  device_->attach(scene_.get(), kMoving, moving_.size(), this, {moving_bounds, moving_intersect, moving_occluded});
  device_->check("moving instances");
}

const LoadedPart::Moving* LoadedPart::moving_instance(std::uint32_t instance) const {
  const auto found = std::ranges::lower_bound(moving_, instance, {}, &Moving::instance);
  return found != moving_.end() && found->instance == instance ? &*found : nullptr;
}

void LoadedPart::add_bricks() {
  if (part_.bricks.empty()) return;
  device_->attach(scene_.get(), kBricks, part_.bricks.size(), this, {brick_bounds, brick_intersect, brick_occluded});
  device_->check("bricks");
}

float LoadedPart::collide(std::uint32_t brick, const Vec3& origin, const Vec3& direction, float t_far, const BrickRay& ray,
                          bool shadow, const SceneFunctions& scene) const {
  const BrickRecord& b = part_.bricks[brick];
  if (ray.medium != BrickRay::kAnyMedium && ray.medium != b.medium + 1) return kInfinity;
  if (b.medium >= scene.rates.size()) return kInfinity;
  t_far = std::min(t_far, ray.reach);
  const CollisionRate& rate = scene.rates[b.medium];
  const std::uint64_t number = mix64((std::uint64_t{b.shape} << 32) | b.primitive), key = mix64(ray.key + number);
  Vec2 first{to_unit(static_cast<std::uint32_t>(key >> 32)), to_unit(static_cast<std::uint32_t>(key))};
  if (ray.sequence) first = ray.sequence->get_2d(ray.dimension + static_cast<std::uint32_t>(number));
  const std::size_t n = b.brick.channel_samples(), channel = b.brick.densities == 3 ? ray.channel : 0;
  const auto densities = part_.densities.subspan(b.first_sample + n * channel, n);
  const float collisions = (shadow ? rate.blocking : rate.event)[static_cast<int>(ray.channel)];
  const auto stretches = ray.stretches ? ray.stretches->along(b.medium) : std::span<const MediumStretch>();
  if (stretches.empty()) return track(b.brick, densities, origin, direction, t_far, collisions, first, key);
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const MediumStretch& s = stretches[i];
    if (s.medium != b.medium + 1) continue;
    const std::uint64_t own = mix64(key + i);
    const float t = track(b.brick, densities, origin + s.begin * direction, direction, std::min(s.end, t_far) - s.begin, collisions,
                          {to_unit(static_cast<std::uint32_t>(own >> 32)), to_unit(static_cast<std::uint32_t>(own))}, own);
    if (t < kInfinity) return s.begin + t;
  }
  return kInfinity;
}

void LoadedPart::ids(unsigned geometry, std::uint32_t index, std::uint32_t instance, std::uint32_t& shape,
                     std::uint32_t& primitive) const {
  if (instance != kNone) {
    prototype(instance).ids(geometry, index, kNone, shape, primitive);
    shape += part_.instances[instance].first_shape;
  } else if (geometry == kBricks) {
    shape = part_.bricks[index].shape;
    primitive = part_.bricks[index].primitive;
  } else if (geometry == kTriangles) {
    const MeshChunk& chunk = part_.chunk_of(index);
    shape = chunk.shape;
    primitive = part_.source_primitive(chunk, index);
  } else if (geometry == kCurves) {
    shape = part_.curves.record_of(index).shape;
    primitive = part_.curves.source_primitive(index);
  } else {
    shape = part_.quadrics[index].shape;
    primitive = 0;
  }
}

bool LoadedPart::opaque(unsigned geometry, std::uint32_t index, float u, float v, const Vec3& origin,
                        const Vec3& direction, float t, bool shadow, const SceneFunctions& scene) const {
  if (geometry == kBricks || !scene.alpha) return true;
  if (geometry == kTriangles) {
    const MeshChunk& c = part_.chunk_of(index);
    const std::uint32_t texture = shadow && c.shadow_alpha_texture != kNone ? c.shadow_alpha_texture : c.alpha_texture;
    if (texture == kNone) return true;
    const Triangle tri = part_.triangles[index];
    Vec2 uv{u, v};
    // pbrt's default parametrisation of a triangle without uv: (0,0) (1,0) (1,1)
    Vec2 a{0, 0}, b{1, 0}, d{1, 1};
    if (c.first_uv != kNone) {
      const auto at = [&](std::uint32_t vertex) { return part_.uvs[c.first_uv + vertex - c.first_vertex]; };
      a = at(tri.x), b = at(tri.y), d = at(tri.z);
    }
    uv = (1.f - u - v) * a + u * b + v * d;
    const Vec3 p = (1.f - u - v) * part_.positions[tri.x] + u * part_.positions[tri.y] + v * part_.positions[tri.z];
    return scene.alpha(texture, uv, p).opaque(origin, direction, p);
  }
  if (geometry == kCurves) return curve_is_opaque(index, u, v, origin, direction, shadow, scene);
  const QuadricRecord& q = part_.quadrics[index];
  if (q.alpha_texture == kNone) return true;
  const SurfacePoint s = surface_point(q.quadric, q.flip != 0, origin, direction, t);
  return scene.alpha(q.alpha_texture, s.uv, s.p).opaque(origin, direction, s.p);
}

}  // namespace cloudrenderer
