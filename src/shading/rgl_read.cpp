// The RGL database's container of named arrays, and what has to be in it.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <system_error>

#include "base/portable_math.h"
#include "parts/mapped_file.h"
#include "scene/spectrum.h"
#include "shading/rgl_table.h"

namespace cloudrenderer {
namespace {

constexpr char kMagic[12] = "tensor_file";
constexpr std::uint8_t kByte = 1, kFloat = 10;  // types of elements
constexpr std::array<std::size_t, 12> kElementBytes{0, 1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8};
constexpr float kLargest = 1e12f;

struct Problem {
  const std::string& path;
  const FileLocation& where;
  SceneError operator()(const std::string& why) const { return {where, "measured reflectance '" + path + "': " + why}; }
};

struct Field {
  std::uint8_t type = 0;
  std::vector<std::size_t> shape;
  std::span<const std::byte> bytes;
  std::size_t size() const { return bytes.size() / kElementBytes[type]; }
};
using Fields = std::map<std::string, Field, std::less<>>;

// Little-endian numbers, one after the other.
class Cursor {
 public:
  Cursor(std::span<const std::byte> rest, const Problem& bad) : rest_(rest), bad_(bad) {}
  std::span<const std::byte> take(std::size_t count) {
    if (rest_.size() < count) throw bad_("is cut off");
    const auto taken = rest_.first(count);
    rest_ = rest_.subspan(count);
    return taken;
  }
  template <class T>
  T number() {
    T v;
    std::memcpy(&v, take(sizeof v).data(), sizeof v);
    return v;
  }

 private:
  std::span<const std::byte> rest_;
  const Problem& bad_;
};

Fields read_fields(std::span<const std::byte> file, const Problem& bad) {
  constexpr std::uint32_t kMostFields = 256;
  constexpr std::uint16_t kMostDimensions = 8;
  if (file.size() < sizeof kMagic || std::memcmp(file.data(), kMagic, sizeof kMagic) != 0)
    throw bad("expected a file that begins with tensor_file");
  Cursor in(file.subspan(sizeof kMagic), bad);
  const auto major = in.number<std::uint8_t>(), minor = in.number<std::uint8_t>();
  if (major != 1 || minor != 0)
    throw bad("expected version 1.0, found " + std::to_string(major) + "." + std::to_string(minor));
  const auto count = in.number<std::uint32_t>();
  if (count > kMostFields) throw bad("has more than " + std::to_string(kMostFields) + " fields");
  Fields fields;
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto name = in.take(in.number<std::uint16_t>());
    Field f;
    const auto dimensions = in.number<std::uint16_t>();
    f.type = in.number<std::uint8_t>();
    const auto offset = in.number<std::uint64_t>();
    if (f.type == 0 || f.type >= kElementBytes.size()) throw bad("a field has an unknown type");
    if (dimensions > kMostDimensions)
      throw bad("a field has more than " + std::to_string(kMostDimensions) + " dimensions");
    if (offset > file.size()) throw bad("a field lies outside of the file");
    std::size_t elements = 1;
    const std::size_t room = (file.size() - offset) / kElementBytes[f.type];
    for (std::uint16_t d = 0; d < dimensions; ++d) {
      const auto size = in.number<std::uint64_t>();
      if (size > 0 && elements > room / size) throw bad("a field lies outside of the file");
      elements *= size;
      f.shape.push_back(size);
    }
    f.bytes = file.subspan(offset, elements * kElementBytes[f.type]);
    fields.emplace(std::string(reinterpret_cast<const char*>(name.data()), name.size()), std::move(f));
  }
  return fields;
}

// What the table wants of the fields.
class Contents {
 public:
  Contents(const Fields& fields, const Problem& bad) : fields_(fields), bad_(bad) {}

  bool has(std::string_view name) const { return fields_.find(name) != fields_.end(); }
  // A size of 0 in `shape` may be any.
  const Field& field(std::string_view name, std::uint8_t type, const std::vector<std::size_t>& shape) const {
    const auto found = fields_.find(name);
    if (found == fields_.end()) throw bad_("has no field " + std::string(name));
    const Field& f = found->second;
    if (f.type != type) throw bad_(std::string(name) + " has another type than expected");
    bool good = f.shape.size() == shape.size();
    for (std::size_t i = 0; good && i < shape.size(); ++i)
      good = f.shape[i] > 0 && (shape[i] == 0 || f.shape[i] == shape[i]);
    if (!good) throw bad_(std::string(name) + " has another shape than expected");
    return f;
  }
  // Finite, moderate numbers.
  std::vector<float> numbers(std::string_view name, const Field& f, std::size_t first, std::size_t count) const {
    std::vector<float> out(count);
    std::memcpy(out.data(), f.bytes.data() + first * sizeof(float), count * sizeof(float));
    for (const float v : out)
      if (!(std::fabs(v) < kLargest)) throw bad_("a value of " + std::string(name) + " is no number");
    return out;
  }
  std::vector<float> numbers(std::string_view name, const Field& f) const { return numbers(name, f, 0, f.size()); }
  // One dimension; each number larger than the one before it, all between two bounds.
  std::vector<float> rising(std::string_view name, float least, float most) const {
    std::vector<float> out = numbers(name, field(name, kFloat, {0}));
    for (std::size_t i = 0; i < out.size(); ++i)
      if (!(out[i] >= least && out[i] <= most) || (i > 0 && !(out[i] > out[i - 1])))
        throw bad_("expected values of " + std::string(name) + " that rise within [" + std::to_string(least) + ", " +
                   std::to_string(most) + "]");
    return out;
  }
  // The last two dimensions are rows and columns.
  std::pair<std::size_t, std::size_t> grid(std::string_view name, const Field& f) const {
    const std::size_t rows = f.shape[f.shape.size() - 2], columns = f.shape.back();
    if (rows < 2 || columns < 2) throw bad_(std::string(name) + " needs two rows and two columns");
    return {columns, rows};
  }
  GridStack<float> values(std::string_view name) const {
    const Field& f = field(name, kFloat, {0, 0});
    const auto [columns, rows] = grid(name, f);
    std::vector<float> v = numbers(name, f);
    for (float& x : v) x = std::max(x, 0.f);
    return {columns, rows, std::move(v)};
  }
  Warp2D warp(std::string_view name, std::size_t phis, std::size_t thetas) const {
    const Field& f = field(name, kFloat, {phis, thetas, 0, 0});
    const auto [columns, rows] = grid(name, f);
    return {columns, rows, numbers(name, f)};
  }
  // S as RGB. Colours are sums over the planes of a slice, each times what its wavelength is in RGB.
  GridStack<Rgb> colors(std::size_t phis, std::size_t thetas) const {
    const bool spectral = has("spectra");
    const std::string_view name = spectral ? "spectra" : "rgb";
    const std::vector<Rgb> basis = spectral ? spectral_basis() : std::vector<Rgb>{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const Field& f = field(name, kFloat, {phis, thetas, basis.size(), 0, 0});
    const auto [columns, rows] = grid(name, f);
    const std::size_t plane = columns * rows, slices = phis * thetas;
    std::vector<Rgb> out(slices * plane, Rgb(0.f));
    for (std::size_t i = 0; i < slices * basis.size(); ++i) {
      const std::vector<float> v = numbers(name, f, i * plane, plane);
      Rgb* slice = out.data() + i / basis.size() * plane;
      for (std::size_t k = 0; k < plane; ++k) slice[k] += v[k] * basis[i % basis.size()];
    }
    for (Rgb& c : out) c = glm::max(c, Rgb(0.f));  // noise, and colours that RGB does not have
    return {columns, rows, std::move(out)};
  }

 private:
  std::vector<Rgb> spectral_basis() const {
    constexpr std::size_t kMostWavelengths = 2048;
    const std::vector<float> wavelengths = rising("wavelengths", 1.f, 1e6f);
    if (wavelengths.size() > kMostWavelengths)
      throw bad_("has more than " + std::to_string(kMostWavelengths) + " wavelengths");
    SampledSpectrum one{{wavelengths.begin(), wavelengths.end()}, std::vector<double>(wavelengths.size())};
    std::vector<Rgb> basis;
    for (double& v : one.values) {
      v = 1;
      basis.push_back(reflectance_to_rgb(one));
      v = 0;
    }
    return basis;
  }

  const Fields& fields_;
  const Problem& bad_;
};

}  // namespace

std::unique_ptr<RglTable> RglTable::read(const std::string& path, const FileLocation& where) {
  constexpr float kRounding = 1e-3f;
  const Problem bad{path, where};
  MappedFile file;
  try {
    file = map_file(path);
  } catch (const std::system_error& e) {
    throw bad(e.code().message());
  }
  const Fields fields = read_fields(file.bytes, bad);
  const Contents in(fields, bad);
  std::vector<float> phi = in.rising("phi_i", -2 * kPi - kRounding, 2 * kPi + kRounding);
  std::vector<float> theta = in.rising("theta_i", 0.f, 0.5f * kPi + kRounding);
  const std::size_t phis = phi.size(), thetas = theta.size();

  std::unique_ptr<RglTable> table(new RglTable);
  table->isotropic_ = phis <= 2;
  if (!table->isotropic_) {
    const float folds = std::round(2.f * kPi / (phi.back() - phi.front())), middle = 0.5f * (phi.front() + phi.back());
    if (folds != 1.f && folds != 2.f && folds != 4.f)
      throw bad("expected phi_i from all of the circle, a half or a quarter of it");
    table->folds_ = static_cast<int>(folds);
    table->sign_x_ = portable::cos(middle) < 0.f ? -1.f : 1.f;
    table->sign_y_ = portable::sin(middle) < 0.f ? -1.f : 1.f;
  }
  table->jacobian_ = in.field("jacobian", kByte, {1}).bytes[0] != std::byte{0};
  table->ndf_ = in.values("ndf");
  table->sigma_ = in.values("sigma");
  table->visible_ = in.warp("vndf", phis, thetas);
  table->luminance_ = in.warp("luminance", phis, thetas);
  table->scattered_ = in.colors(phis, thetas);
  table->nodes_ = SliceNodes(std::move(phi), std::move(theta));
  table->tabulate_albedo();
  return table;
}

}  // namespace cloudrenderer
