#pragma once
// The parts that this host holds, ready to be traced: the only place that knows Embree.
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "base/id.h"
#include "parts/part.h"
#include "trace/bvh_form.h"
#include "trace/hit.h"

namespace cloudrenderer {

// Value of an alpha texture at a point of a shape: 0 means "no surface here", and what is between 0 and 1 that there is one,
// or, in pbrt-v4, that so large a part of all rays find one.
struct Alpha {
  Alpha(float v, bool chance = false) : value(v), by_chance(chance) {}  // NOLINT: a number is a mask
  float value;
  bool by_chance;
  // The ray's share is drawn from itself and the point, in one space: the same on any host.
  bool opaque(const Vec3& origin, const Vec3& direction, const Vec3& p) const;
};
using AlphaFunction = std::function<Alpha(std::uint32_t texture, const Vec2& uv, const Vec3& p)>;

// Of the grid media of a scene, by medium: collisions a unit of length and density.
struct CollisionRate {
  Rgb event{0};     // where a path stops
  Rgb blocking{0};  // that end a shadow ray
};

// What a scene says of hits; parts do not know it, so that scenes can share them.
struct SceneFunctions {
  AlphaFunction alpha;               // null: alpha textures are ignored
  std::vector<CollisionRate> rates;  // by grid medium
};

class Device;        // Embree's device with its memory counter
class LoadedPart;    // one part or prototype with its BVH
class JointScene;    // several parts under one tree
class PartCache;     // loaded parts that several scenes share
struct PartKey;

// What is resident at one moment. Immutable: tracing takes a snapshot per batch and no lock.
class ResidentSet {
 public:
  bool has(std::uint32_t part) const { return part < parts_.size() && parts_[part] != nullptr; }
  const Part& part(std::uint32_t part) const;
  const Part& prototype(std::uint32_t part, std::uint32_t instance) const;
  // Where an instance is at a time: its record's own transformation, or, if it moves, `moved`, which is filled in.
  const Transform& place(std::uint32_t part, std::uint32_t instance, float time, Transform& moved) const;

  // Whether rays are rounded no more than the points of the instance when they are taken into its space.
  bool enters_exactly(std::uint32_t part, std::uint32_t instance) const;

  // Nearest hit in one part with t <= hit.t that comes before `hit` in the order (t, shape, primitive); updates hit
  // and returns true if there is one. The ray is traceable().
  bool intersect(std::uint32_t part, const TraceRay& ray, Hit& hit) const;
  // The same for up to 8 rays; active: bit mask. hits[i] are updated. The same bits as ray by ray.
  void intersect8(std::uint32_t part, const RayPacket& rays, std::uint32_t active, Coherence coherence, Hit* hits) const;
  // Anything of the part within (0, ray.t_max)?
  bool occluded(std::uint32_t part, const TraceRay& ray) const;
  // Bit mask of the active rays that are blocked.
  std::uint32_t occluded8(std::uint32_t part, const RayPacket& rays, std::uint32_t active) const;

  // The same for parts that are joined under one tree, in one query: those without bricks, where there are two at least.
  // The same bits as part by part, in any order. For rays of which may_join() is true: none starts very far away.
  bool joined(std::uint32_t part) const;
  std::size_t joined_count() const;  // 0: none are
  bool may_join(const RayPacket& rays) const;
  void intersect_joined8(const RayPacket& rays, std::uint32_t active, Coherence coherence, Hit* hits) const;
  std::uint32_t occluded_joined8(const RayPacket& rays, std::uint32_t active) const;

 private:
  friend class Resident;
  std::vector<std::shared_ptr<const LoadedPart>> parts_;
  std::shared_ptr<const JointScene> joint_;
  std::shared_ptr<const SceneFunctions> scene_;
};

// Loads and drops parts. Any thread; loads of different parts run at the same time.
class Resident {
 public:
  struct Options {
    unsigned threads = 1;       // that join a build
    std::string isa = kEmbreeIsa;
    AlphaFunction alpha;        // null: alpha textures are ignored
    std::shared_ptr<PartCache> cache;  // shared with other scenes; null: threads and isa of one of its own
  };
  explicit Resident(const Options& options);
  ~Resident();
  Resident(const Resident&) = delete;
  Resident& operator=(const Resident&) = delete;

  // Builds the BVH. A part's prototypes must be loaded before it. Returns the bytes now used by it (arrays and BVH).
  // Throws ClusterError when Embree fails (out of memory).
  std::uint64_t load_prototype(std::uint32_t prototype, Part part);
  std::uint64_t load_part(PartId id, Part part, BvhForm form = BvhForm::fast);
  // With a cache: takes what is loaded already, or calls `read` and loads it. `check` looks at what another scene has
  // loaded, and throws when this one cannot use it. True: it was there.
  bool share_prototype(std::uint32_t prototype, const PartKey& key, const std::function<Part()>& read,
                       const std::function<void(const Part&)>& check);
  bool share_part(PartId id, const PartKey& key, BvhForm form, const std::function<Part()>& read,
                  const std::function<void(const Part&)>& check);
  void unload_part(PartId id);
  void unload_prototype(std::uint32_t prototype);  // dropped when the last part that uses it goes
  bool has_prototype(std::uint32_t prototype) const;
  void set_alpha(AlphaFunction alpha);  // before the first load
  void set_collision_rates(std::vector<CollisionRate> rates);  // likewise

  std::uint64_t bytes() const;       // arrays and BVHs now; with a cache, of what this scene holds, others' share included
  double own_bytes() const;          // the same with shared parts divided by their users
  std::uint64_t peak_bytes() const;  // the most that bytes() has been, builds included
  std::shared_ptr<const ResidentSet> snapshot() const;

 private:
  using Loaded = std::shared_ptr<const LoadedPart>;
  Loaded build(Part part, std::vector<Loaded> prototypes, BvhForm form);
  Loaded share(const PartKey& key, BvhForm form, const std::function<Part()>& read, const std::function<void(const Part&)>& check,
               bool& there);
  std::vector<Loaded> prototypes_of(const Part& part) const;
  void put_part(PartId id, Loaded loaded);
  void put_prototype(std::uint32_t prototype, Loaded loaded);
  void exchange(Loaded& place, Loaded& with);  // with the mutex
  void drop(Loaded loaded);  // without the mutex: one that is neither in the set nor among the prototypes any more
  void set_scene(SceneFunctions scene);
  std::vector<Loaded> held() const;

  std::shared_ptr<PartCache> cache_;
  std::shared_ptr<Device> device_;
  std::string isa_;
  // Of its own, so that what a tree over parts takes is not counted as a part's.
  mutable std::shared_ptr<Device> joint_device_;
  mutable std::mutex mutex_;
  std::vector<Loaded> prototypes_;
  ResidentSet now_;
  mutable std::shared_ptr<const ResidentSet> set_;  // what now_ was when a snapshot was last taken; null when it has changed since
  std::uint64_t held_ = 0, held_peak_ = 0;          // bytes of all that is loaded, with a cache
};

// Threads that trace or shade call this once: denormals are zero everywhere alike (Embree wants it, and all hosts
// must agree).
void prepare_compute_thread();

}  // namespace cloudrenderer
