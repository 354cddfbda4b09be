#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <system_error>

#include "base/portable_math.h"
#include "parts/mapped_file.h"
#include "shading/measured.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kHalf = 90, kDifference = 90, kAround = 180;
constexpr std::size_t kTableCells = kHalf * kDifference * kAround;
constexpr std::size_t kFileBytes =
    3 * sizeof(std::int32_t) + 3 * kTableCells * sizeof(double);    // planes of red, green, blue
constexpr std::array kScale{1.0 / 1500, 1.15 / 1500, 1.66 / 1500};  // as the database says

std::size_t cell_of(float part, std::size_t count) {
  const float cell = part * static_cast<float>(count);
  return cell > 0.f ? std::min(static_cast<std::size_t>(cell), count - 1) : 0;
}

class MerlTable final : public ReflectanceTable {
 public:
  explicit MerlTable(std::vector<Rgb> cells) : cells_(std::move(cells)) {}

  Rgb value(const Vec3& wo, const Vec3& wi) const override {
    Vec3 h = wo + wi, light = wi;
    const float length2 = glm::dot(h, h);
    if (!(length2 > 0.f)) return Rgb(0.f);
    h *= (h.z < 0.f ? -1.f : 1.f) / std::sqrt(length2);
    if (wo.z + wi.z < 0.f) light = -light;
    // The light's direction in the frame of the half vector, whose x axis lies in its meridian.
    const float sine = std::sqrt(h.x * h.x + h.y * h.y);
    const float c = sine > 0.f ? h.x / sine : 1.f, s = sine > 0.f ? h.y / sine : 0.f;
    const float x = glm::dot(light, Vec3(c * h.z, s * h.z, -sine)), y = light.y * c - light.x * s;
    const float half = portable::atan2(sine, h.z), difference = portable::acos(glm::dot(light, h));
    float around = portable::atan2(y, x);  // and its opposite are the same, as the two directions
    if (around < 0.f) around += kPi;       // may change places
    return cells_[cell_of(around * kInvPi, kAround) +
                  kAround * (cell_of(difference * 2.f * kInvPi, kDifference) +
                             kDifference * cell_of(std::sqrt(half * 2.f * kInvPi), kHalf))];
  }
  std::uint64_t bytes() const override { return cells_.size() * sizeof(Rgb); }

 private:
  std::vector<Rgb> cells_;
};

}  // namespace

std::unique_ptr<ReflectanceTable> read_merl(const std::string& path, const FileLocation& where) {
  const auto bad = [&](const std::string& why) -> SceneError {
    return {where, "measured reflectance '" + path + "': " + why};
  };
  MappedFile file;
  try {
    file = map_file(path);
  } catch (const std::system_error& e) {
    throw bad(e.code().message());
  }
  std::array<std::int32_t, 3> counts{};
  if (file.bytes.size() >= sizeof counts)
    std::memcpy(counts.data(), file.bytes.data(), sizeof counts);
  if (counts != std::array<std::int32_t, 3>{kHalf, kDifference, kAround})
    throw bad("expected a MERL table of 90 x 90 x 180 cells");
  if (file.bytes.size() != kFileBytes)
    throw bad("expected " + std::to_string(kFileBytes) + " bytes, found " +
              std::to_string(file.bytes.size()));
  std::vector<Rgb> cells(kTableCells);
  const std::byte* from = file.bytes.data() + sizeof counts;
  for (int channel = 0; channel < 3; ++channel)
    for (Rgb& cell : cells) {
      double v;
      std::memcpy(&v, from, sizeof v);
      from += sizeof v;
      // What was not measured is negative.
      const auto value = static_cast<float>(v * kScale[static_cast<std::size_t>(channel)]);
      if (!std::isfinite(value)) throw bad("a value is no number");
      cell[channel] = std::max(0.f, value);
    }
  return std::make_unique<MerlTable>(std::move(cells));
}

}  // namespace cloudrenderer
