#include "parts/specular_boxes.h"

#include <algorithm>
#include <optional>

#include "scene/material_specular.h"

namespace cloudrenderer {
namespace {

// So many boxes are looked at together.
constexpr std::size_t kHeld = 1 << 16;

// Clusters are made of large ones until there are so many, and then joined.
constexpr std::size_t kFine = 128;

// What an aim at it costs, but for a factor: the section of the sphere around it.
float cost(const Bounds3& b) { return glm::dot(b.diagonal(), b.diagonal()); }

Bounds3 both(Bounds3 a, const Bounds3& b) {
  a.extend(b);
  return a;
}

struct Cluster {
  std::vector<Bounds3> members;
  Bounds3 box;

  explicit Cluster(std::vector<Bounds3> boxes) : members(std::move(boxes)) {
    for (const Bounds3& b : members) box.extend(b);
  }
};

int longest_axis(const Vec3& d) { return d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2; }

// In the middle of the members' centres, or into two halves where all are at one place.
std::vector<Bounds3> split_off(std::vector<Bounds3>& members) {
  Bounds3 centers;
  for (const Bounds3& b : members) centers.extend(b.center());
  const int axis = longest_axis(centers.diagonal());
  const float middle = centers.center()[axis];
  auto cut = std::stable_partition(members.begin(), members.end(), [&](const Bounds3& b) { return b.center()[axis] <= middle; });
  if (cut == members.begin() || cut == members.end()) cut = members.begin() + static_cast<std::ptrdiff_t>(members.size() / 2);
  std::vector<Bounds3> rest(cut, members.end());
  members.erase(cut, members.end());
  return rest;
}

std::vector<Bounds3> fine_boxes(std::vector<Bounds3> boxes, std::size_t most) {
  if (boxes.size() <= most) return boxes;
  std::vector<Cluster> clusters{Cluster(std::move(boxes))};
  while (clusters.size() < most) {
    const auto largest = std::ranges::max_element(clusters, {}, [](const Cluster& c) { return c.members.size() > 1 ? cost(c.box) : -1.f; });
    std::vector<Bounds3> members = std::move(largest->members);
    Cluster other(split_off(members));
    *largest = Cluster(std::move(members));
    clusters.push_back(std::move(other));
  }
  std::vector<Bounds3> out;
  for (const Cluster& c : clusters) out.push_back(c.box);
  return out;
}

// Joins two at a time while that costs nothing, or there are too many.
void join(std::vector<Bounds3>& boxes, std::size_t most) {
  while (boxes.size() > 1) {
    float least = kInfinity;
    std::size_t first = 0, second = 1;
    for (std::size_t i = 0; i < boxes.size(); ++i)
      for (std::size_t j = i + 1; j < boxes.size(); ++j)
        if (const float more = cost(both(boxes[i], boxes[j])) - cost(boxes[i]) - cost(boxes[j]); more < least) {
          least = more;
          first = i;
          second = j;
        }
    if (boxes.size() <= most && least > 0.f) return;
    boxes[first].extend(boxes[second]);
    boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(second));
  }
}

// Halves the costliest ones of those that are long.
void cut(std::vector<Bounds3>& boxes, std::size_t most) {
  const auto half = [](const Bounds3& b) {
    Bounds3 h = b;
    const int axis = longest_axis(b.diagonal());
    h.max[axis] = b.center()[axis];
    return h;
  };
  const auto gain = [&](const Bounds3& b) { return cost(b) - 2 * cost(half(b)); };
  while (boxes.size() < most) {
    const auto best = std::ranges::max_element(boxes, {}, gain);
    if (!(gain(*best) > 0.f)) return;
    const Bounds3 lower = half(*best);
    const int axis = longest_axis(best->diagonal());
    best->min[axis] = lower.max[axis];
    boxes.push_back(lower);
  }
}

}  // namespace

std::vector<Bounds3> few_boxes(std::vector<Bounds3> boxes, std::size_t most) {
  if (boxes.empty()) return boxes;
  std::vector<Bounds3> few = fine_boxes(std::move(boxes), std::max(most, kFine));
  join(few, most);
  cut(few, most);
  return few;
}

std::vector<Bounds3> specular_boxes(const SceneDescription& scene, SceneSpool& spool) {
  const std::vector<bool> specular = maybe_specular(scene);
  if (std::ranges::find(specular, true) == specular.end()) return {};
  std::vector<Bounds3> found;
  const auto add = [&](const Bounds3& box) {
    if (box.empty() || !is_finite(box.min) || !is_finite(box.max)) return;
    found.push_back(box);
    if (found.size() == kHeld) found = fine_boxes(std::move(found), kFine);
  };
  const std::span<const ShapeRow> rows = spool.spool().map().rows;
  const auto counts = [&](const ShapeRow& row) { return row.material < specular.size() && specular[row.material]; };
  for (const ShapeRow& row : rows)
    if (row.prototype == kNone && counts(row)) add(row.box);

  const std::vector<PrototypeSpool>& prototypes = spool.prototypes();
  std::vector<std::optional<Bounds3>> boxes(prototypes.size());
  const auto box_of = [&](const auto& self, std::uint32_t p) -> const Bounds3& {
    if (boxes[p]) return *boxes[p];
    Bounds3 box;
    for (const std::uint32_t r : prototypes[p].rows)
      if (counts(rows[r])) box.extend(rows[r].box);
    for (const PrototypeSpool::Nested& n : prototypes[p].nested)
      if (const Bounds3& inner = self(self, n.prototype); !inner.empty()) box.extend(world_box(n.to_object, inner));
    return boxes[p].emplace(box);
  };
  const std::span<const InstanceRecord> instances = spool.instances().map();
  const std::span<const MotionRecord> motions = spool.motions().map();
  for (std::uint32_t n = 0; n < instances.size(); ++n) {
    const Bounds3& box = box_of(box_of, instances[n].prototype);
    if (box.empty()) continue;
    Placing placing(instances[n].to_world);
    const std::span<const MotionRecord> moves = motions_of(motions, n);
    placing.moves.assign(moves.begin(), moves.end());
    add(world_box(placing, box));
  }
  return few_boxes(std::move(found), kMostSpecularBoxes);
}

}  // namespace cloudrenderer
