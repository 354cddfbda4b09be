#include "parts/scene_spool.h"

#include <variant>

#include "shapes/geometry.h"

namespace cloudrenderer {
SceneSpool::SceneSpool(const std::string& folder, double flatten_bytes, Warnings& warnings)
    : flatten_bytes_(flatten_bytes), warnings_(warnings), spool_(folder), instances_(folder), grids_(folder) {}

void SceneSpool::begin_object(ObjectId id, const std::string& name) {
  open_ = id;
  if (prototype_of_.try_emplace(id, static_cast<std::uint32_t>(prototypes_.size())).second)
    prototypes_.push_back({name, {}, {}, 0, {}, 0});
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
  row.shape = take_ids(owner, 1, shape.location);
  row.prototype = owner ? found->second : kNone;
  row.material = shape.material.value;
  row.flip = shape.reverse_orientation != shape.object_to_world.swaps_handedness() ? 1 : 0;
  if (owner && shape.area_light && !warned_emissive_object_) {
    warnings_.add(shape.location, "shapes of an object do not emit light");
    warned_emissive_object_ = true;
  }
  const bool emits = shape.area_light && !owner;
  if (emits) row.light = static_cast<std::uint32_t>(shape_lights_.size());

  const ShapeGeometry geometry = make_geometry(shape, scene.dialect, warnings_);
  std::uint32_t added = kNone;
  if (const auto* mesh = std::get_if<TriangleMesh>(&geometry)) {
    row.alpha_texture = texture_index(shape, "alpha", scene);
    row.shadow_alpha_texture = texture_index(shape, "shadowalpha", scene);
    // A constant mask of 0 hides the shape altogether.
    if (const Param* alpha = shape.params.find("alpha");
        alpha && row.alpha_texture == kNone && alpha->reals.size() == 1 && alpha->reals[0] == 0.f)
      return;
    std::uint64_t dropped = 0;
    added = spool_.add_mesh(row, mesh->positions.view(), mesh->normals.view(), mesh->uvs.view(),
                            mesh->triangles.view(), dropped);
    if (dropped > 0)
      warnings_.add(shape.location,
                    std::to_string(dropped) +
                        " triangles have vertices that are not finite; they are left out");
  } else {
    added = spool_.add_quadric(row, std::get<Quadric>(geometry));
    if (added == kNone) warnings_.add(shape.location, "the shape is not finite; it is left out");
  }
  if (added == kNone) return;
  if (emits) shape_lights_.push_back(shape.area_light);
  if (owner) add_row(*owner, added, row);
}

void SceneSpool::instance(const InstanceDesc& instance, const SceneDescription&) {
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
  if (PrototypeSpool* outer = open_prototype()) {
    if (usable) nest(*outer, index, instance);
    return;
  }
  const std::uint32_t first = take_ids(nullptr, prototypes_[index].shape_count, instance.location);
  if (usable) instances_.push_back({instance.instance_to_world, index, first});
}

void SceneSpool::nest(PrototypeSpool& outer, std::uint32_t inner_index,
                      const InstanceDesc& instance) {
  const PrototypeSpool& inner = prototypes_[inner_index];
  const Transform& to_outer = instance.instance_to_world;
  const std::uint32_t first = take_ids(&outer, inner.shape_count, instance.location);
  if (outer.bytes + inner.bytes <= flatten_bytes_) {
    const Spool::View view = spool_.map();
    for (const std::uint32_t r : inner.rows) {
      const ShapeRow source = view.rows[r];
      ShapeRow row;
      row.shape = first + source.shape;
      row.prototype = prototype_of_.at(open_);
      const std::uint32_t number = spool_.add_moved(view, source, to_outer, row);
      add_row(outer, number, row);
    }
  } else {
    outer.nested.push_back({inner_index, to_outer, first});
  }
  for (const PrototypeSpool::Nested& n : inner.nested)
    outer.nested.push_back({n.prototype, to_outer * n.to_object, first + n.first_shape});
}

}  // namespace cloudrenderer
