#pragma once
// Tabulated scattering functions of layered materials: splines over the two cosines, cosine series over the angle between
// (Jakob, d'Eon, Jakob and Marschner, "A Comprehensive Framework for Rendering Layered Materials", 2014).
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "shading/scattering_table.h"

namespace cloudrenderer {

// Cosines: mu_o = wo.z and mu_i = -wi.z, so that equal signs are transmission. Rows belong to mu_o.
class FourierTable final : public ScatteringTable {
 public:
  // Throws SceneError at `where`, the place that names the file. The format is that of the paper's material designer
  // (header "SCATFUN", version 1), one set of coefficients, one channel or three.
  static std::unique_ptr<FourierTable> read(const std::string& path, const FileLocation& where);

  Rgb value(const Vec3& wo, const Vec3& wi) const override;
  float pdf(const Vec3& wo, const Vec3& wi) const override;
  bool sample(const Vec3& wo, float u, const Vec2& u2, Vec3& wi) const override;
  float albedo(float cosine) const override;
  std::uint64_t bytes() const override;

 private:
  static constexpr std::size_t kMaxOrder = 4096;  // terms of a series

  // Four nodes and their shares of a value between the second and the third (Catmull and Rom 1974).
  struct Weights {
    std::array<std::size_t, 4> node;
    std::array<float, 4> weight;  // 0 where there is no node
    bool inside = false;
  };
  // The interpolated coefficients of a pair of cosines, channel by channel.
  struct Series {
    std::size_t order = 0;
    std::array<float, 3 * kMaxOrder> a;
    Series() {}  // NOLINT: what is not used stays unwritten
    std::span<const float> channel(std::size_t c) const { return {a.data() + c * order, order}; }
  };

  FourierTable() = default;
  void integrate();
  std::size_t cell(float mu) const;  // of the nodes around mu the first
  Weights weights(float mu) const;
  void series(const Weights& o, const Weights& i, std::size_t channels, Series& out) const;
  // What cosines are sampled by: a_0, linear between rows and columns, and a share of all cosines evenly, since the splines
  // may be above 0 where that is not.
  struct Rows {
    std::size_t low;  // and the next one
    float high_share;
  };
  Rows rows(float mu_o) const;
  float between(const Rows& r, const std::vector<float>& table, std::size_t column) const;
  float column_pdf(const Rows& r, float mu_i) const;
  float sample_column(const Rows& r, float u) const;

  float eta_ = 1;
  std::size_t channels_ = 1;
  std::vector<float> mu_;
  std::vector<float> first_;       // a_0, row by row
  std::vector<float> cumulative_;  // its integral from the first column on, linear between columns
  std::vector<std::uint32_t> offset_, order_;
  std::vector<float> coefficients_;
};

}  // namespace cloudrenderer
