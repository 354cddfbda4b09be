#include "parts/scene_spool.h"

#include <variant>

#include "shapes/geometry.h"

namespace cloudrenderer {

Placing::Placing(const Transform& start, const std::optional<Motion>& motion, Dialect dialect) {
  if (!motion) {
    fixed = start;
    return;
  }
  using Way = AnimatedTransform::Interpolates;
  moves.push_back({start.matrix(), motion->end.matrix(), motion->start_time, motion->end_time, 0,
                   dialect == Dialect::v2 ? Way::inverse : Way::forward});
}

Placing operator*(const Placing& a, const Placing& b) {
  Placing out = a;
  if (a.moves.empty())
    out.fixed = a.fixed * b.fixed;
  else if (!b.fixed.is_identity())  // between two movements: one that goes nowhere
    out.moves.push_back({b.fixed.matrix(), b.fixed.matrix(), 0, 0, 0, AnimatedTransform::Interpolates::forward});
  out.moves.insert(out.moves.end(), b.moves.begin(), b.moves.end());
  return out;
}

Bounds3 world_box(const Placing& placing, const Bounds3& box) {
  if (placing.moves.empty()) return grown(box.transformed(placing.fixed));
  std::vector<AnimatedTransform> moves;
  for (const MotionRecord& m : placing.moves) moves.push_back(m.transform());
  return grown(moved_bounds(placing.fixed_in_double(), moves, box));
}

SceneSpool::SceneSpool(const std::string& folder, double flatten_bytes, Warnings& warnings)
    : flatten_bytes_(flatten_bytes), warnings_(warnings), spool_(folder), instances_(folder), motions_(folder), grids_(folder) {}

void SceneSpool::begin_object(ObjectId id, const std::string& name) {
  open_ = id;
  if (prototype_of_.try_emplace(id, static_cast<std::uint32_t>(prototypes_.size())).second)
    prototypes_.emplace_back().name = name;
}

void SceneSpool::end_object(ObjectId) { open_ = ObjectId(); }

PrototypeSpool* SceneSpool::open_prototype() {
  return open_ ? &prototypes_[prototype_of_.at(open_)] : nullptr;
}

std::uint32_t SceneSpool::take_ids(PrototypeSpool* owner, std::uint32_t count,
                                   const FileLocation& location) {
  std::uint32_t& next = owner ? owner->shape_count : next_shape_;
  if (count >= kNone - next)
    throw SceneError(location, "more than 2^32 shapes, instanced ones counted");
  const std::uint32_t first = next;
  next += count;
  return first;
}

std::uint32_t SceneSpool::texture_index(const ShapeDesc& shape, const char* name,
                                        const SceneDescription& scene) {
  for (; textures_seen_ < scene.textures.size(); ++textures_seen_)
    texture_of_.insert_or_assign(scene.textures[textures_seen_].name,
                                 static_cast<std::uint32_t>(textures_seen_));
  const std::optional<std::string> texture = shape.params.texture(name);
  if (!texture) return kNone;
  const auto found = texture_of_.find(*texture);
  if (found == texture_of_.end()) {
    warnings_.add(shape.location,
                  "no texture \"" + *texture + "\"; the shape has no " + name + " mask");
    return kNone;
  }
  return found->second;
}

void SceneSpool::add_row(PrototypeSpool& owner, std::uint32_t number, const ShapeRow& row) {
  if (number == kNone) return;
  owner.rows.push_back(number);
  owner.box.extend(row.box);
  owner.bytes += row.bytes();
}

void SceneSpool::shape(ShapeDesc&& shape, const SceneDescription& scene) {
  const auto found = shape.object ? prototype_of_.find(shape.object) : prototype_of_.end();
  PrototypeSpool* owner = found == prototype_of_.end() ? nullptr : &prototypes_[found->second];
  ShapeRow row;
  const std::uint32_t id = take_ids(owner, 1, shape.location);
  row.shape = id;
  row.prototype = owner ? found->second : kNone;
  std::optional<Placing> placing;
  if (shape.motion) {  // as in pbrt: the shape stands in a space of its own, which moves
    placing.emplace(shape.object_to_world, shape.motion, scene.dialect);
    shape.object_to_world = {};
    row.shape = 0;
    row.prototype = static_cast<std::uint32_t>(prototypes_.size());
  }
  row.material = shape.material.value;
  row.flip = shape.reverse_orientation != shape.object_to_world.swaps_handedness() ? 1 : 0;
  const bool emits = shape.area_light && !placing;
  if (emits) row.light = static_cast<std::uint32_t>(shape_lights_.size());

  const ShapeGeometry geometry = make_geometry(shape, scene.dialect, warnings_);
  std::uint32_t added = kNone;
  row.alpha_texture = texture_index(shape, "alpha", scene);
  row.shadow_alpha_texture = texture_index(shape, "shadowalpha", scene);
  // A constant mask of 0 hides the shape altogether.
  if (const Param* alpha = shape.params.find("alpha");
      alpha && row.alpha_texture == kNone && alpha->reals.size() == 1 && alpha->reals[0] == 0.f)
    return;
  std::uint64_t dropped = 0;
  if (const auto* mesh = std::get_if<TriangleMesh>(&geometry)) {
    added = spool_.add_mesh(row, mesh->positions.view(), mesh->normals.view(), mesh->uvs.view(),
                            mesh->triangles.view(), dropped);
    if (dropped > 0)
      warnings_.add(shape.location,
                    std::to_string(dropped) +
                        " triangles have vertices that are not finite; they are left out");
  } else if (const auto* curve = std::get_if<CurveChain>(&geometry)) {
    added = spool_.add_curve(row, *curve, dropped);
    if (dropped > 0) warnings_.add(shape.location, std::to_string(dropped) + " segments of the curve are not finite; they are left out");
    if (emits && !warned_emissive_curve_) {
      warnings_.add(shape.location, "curves that emit light are found by rays that hit them only, which is noisy");
      warned_emissive_curve_ = true;
    }
  } else {
    added = spool_.add_quadric(row, std::get<Quadric>(geometry));
    if (added == kNone) warnings_.add(shape.location, "the shape is not finite; it is left out");
  }
  if (added == kNone) return;
  shape.params.report_unused("Shape \"" + shape.type + "\"", warnings_, &warned_parameters_);
  if (emits) shape_lights_.push_back(shape.area_light);
  if (placing) {
    PrototypeSpool own;
    own.name = shape.type;
    own.is_shape = true;
    own.shape_count = 1;
    add_row(own, added, row);
    own.whole_box = row.box;
    if (owner) owner->whole_box.extend(world_box(*placing, row.box));
    const std::uint32_t outer = owner ? found->second : kNone;
    prototypes_.push_back(std::move(own));  // moves what `owner` points to
    if (outer == kNone)
      add_instance(*placing, row.prototype, id);
    else
      prototypes_[outer].nested.push_back({row.prototype, *placing, id});
  } else if (owner) {
    add_row(*owner, added, row);
    owner->whole_box.extend(row.box);
  } else {
    bounds_.extend(row.box);
  }
}

void SceneSpool::add_instance(const Placing& placing, std::uint32_t prototype, std::uint32_t first_shape) {
  for (MotionRecord m : placing.moves) {
    m.instance = static_cast<std::uint32_t>(instances_.size());
    motions_.push_back(m);
  }
  instances_.push_back({placing.fixed, prototype, first_shape});
  const Bounds3& box = prototypes_[prototype].whole_box;
  if (!box.empty()) bounds_.extend(world_box(placing, box));
}

void SceneSpool::instance(const InstanceDesc& instance, const SceneDescription& scene) {
  const auto found = prototype_of_.find(instance.object);
  if (found == prototype_of_.end() || instance.object == open_) {
    warnings_.add(instance.location, "instance of an object that is not complete; it is left out");
    return;
  }
  const std::uint32_t index = found->second;
  const bool usable = is_finite(instance.instance_to_world.point({1, 1, 1})) &&
                      instance.instance_to_world.is_invertible();
  if (!usable)
    warnings_.add(instance.location, "an instance's transform is singular; it is left out");
  const Placing placing(instance.instance_to_world, instance.motion, scene.dialect);
  if (PrototypeSpool* outer = open_prototype()) {
    if (usable) nest(*outer, index, instance, placing);
    return;
  }
  const std::uint32_t first = take_ids(nullptr, prototypes_[index].shape_count, instance.location);
  if (usable) add_instance(placing, index, first);
}

void SceneSpool::nest(PrototypeSpool& outer, std::uint32_t inner_index,
                      const InstanceDesc& instance, const Placing& to_outer) {
  const PrototypeSpool& inner = prototypes_[inner_index];
  const std::uint32_t first = take_ids(&outer, inner.shape_count, instance.location);
  if (!inner.whole_box.empty()) outer.whole_box.extend(world_box(to_outer, inner.whole_box));
  if (to_outer.moves.empty() && outer.bytes + inner.bytes <= flatten_bytes_) {
    const Spool::View view = spool_.map();
    for (const std::uint32_t r : inner.rows) {
      const ShapeRow source = view.rows[r];
      ShapeRow row;
      row.shape = first + source.shape;
      row.prototype = prototype_of_.at(open_);
      const std::uint32_t number = spool_.add_moved(view, source, to_outer.fixed, row);
      add_row(outer, number, row);
    }
  } else {
    outer.nested.push_back({inner_index, to_outer, first});
  }
  for (const PrototypeSpool::Nested& n : inner.nested)
    outer.nested.push_back({n.prototype, to_outer * n.to_object, first + n.first_shape});
}

}  // namespace cloudrenderer
