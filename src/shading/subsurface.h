#pragma once
// Light below surfaces: the medium inside a material, and what of the light that enters comes out again.
#include <array>
#include <cstdint>
#include <vector>

#include "shading/bsdf.h"

namespace cloudrenderer {

// A homogeneous medium, as a path takes it along from the point where it entered.
struct InteriorMedium {
  Rgb sigma_a{0}, sigma_s{0};  // a unit of length
  float g = 0;                 // of Henyey and Greenstein's phase function

  // In 16 bytes: coefficients to within 2^-13, of which a sigma_a of 0 stays exact; g as rounded_g() gives it.
  std::array<std::uint32_t, 4> pack() const;
  static InteriorMedium unpack(const std::array<std::uint32_t, 4>& bits);
};
// The nearest g that pack() keeps; sigma_s is changed so that sigma_s (1 - g) stays (similarity, van de Hulst 1980).
InteriorMedium rounded_g(InteriorMedium m);

// A point of a surface with a medium inside.
struct SubsurfacePoint {
  InteriorMedium medium;
  Lobe boundary;   // as light inside that has not been scattered yet meets it: a dielectric that absorbs nothing
  float eta = 1;   // index inside over outside
  // Of scattered light that comes to the surface: pbrt-v2's share that passes, which leaves a matte surface; 0: by Fresnel's
  // formulas.
  float matte_exit = 0;
};

// Which share of the light that has entered a half-space of an isotropic medium leaves it again, for light from all
// sides (cosine weighted), and the other way round. Exact but for quadrature: Chandrasekhar, "Radiative Transfer" (1960),
// chapters IV and V (law of diffuse reflection by his H function), with a boundary that reflects light back inside by
// Fresnel's formulas.
class HalfSpaceAlbedo {
 public:
  // eta_entry: index by which light is refracted when it enters; eta_exit: for which it is reflected inside.
  HalfSpaceAlbedo(float eta_entry, float eta_exit);
  double reflectance(double single_scattering_albedo) const;
  // The single scattering albedo for this reflectance in [0, 1].
  float single_scattering(float reflectance) const;

 private:
  struct Node {
    double cosine, weight;
    double entering;   // radiance
    double reflected;  // share
  };
  std::vector<Node> nodes_;
  std::vector<double> table_;  // reflectances at even steps of sqrt(1 - albedo)
};

namespace bsdf {
// Share of even light from one side that a smooth dielectric lets through; eta: index beyond over that on the light's side.
float diffuse_transmittance(float eta);
// Light that leaves a medium after it was scattered in it: as if it came evenly from all sides below the boundary
// (pbrt-v3's and others' assumption; Pharr, Jakob and Humphreys, "Physically Based Rendering", 3rd ed., section 11.4.1).
// Reflects as much as arrives: what the boundary keeps inside is the walk's affair.
Lobe diffuse_exit(float eta);
}  // namespace bsdf

}  // namespace cloudrenderer
