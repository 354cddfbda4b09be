#pragma once
// Measured reflectances of the RGL database, isotropic and anisotropic (Dupuy and Jakob, "An Adaptive Parameterization
// for Efficient Material Acquisition and Rendering", 2018).
#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "shading/scattering_table.h"
#include "shading/warp_2d.h"

namespace cloudrenderer {

// f cos = S(s) D(m) / (4 sigma(wo)), where m is the half vector and s the point of the unit square that the warp by the
// visible normals takes to m: near a microfacet model S is even, so that a few values are enough. The file's "incident"
// direction is the one that samples are drawn for, wo here, and the cosine is wi's. The same seen from both sides.
//   f is as reciprocal as the measured surface is, up to what is lost between the few angles of wo; pdf() is the
//   density of
// sample(), but for what is sampled below the horizon.
class RglTable final : public ScatteringTable {
 public:
  // Throws SceneError at `where`, the place that names the file: a "tensor file" with the fields theta_i, phi_i, sigma,
  // ndf, vndf, luminance, jacobian, and spectra with wavelengths, or rgb.
  static std::unique_ptr<RglTable> read(const std::string& path, const FileLocation& where);

  Rgb value(const Vec3& wo, const Vec3& wi) const override;
  float pdf(const Vec3& wo, const Vec3& wi) const override;
  Rgb value_and_pdf(const Vec3& wo, const Vec3& wi, float& density) const override;
  bool sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const override;
  float albedo(float cosine) const override;
  std::uint64_t bytes() const override;

  bool isotropic() const { return isotropic_; }

 private:
  struct Viewer;
  struct HalfVector;
  static constexpr std::size_t kAngles = 16;  // of the eye's cosine

  RglTable() = default;
  Viewer viewer(const Vec3& wo) const;
  bool half_vector(const Viewer& v, const Vec3& wi, HalfVector& out) const;
  void tabulate_albedo();

  SliceNodes nodes_;          // phi and theta of wo
  GridStack<float> ndf_;      // D over m
  GridStack<float> sigma_;    // the area that normals show to wo
  Warp2D visible_;            // density of visible normals
  Warp2D luminance_;          // S as a density
  GridStack<Rgb> scattered_;  // S
  bool isotropic_ = true;
  bool jacobian_ = true;  // S is to be multiplied by D / (4 sigma)
  // How often the azimuths of the file go into the circle: 2 is symmetric about the normal, 4 about both axes too. The
  // signs are those of wo's coordinates in the part that is there.
  int folds_ = 1;
  float sign_x_ = 1, sign_y_ = 1;
  std::array<float, kAngles> albedo_{};
};

}  // namespace cloudrenderer
