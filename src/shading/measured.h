#pragma once
// Measured reflectances: tables of isotropic surfaces, the same seen from both sides. Directions
// are unit, in the shading frame (z = normal).
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/sampling.h"
#include "cloudrenderer/math.h"
#include "scene/description.h"
#include "shading/rgl_table.h"
#include "shading/scattering_table.h"

namespace cloudrenderer {

class ReflectanceTable {
 public:
  virtual ~ReflectanceTable() = default;
  // f, without the cosine: finite, >= 0, symmetric. Black where a table says nothing.
  virtual Rgb value(const Vec3& wo, const Vec3& wi) const = 0;
  virtual std::uint64_t bytes() const = 0;
};

// The readers throw SceneError: at the place in the file, or at `where`, which names the file.

// The format of the MERL database (Matusik, Pfister, Brand, McMillan: "A data-driven reflectance
// model", 2003): three numbers of cells and a table over Rusinkiewicz's half and difference angles.
std::unique_ptr<ReflectanceTable> read_merl(const std::string& path, const FileLocation& where);

// pbrt-v2's text format: the number of wavelengths, the wavelengths, then for each measurement
// theta and phi of the light, theta and phi of the eye, and a value a wavelength. Anywhere, in any
// order.
std::unique_ptr<ReflectanceTable> read_irregular_brdf(const std::string& path, Dialect dialect,
                                                      const FileLocation& where);

// A table with what its lobe needs for sampling: half vectors by how much the table reflects about
// them on average, mixed with the cosine, in shares that depend on the eye's angle.
class MeasuredReflectance final : public ScatteringTable {
 public:
  explicit MeasuredReflectance(std::unique_ptr<const ReflectanceTable> table);

  Rgb value(const Vec3& wo, const Vec3& wi) const override { return table_->value(wo, wi); }
  // 0 on the other side of the surface.
  float pdf(const Vec3& wo, const Vec3& wi) const override;
  // u chooses between the two.
  bool sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const override;
  float albedo(float cosine) const override { return albedo_[angle_of(cosine)]; }
  std::uint64_t bytes() const override { return table_->bytes(); }

 private:
  static constexpr std::size_t kCells = 90;   // of the half vector's angle, finer towards 0
  static constexpr std::size_t kAngles = 16;  // of the eye's cosine
  static std::size_t angle_of(float cosine);
  float half_density(const Vec3& h) const;
  float tabulate_half_vectors();
  void tabulate_shares(float diffuse);

  std::unique_ptr<const ReflectanceTable> table_;
  std::array<float, kCells + 1> edges_{};  // 1 - cosine of the half vector's angle
  std::array<float, kCells> density_{};    // by solid angle, within a cell
  Distribution1D cells_;
  std::array<float, kAngles> albedo_{}, mix_{};  // mix_: chance of a half vector
};

// The tables of a scene: a file that several materials name is read once.
class MeasuredStore {
 public:
  // The suffix tells the format: .brdf, else MERL.
  const MeasuredReflectance* get(const std::string& path, Dialect dialect,
                                 const FileLocation& where);
  const ScatteringTable* get_fourier(const std::string& path, const FileLocation& where);
  const RglTable* get_rgl(const std::string& path, const FileLocation& where);
  std::uint64_t bytes() const { return bytes_; }

 private:
  std::map<std::string, std::unique_ptr<const MeasuredReflectance>> files_;
  std::map<std::string, std::unique_ptr<const ScatteringTable>> fourier_;
  std::map<std::string, std::unique_ptr<const RglTable>> rgl_;
  std::uint64_t bytes_ = 0;
};

}  // namespace cloudrenderer
