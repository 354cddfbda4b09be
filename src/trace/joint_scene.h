#pragma once
// Inside src/trace only: several parts under one tree of Embree's.
#include <memory>
#include <span>
#include <vector>

#include "trace/loaded_part.h"

namespace cloudrenderer {

// Of what is resident, the parts without bricks, which single rays only collide with. A packet goes through all of them in one
// query, nearest first. Immutable; any thread.
class JointScene {
 public:
  // parts: by number, null where not resident. Null if there are fewer than two to join.
  static std::shared_ptr<const JointScene> build(std::shared_ptr<Device> device, std::span<const std::shared_ptr<const LoadedPart>> parts);

  RTCScene scene() const { return scene_.get(); }
  bool has(std::uint32_t part) const { return part < has_.size() && has_[part]; }
  std::size_t count() const { return members_.size(); }
  // By the number that the context of a query has while it is in there.
  const LoadedPart& member(std::uint32_t number) const { return *members_[number].loaded; }
  std::uint32_t part(std::uint32_t number) const { return members_[number].part; }
  const Bounds3& bounds(std::uint32_t number) const { return members_[number].bounds; }
  // Whether rays that start so far out are sure to find the boxes that they enter.
  bool is_near(const Vec3x8& origin) const {
    const Vec3x8 o = lanes::abs(origin);
    return lanes::none(!(lanes::max(o.x, lanes::max(o.y, o.z)) <= farthest_));
  }

 private:
  struct Member {
    std::uint32_t part;
    std::shared_ptr<const LoadedPart> loaded;
    Bounds3 bounds;  // wider than they are
  };
  std::shared_ptr<Device> device_;
  std::vector<Member> members_;
  std::vector<bool> has_;
  float farthest_ = 0;
  SceneHandle scene_;
};

}  // namespace cloudrenderer
