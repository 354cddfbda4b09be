#include "shading/material_kinds.h"
#include "shading/measured.h"

namespace cloudrenderer {
namespace {

// pbrt-v2's "measured": a table of reflectances from a file.
class Measured final : public Material {
 public:
  explicit Measured(const MeasuredReflectance& reflectance) : reflectance_(reflectance) {}
  void add_lobes(const TexturePoint&, LobeSink& out) const override {
    out.add(bsdf::measured(reflectance_));
  }

 private:
  const MeasuredReflectance& reflectance_;  // the MeasuredStore's
};

}  // namespace

std::unique_ptr<Material> make_measured(MaterialInputs& in) {
  const std::string path = in.params.params().string("filename", "");
  if (path.empty())
    throw SceneError(in.params.location(), "the measured material needs a \"string filename\"");
  return std::make_unique<Measured>(
      *in.measured.get(path, in.params.dialect(), in.params.params().find("filename")->location));
}

}  // namespace cloudrenderer
