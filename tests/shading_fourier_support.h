#pragma once
// Tabulated BSDFs whose series are formulas.
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "cloudrenderer/math.h"
#include "shading/fourier.h"

namespace cloudrenderer::testing {

// Scatters `albedo` of the light from along the normal, `through` of that to the other side; peak: the ratio of neighbouring coefficients, 0 is even
// around the normal. The value is a Poisson kernel of the angle between, so that nothing is negative.
struct FourierFormula {
  float albedo = 0.8f, through = 0.f, peak = 0.5f;
  int channels = 1, nodes = 40, terms = 24;
  float eta = 1.f;

  std::string bytes() const {
    std::vector<float> mu, integrals(static_cast<std::size_t>(nodes * nodes)), coefficients;
    std::vector<std::int32_t> places;
    for (int i = 0; i < nodes; ++i)
      mu.push_back(static_cast<float>(-std::cos(3.14159265358979 * (i + 0.5) / nodes) / std::cos(3.14159265358979 * 0.5 / nodes)));
    mu.front() = -1.f;
    mu.back() = 1.f;
    for (const float o : mu)
      for (const float i : mu) {
        const bool same_side = o * i < 0.f;
        const float share = albedo * (same_side ? 1.f - through : through);
        places.push_back(static_cast<std::int32_t>(coefficients.size()));
        places.push_back(share > 0.f ? terms : 0);
        if (!(share > 0.f)) continue;
        for (int c = 0; c < channels; ++c) {
          // f is proportional to both cosines: smooth enough for the splines, and reciprocal
          float a = share * 1.5f / kPi * i * i * std::fabs(o) * (c == 1 ? 0.9f : c == 2 ? 0.8f : 1.f);
          for (int k = 0; k < terms; ++k) {
            coefficients.push_back(a);
            a *= (k == 0 ? 2.f : 1.f) * peak * std::sqrt((1 - o * o) * (1 - i * i));
          }
        }
      }
    std::string out("SCATFUN\x01", 8);
    const auto put = [&](const auto& x) { out.append(reinterpret_cast<const char*>(&x), sizeof x); };
    const auto put_all = [&](const auto& v) { out.append(reinterpret_cast<const char*>(v.data()), v.size() * sizeof v[0]); };
    for (const std::int32_t x : {1, nodes, static_cast<std::int32_t>(coefficients.size()), terms, channels, 1, 0, 0, 0}) put(x);
    put(eta);
    for (int i = 0; i < 4; ++i) put(0.f);
    put_all(mu);
    put_all(integrals);
    put_all(places);
    put_all(coefficients);
    return out;
  }
};

class BsdfFile {
 public:
  explicit BsdfFile(const std::string& bytes) {
    static int count = 0;
    path_ = (std::filesystem::temp_directory_path() /
             ("fourier_test_" + std::to_string(::getpid()) + "_" + std::to_string(count++) + ".bsdf")).string();
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~BsdfFile() { std::filesystem::remove(path_); }
  BsdfFile(const BsdfFile&) = delete;
  BsdfFile& operator=(const BsdfFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

inline std::unique_ptr<FourierTable> fourier_table(const FourierFormula& formula) {
  return FourierTable::read(BsdfFile(formula.bytes()).path(), {});
}

}  // namespace cloudrenderer::testing
