#pragma once
// Files of the RGL database's format whose BRDFs are formulas, fitted as Dupuy and Jakob (2018) fit measurements.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "cloudrenderer/math.h"
#include "shading/rgl_table.h"
#include "shading/warp_2d.h"

namespace cloudrenderer::testing {

// The container: named arrays, little-endian.
class TensorFile {
 public:
  void add(const std::string& name, std::vector<std::uint64_t> shape, const std::vector<float>& values) {
    fields_.push_back({name, std::move(shape), 10,
                       std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float))});
  }
  void add(const std::string& name, const std::string& bytes) { fields_.push_back({name, {bytes.size()}, 1, bytes}); }

  std::string bytes() const {
    std::string head("tensor_file\0\1\0", 14), data;
    put(head, static_cast<std::uint32_t>(fields_.size()));
    std::size_t offset = head.size();
    for (const auto& f : fields_) offset += 2 + f.name.size() + 2 + 1 + 8 + 8 * f.shape.size();
    for (const auto& f : fields_) {
      put(head, static_cast<std::uint16_t>(f.name.size()));
      head += f.name;
      put(head, static_cast<std::uint16_t>(f.shape.size()));
      put(head, f.type);
      put(head, static_cast<std::uint64_t>(offset + data.size()));
      for (const std::uint64_t s : f.shape) put(head, s);
      data += f.bytes;
    }
    return head + data;
  }

 private:
  struct Field {
    std::string name;
    std::vector<std::uint64_t> shape;
    std::uint8_t type;
    std::string bytes;
  };
  template <class T>
  static void put(std::string& out, const T& v) {
    out.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  std::vector<Field> fields_;
};

// Facets of Trowbridge and Reitz that mirror by Schlick's approximation, over a diffuse share.
struct RglFormula {
  double alpha_x = 0.3, alpha_y = 0.3, diffuse = 0, gloss = 1;
  int thetas = 8, phis = 1, folds = 1;  // phis: 1 or 2 is isotropic
  int fine = 64, coarse = 24;           // nodes a side of the tables of normals, and of S
  bool rgb = false, jacobian = true;
  std::vector<float> wavelengths{380, 460, 520, 580, 640, 720};

  static constexpr double kPiDouble = 3.14159265358979323846;
  static double reflectance(double nanometres) { return 0.9 - 0.6 / (1 + std::exp((nanometres - 560) / 40)); }

  // Of normals, by area of the surface seen from above.
  double facets(const glm::dvec3& m) const {
    const double x = m.x / alpha_x, y = m.y / alpha_y, t = x * x + y * y + m.z * m.z;
    return 1 / (kPiDouble * alpha_x * alpha_y * t * t);
  }
  double slopes(const glm::dvec3& w) const {  // Smith's Lambda
    const double x = w.x * alpha_x, y = w.y * alpha_y;
    return 0.5 * (std::sqrt(1 + (x * x + y * y) / (w.z * w.z)) - 1);
  }
  double projected_area(const glm::dvec3& w) const { return w.z * (1 + slopes(w)); }
  // f with a Fresnel term that is r along the normal
  double value(const glm::dvec3& wo, const glm::dvec3& wi, double r) const {
    if (!(wo.z > 0 && wi.z > 0)) return 0;
    const glm::dvec3 m = glm::normalize(wo + wi);
    const double f = r + (1 - r) * std::pow(1 - glm::dot(wo, m), 5);
    return gloss * f * facets(m) / ((1 + slopes(wo) + slopes(wi)) * 4 * wo.z * wi.z) + diffuse * r / kPiDouble;
  }

  static glm::dvec3 polar(double theta, double phi) {
    return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
  }
  // What a point of the tables of directions stands for.
  static double theta_at(double x) { return x * x * kPiDouble / 2; }
  static double phi_at(double y) { return (2 * y - 1) * kPiDouble; }

  template <class F>
  static std::vector<float> table(int columns, int rows, F value) {
    std::vector<float> out;
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i)
        out.push_back(
            static_cast<float>(value(static_cast<double>(i) / (columns - 1), static_cast<double>(j) / (rows - 1))));
    return out;
  }

  // The angles of wo that the file has.
  double theta(int i) const { return thetas > 1 ? theta_at(0.985 * i / (thetas - 1)) : 0; }
  double phi(int i) const { return phis > 1 ? -kPiDouble + 2 * kPiDouble / folds * i / (phis - 1) : 0; }

  std::string bytes() const {
    const auto size = [](int n) { return static_cast<std::uint64_t>(n); };
    std::vector<float> thetas_here, phis_here;
    for (int i = 0; i < thetas; ++i) thetas_here.push_back(static_cast<float>(theta(i)));
    for (int i = 0; i < phis; ++i) phis_here.push_back(static_cast<float>(phi(i)));
    const auto d = table(fine, fine, [&](double x, double y) { return facets(polar(theta_at(x), phi_at(y))); });
    const auto area = table(fine, fine, [&](double x, double y) {
      return projected_area(polar(std::min(theta_at(x), 1.5707), phi_at(y)));
    });
    const GridStack<float> ndf(size(fine), size(fine), d), sigma(size(fine), size(fine), area);

    const std::size_t planes = rgb ? 3 : wavelengths.size(), plane = size(coarse) * size(coarse);
    std::vector<float> vndf, luminance, spectra;
    for (const float p : phis_here)
      for (const float t : thetas_here) {
        const glm::dvec3 wo = polar(static_cast<double>(t), phis > 2 ? static_cast<double>(p) : 0);
        const auto visible = table(fine, fine, [&](double x, double y) {
          const glm::dvec3 m = polar(theta_at(x), phi_at(y));
          return facets(m) * std::max(0.0, glm::dot(wo, m)) * x * std::sin(theta_at(x));
        });
        vndf.insert(vndf.end(), visible.begin(), visible.end());
        const Warp2D warp(size(fine), size(fine), visible);
        const float area_seen = sigma.value(
            {std::sqrt(t / (kPi / 2)), static_cast<float>(std::atan2(wo.y, wo.x) / (2 * kPiDouble) + 0.5)}, {});
        // f cos where the warp leads, over the density that comes from the normals alone
        const auto scattered = [&](double x, double y, double r, bool over_normals) {
          float ignored;
          const Vec2 at = warp.sample(Vec2(static_cast<float>(x), static_cast<float>(y)), {}, ignored);
          const glm::dvec3 m = polar(theta_at(static_cast<double>(at.x)), phi_at(static_cast<double>(at.y))),
                           wi = 2 * glm::dot(wo, m) * m - wo;
          return value(wo, wi, r) * wi.z * (over_normals ? static_cast<double>(4 * area_seen / ndf.value(at, {})) : 1);
        };
        const auto bright = table(coarse, coarse, [&](double x, double y) { return scattered(x, y, 0.6, true); });
        luminance.insert(luminance.end(), bright.begin(), bright.end());
        for (std::size_t k = 0; k < planes; ++k) {
          const double r = rgb ? 0.9 - 0.3 * static_cast<double>(k) : reflectance(static_cast<double>(wavelengths[k]));
          const auto color = table(coarse, coarse, [&](double x, double y) { return scattered(x, y, r, jacobian); });
          spectra.insert(spectra.end(), color.begin(), color.end());
        }
      }
    const std::uint64_t p = size(phis), t = size(thetas), n = size(fine), c = size(coarse);
    if (spectra.size() != p * t * planes * plane) return "";
    TensorFile file;
    file.add("description", "a formula");
    file.add("phi_i", {p}, phis_here);
    file.add("theta_i", {t}, thetas_here);
    file.add("sigma", {n, n}, area);
    file.add("ndf", {n, n}, d);
    file.add("vndf", {p, t, n, n}, vndf);
    file.add("luminance", {p, t, c, c}, luminance);
    if (!rgb) file.add("wavelengths", {planes}, wavelengths);
    file.add(rgb ? "rgb" : "spectra", {p, t, planes, c, c}, spectra);
    file.add("jacobian", std::string(1, jacobian ? '\1' : '\0'));
    return file.bytes();
  }
};

class RglFile {
 public:
  explicit RglFile(const std::string& bytes) {
    static int count = 0;
    path_ = (std::filesystem::temp_directory_path() /
             ("rgl_test_" + std::to_string(::getpid()) + "_" + std::to_string(count++) + ".bsdf"))
                .string();
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~RglFile() { std::filesystem::remove(path_); }
  RglFile(const RglFile&) = delete;
  RglFile& operator=(const RglFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

inline std::unique_ptr<RglTable> rgl_table(const RglFormula& formula) {
  return RglTable::read(RglFile(formula.bytes()).path(), {});
}

}  // namespace cloudrenderer::testing
