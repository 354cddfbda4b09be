#pragma once
// Inside src/trace only: a part with its BVH.
#include <array>
#include <memory>
#include <vector>

#include "parts/part_builder.h"
#include "shapes/triangle_hit.h"
#include "trace/embree.h"
#include "trace/resident.h"

namespace cloudrenderer {

// Geometry numbers in every scene: triangles, quadrics, curves, bricks, instances, those that move. A hit has never one of
// the last two, but that of the shape in the instance, and the instance's number as Embree's hits in instances have.
inline constexpr unsigned kTriangles = 0, kQuadrics = 1, kCurves = kCurveHit, kBricks = kBrickHit, kPlaced = 4, kMoving = 5;

class LoadedPart {
 public:
  LoadedPart(std::shared_ptr<Device> device, Part part, std::vector<std::shared_ptr<const LoadedPart>> prototypes, BvhForm form);
  ~LoadedPart();
  LoadedPart(const LoadedPart&) = delete;
  LoadedPart& operator=(const LoadedPart&) = delete;

  const Part& part() const { return part_; }
  const LoadedPart& prototype(std::uint32_t instance) const {
    return *prototypes_[part_.instances[instance].prototype];
  }
  RTCScene scene() const { return scene_.get(); }

  // An instance that moves, or stands still (no moves) where floats could not take rays into its space exactly enough. To
  // Embree it is a primitive of a user geometry, whose rays we take into its space one by one, in double: packets and
  // single rays find the same bits, and shading has exactly the transformation that traced.
  struct Moving {
    std::uint32_t instance = 0;
    const LoadedPart* prototype = nullptr;
    Affine fixed, fixed_inverse;
    std::vector<AnimatedTransform> moves;
    Bounds3 bounds;  // over all times
    Transform to_world(float time) const { return placed(fixed, moves, time); }
  };
  static_assert(sizeof(Moving) <= 320, "loaded_bytes::kMotion");
  // An instance that stands still. Not one of Embree's: boxes around these are tested without slack, so that rays pass between
  // two that touch, and its matrices are inverted by an estimate that differs between processors.
  struct Placed {
    std::array<Vec3, 3> axes;  // world to object: o = axes[0] x + axes[1] y + axes[2] z + offset
    Vec3 offset;
    std::uint32_t instance = 0;
    const LoadedPart* prototype = nullptr;
    Bounds3 bounds;
    template <class F>
    Vec3Of<F> turned(const Vec3Of<F>& d, const Vec3Of<F>& from) const {
      const auto one = [&](int i) {
        return lanes::fma(F(axes[0][i]), d.x, lanes::fma(F(axes[1][i]), d.y, lanes::fma(F(axes[2][i]), d.z, from[i])));
      };
      return {one(0), one(1), one(2)};
    }
    // The same operations for one ray and for eight.
    template <class F>
    Vec3Of<F> point(const Vec3Of<F>& p) const { return turned<F>(p, Vec3Of<F>(offset)); }
    template <class F>
    Vec3Of<F> vector(const Vec3Of<F>& d) const { return turned<F>(d, Vec3Of<F>(F(0.f))); }
  };
  static_assert(sizeof(Placed) <= loaded_bytes::kInstanceObject);
  const Placed& placed_instance(std::uint32_t number) const { return placed_[number]; }
  const Moving& moving(std::uint32_t number) const { return moving_[number]; }
  const Moving* moving_instance(std::uint32_t instance) const;  // null: one that stands still
  std::uint64_t bytes() const { return bytes_; }
  bool has_alpha() const { return has_alpha_; }
  // Curves (curves.cpp): a segment's hit, in the space of the part; its box.
  bool intersect_curve(std::uint32_t segment, const Vec3& origin, const Vec3& direction, float t_min, float t_max,
                       CurveHit& hit) const;
  Bounds3 curve_bounds(std::uint32_t segment) const;
  // True if the ray surely misses the quadric between 0 and t_far: a test in float against a sphere around it, before
  // the exact one in double.
  // F: one ray, or eight in lanes.
  template <class F>
  MaskOf<F> surely_misses(std::uint32_t quadric, const Vec3Of<F>& origin, const Vec3Of<F>& direction, F t_far) const;

  // The part holds a few quadrics and nothing else (a lamp in the main scene): asking whether a ray surely misses them
  // all is cheaper than asking Embree.
  bool few_quadrics() const { return few_quadrics_; }
  template <class F>
  MaskOf<F> surely_misses(const Vec3Of<F>& origin, const Vec3Of<F>& direction, F t_far) const {
    MaskOf<F> misses(true);
    for (std::uint32_t i = 0; i < around_.size(); ++i) misses = misses && surely_misses(i, origin, direction, t_far);
    return misses;
  }

  // Where the ray collides with the brick before t_far, or infinity.
  float collide(std::uint32_t brick, const Vec3& origin, const Vec3& direction, float t_far, const BrickRay& ray, bool shadow,
                const SceneFunctions& scene) const;

  // Global ids of a hit in this part; instance: kNone or an index.
  void ids(unsigned geometry, std::uint32_t index, std::uint32_t instance, std::uint32_t& shape,
           std::uint32_t& primitive) const;
  // False where an alpha texture says that there is no surface; the scene may have none to ask.
  bool opaque(unsigned geometry, std::uint32_t index, float u, float v, const Vec3& origin, const Vec3& direction,
              float t, bool shadow, const SceneFunctions& scene) const;

 private:
  void add_triangles();
  void add_quadrics();
  void add_curves();
  bool curve_is_opaque(std::uint32_t segment, float u, float v, const Vec3& origin, const Vec3& direction, bool shadow,
                       const SceneFunctions& scene) const;
  void add_instances();  // instances.cpp: those that stand still
  void add_moving();
  void add_bricks();

  std::shared_ptr<Device> device_;
  Part part_;
  std::vector<std::shared_ptr<const LoadedPart>> prototypes_;  // by prototype number; those the instances need
  bool has_alpha_ = false, few_quadrics_ = false;
  RTCBuildQuality quality_ = RTC_BUILD_QUALITY_MEDIUM;
  struct BoundingSphere {
    Vec3 center;
    float radius;
    Vec3 flat{0.f};  // of whole disks the unit normal: all of them is in that plane through the center. Else 0
  };
  std::vector<BoundingSphere> around_;  // of each quadric
  std::vector<glm::dmat3> curve_to_object_;  // of each group of curves
  std::vector<Placed> placed_;          // in the order of instances
  std::vector<Moving> moving_;          // likewise
  std::uint64_t shared_bytes_ = 0;  // arrays and objects that Embree's memory monitor does not see
  std::uint64_t bytes_ = 0;
  SceneHandle scene_;
};

template <class F>
MaskOf<F> LoadedPart::surely_misses(std::uint32_t quadric, const Vec3Of<F>& origin, const Vec3Of<F>& direction,
                                    F t_far) const {
  const BoundingSphere& s = around_[quadric];
  const Vec3Of<F> center(s.center), to_center = center - origin;
  // Rounding of the difference, and of what follows, is far below this.
  const Vec3Of<F> size = lanes::abs(center) + lanes::abs(origin);
  const F radius = s.radius + 2e-6f * (size.x + size.y + size.z);
  const F length2 = glm::dot(direction, direction);
  // Most rays pass far aside of a lamp.
  const Vec3Of<F> across = glm::cross(to_center, direction);
  const MaskOf<F> far = glm::dot(across, across) > radius * radius * length2;
  if (!lanes::any(!far)) return far;
  const F nearest = glm::dot(to_center, direction) / length2;
  const Vec3Of<F> off = to_center - nearest * direction;
  const F half_chord2 = radius * radius - glm::dot(off, off);
  const MaskOf<F> aside = half_chord2 < 0.f;
  if (!lanes::any(!aside)) return aside;
  const F half_chord = lanes::sqrt(half_chord2 / length2);
  // Written so that NaN (overflow) is no miss.
  const MaskOf<F> misses = aside || nearest - half_chord > t_far || nearest + half_chord < 0.f;
  if (s.flat == Vec3(0.f) || !lanes::any(!misses)) return misses;
  // Both ends of what is within the sphere are on the same side of the plane, by more than rounding can do.
  const Vec3Of<F> normal(s.flat);
  const F height = -glm::dot(normal, to_center), rate = glm::dot(normal, direction);
  const F first = height + lanes::max(nearest - half_chord, F(0.f)) * rate, last = height + lanes::min(nearest + half_chord, t_far) * rate;
  const F slack = radius - s.radius + 2e-6f * s.radius;
  return misses || (first > slack && last > slack) || (first < -slack && last < -slack);
}

class JointScene;

// What the filter and the user geometry find behind Embree's context while one query runs.
struct QueryContext {
  RTCIntersectContext embree;  // first: Embree hands us its address
  const LoadedPart* part = nullptr;   // what is traced: one part,
  const JointScene* joint = nullptr;  // or several:
  std::uint32_t member = 0;           // which of them the rays are in
  const LoadedPart::Placed* placed = nullptr;  // the instance that they are in, if it stands still
  const SceneFunctions* scene = nullptr;
  // Embree's rays run beside the true ones, see each_beside(): only triangles count, by where the true ray meets them.
  bool beside = false;
  const BrickRay* bricks = nullptr;  // of a single ray
  // The best hit so far of each lane (one lane for single rays), in terms of the part being traced; a hit of another
  // part or host has instance = geometry = kForeign and its global ids in shape, primitive.
  struct Lane {
    float t;
    std::uint32_t geometry, index, instance, shape, primitive;
    float u, v;  // unset if unsettled or foreign
    std::uint32_t member;  // of the joint scene, where one is traced
  };
  Lane* lanes = nullptr;
  std::uint32_t unsettled = 0;  // a bit a lane: t of its hit is Embree's, u and v are not set yet, see settle()
  const TraceRay* ray = nullptr;  // what the query asked: one of these two
  const RayPacket* packet = nullptr;
  // The ray of a lane, in the space of the part being traced.
  Vec3 origin(unsigned lane) const { return ray ? ray->origin : lanes::get(packet->origin, lane); }
  Vec3 direction(unsigned lane) const { return ray ? ray->direction : lanes::get(packet->direction, lane); }
  float t_max(unsigned lane) const { return ray ? ray->t_max : lanes::get(packet->t_max, lane); }
  const float* times = nullptr;  // of each lane; null: 0
};
// Where a ray must end so that a hit at t is still offered: Embree's distance of it may be larger by rounding, and the box of
// a triangle that ties at a vertex may begin behind the computed distance of that vertex, by more than the few ulps that
// its robust box test forgives.
template <class F>
F reach(F t) {
  return t * (1.f + 0x1p-16f);
}

inline constexpr std::uint32_t kForeign = 0xfffffffeu;

// Where shadow rays end: a triangle between here and t_max does not count, so that which ones do need not be asked of
// Embree's distances, which differ between processors (triangle_hit.h). Lamps' rays end nearer than this before them.
inline float occlusion_end(float t_max) {
  return t_max * (1.f - 2 * kEmbreeError);
}

// Gives a triangle's hit the distance and barycentrics that count. The ray is in the space of `part`.
void settle(const LoadedPart& part, const Vec3& origin, const Vec3& direction, QueryContext::Lane& hit);

inline const SceneFunctions& scene_of(const RTCIntersectContext* context) {
  return *reinterpret_cast<const QueryContext*>(context)->scene;
}

inline bool is_beside(const RTCIntersectContext* context) { return reinterpret_cast<const QueryContext*>(context)->beside; }

void intersect_filter(const RTCFilterFunctionNArguments* args);
void occluded_filter(const RTCFilterFunctionNArguments* args);

}  // namespace cloudrenderer
