#include <filesystem>

#include "shading/material_kinds.h"
#include "shading/measured.h"

namespace cloudrenderer {
namespace {

// "measured" of pbrt-v2 and v4: a table of reflectances from a file.
class Measured final : public Material {
 public:
  explicit Measured(const ScatteringTable& reflectance) : reflectance_(reflectance) {}
  void add_lobes(const TexturePoint&, LobeSink& out) const override {
    out.add(bsdf::measured(reflectance_));
  }

 private:
  const ScatteringTable& reflectance_;  // the MeasuredStore's
};

// pbrt-v3's "fourier": both sides from a file. Without one it is black, as in pbrt-v3.
class Fourier final : public Material {
 public:
  explicit Fourier(const ScatteringTable* table) : table_(table) {}
  void add_lobes(const TexturePoint&, LobeSink& out) const override {
    if (table_) out.add(bsdf::fourier(*table_));
  }

 private:
  const ScatteringTable* table_;  // the MeasuredStore's
};

}  // namespace

std::unique_ptr<Material> make_fourier(MaterialInputs& in) {
  const std::string path = in.params.params().string("bsdffile", "");
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    in.params.warn(path.empty() ? "the fourier material needs a \"string bsdffile\"; without it is black"
                                : "cannot read \"" + path + "\": the fourier material is black");
    return std::make_unique<Fourier>(nullptr);
  }
  return std::make_unique<Fourier>(
      in.measured.get_fourier(path, in.params.params().find("bsdffile")->location));
}

std::unique_ptr<Material> make_measured(MaterialInputs& in) {
  if (const Param* rgl = in.params.params().find("bsdffile")) {  // pbrt-v4's
    const RglTable& table = *in.measured.get_rgl(in.params.params().string("bsdffile", ""), rgl->location);
    in.tangents = !table.isotropic();
    return std::make_unique<Measured>(table);
  }
  const std::string path = in.params.params().string("filename", "");
  if (path.empty())
    throw SceneError(in.params.location(), "the measured material needs a \"string filename\"");
  return std::make_unique<Measured>(
      *in.measured.get(path, in.params.dialect(), in.params.params().find("filename")->location));
}

}  // namespace cloudrenderer
