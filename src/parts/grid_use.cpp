#include "parts/grid_use.h"

namespace cloudrenderer {
namespace {

struct MediumUse {
  bool used = false, everywhere = false;  // not only within `box`
  bool inside = false;                    // of some surface
  bool walled = true;                     // has only surfaces that shadow rays pass, and every host has
  Bounds3 box;                            // of the surfaces that have it
};

std::vector<MediumUse> media_in_use(const SceneDescription& scene, std::span<const ShapeRow> rows, const std::vector<bool>& lifted) {
  std::vector<MediumUse> uses(scene.media.size());
  if (scene.dialect == Dialect::v2)
    for (MediumUse& use : uses) use = {true, true, true, false, {}};
  if (scene.camera.medium && scene.camera.medium.value < uses.size()) uses[scene.camera.medium.value] = {true, true, true, true, {}};
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const ShapeRow& row = rows[r];
    if (row.material >= scene.materials.size() || (r < lifted.size() && lifted[r])) continue;
    const MaterialDesc& material = scene.materials[row.material];
    for (const MediumId m : {material.inside, material.outside}) {
      if (!m || m.value >= uses.size()) continue;
      uses[m.value].used = true;
      uses[m.value].inside = uses[m.value].inside || m == material.inside;
      uses[m.value].walled = uses[m.value].walled && material.type == "none" && row.prototype == kNone;
      if (row.prototype == kNone)
        uses[m.value].box.extend(row.box);
      else
        uses[m.value].everywhere = true;  // where its instances stand is not looked at
    }
  }
  for (MediumUse& use : uses) use.everywhere = use.everywhere || (use.used && !use.inside);  // around surfaces: without end
  return uses;
}

}  // namespace

std::vector<std::uint32_t> clip_bricks(const SceneDescription& scene, std::span<const ShapeRow> rows, const std::vector<bool>& lifted,
                                       std::span<SpooledBrick> bricks, Warnings& warnings) {
  const std::vector<MediumUse> uses = media_in_use(scene, rows, lifted);
  std::vector<Bounds3> boxes(uses.size());
  std::vector<std::uint32_t> bounded;
  for (const SpooledBrick& b : bricks) boxes.at(b.record.medium).extend(b.box);
  for (std::size_t m = 0; m < uses.size(); ++m) {
    if (boxes[m].empty()) continue;
    if (uses[m].used && uses[m].inside && uses[m].walled) bounded.push_back(static_cast<std::uint32_t>(m));
    if (uses[m].everywhere) continue;
    const FileLocation& where = scene.media[m].location;
    const Vec3 little = 0.01f * boxes[m].diagonal();
    const Bounds3& around = uses[m].box;
    if (!uses[m].used)
      warnings.add(where, "no surface and no camera is in this medium: its grid is not loaded");
    else if (!uses[m].walled && (glm::any(glm::greaterThan(around.min, boxes[m].min + little)) || glm::any(glm::lessThan(around.max, boxes[m].max - little))))
      warnings.add(where, "the surfaces that bound this medium are smaller than the box of its grid: it shades lights in the whole box around them");
  }
  for (SpooledBrick& b : bricks) {
    const MediumUse& use = uses[b.record.medium];
    if (use.everywhere) continue;
    DensityBrick& brick = b.record.brick;
    // What the surfaces' own rounding may reach.
    const Vec3 margin = 1e-4f * use.box.diagonal();
    const Bounds3 box = use.used ? Bounds3{use.box.min - margin, use.box.max + margin}.transformed(brick.object_to_world.inverse()) : Bounds3{};
    brick.low = glm::max(brick.low, box.min);
    brick.high = glm::min(brick.high, box.max);
    b.box = Bounds3{brick.low, brick.high}.empty() ? Bounds3{} : brick_box(brick);
  }
  return bounded;
}

}  // namespace cloudrenderer
