#include <cmath>
#include <cstring>
#include <optional>
#include <system_error>

#include "parts/mapped_file.h"
#include "shading/fourier.h"

namespace cloudrenderer {
namespace {

constexpr char kMagic[8] = {'S', 'C', 'A', 'T', 'F', 'U', 'N', '\x01'};
constexpr std::uint32_t kPlainBsdf = 1;  // the only flag: no harmonic extrapolation

// The file's header, little-endian.
struct Header {
  char magic[8];
  std::uint32_t flags;
  std::int32_t nodes, coefficients, longest, channels, bases, metadata_bytes, parameters, parameter_values;
  float eta;
  float unused[4];  // roughness of both sides, padding
};
static_assert(sizeof(Header) == 64);

class Reader {
 public:
  explicit Reader(std::span<const std::byte> rest) : rest_(rest) {}
  // Throws nothing: false when there is less.
  template <class T>
  bool read(std::vector<T>& out, std::size_t count) {
    if (rest_.size() / sizeof(T) < count) return false;
    out.resize(count);
    std::memcpy(out.data(), rest_.data(), count * sizeof(T));
    rest_ = rest_.subspan(count * sizeof(T));
    return true;
  }

 private:
  std::span<const std::byte> rest_;
};

}  // namespace

std::unique_ptr<FourierTable> FourierTable::read(const std::string& path, const FileLocation& where) {
  const auto bad = [&](const std::string& why) -> SceneError { return {where, "tabulated BSDF '" + path + "': " + why}; };
  MappedFile file;
  try {
    file = map_file(path);
  } catch (const std::system_error& e) {
    throw bad(e.code().message());
  }
  Header h;
  if (file.bytes.size() < sizeof h) throw bad("expected a header of 64 bytes");
  std::memcpy(&h, file.bytes.data(), sizeof h);
  if (std::memcmp(h.magic, kMagic, sizeof kMagic) != 0) throw bad("expected a file that begins with SCATFUN, version 1");
  if (h.flags != kPlainBsdf || h.bases != 1)
    throw bad("expected one set of coefficients without harmonic extrapolation");
  if (h.channels != 1 && h.channels != 3) throw bad("expected 1 or 3 channels, found " + std::to_string(h.channels));
  constexpr int kMostNodes = 8192;
  if (h.nodes < 2 || h.nodes > kMostNodes) throw bad("expected 2 to 8192 cosines, found " + std::to_string(h.nodes));
  if (h.coefficients < 0 || h.longest < 0 || static_cast<std::size_t>(h.longest) > kMaxOrder)
    throw bad("expected series of at most " + std::to_string(kMaxOrder) + " terms, found " + std::to_string(h.longest));
  if (!(h.eta > 1e-3f && h.eta < 1e3f)) throw bad("expected an index of refraction, found " + std::to_string(h.eta));

  std::unique_ptr<FourierTable> table(new FourierTable);
  table->eta_ = h.eta;
  table->channels_ = static_cast<std::size_t>(h.channels);
  const auto n = static_cast<std::size_t>(h.nodes), cells = n * n;
  Reader reader(file.bytes.subspan(sizeof h));
  std::vector<float> integrals;  // made anew
  std::vector<std::int32_t> places;
  if (!reader.read(table->mu_, n) || !reader.read(integrals, cells) || !reader.read(places, 2 * cells) ||
      !reader.read(table->coefficients_, static_cast<std::size_t>(h.coefficients)))
    throw bad("is cut off");
  for (std::size_t i = 0; i < n; ++i)
    if (!(table->mu_[i] >= -1.f && table->mu_[i] <= 1.f) || (i > 0 && !(table->mu_[i] > table->mu_[i - 1])))
      throw bad("expected cosines that rise from -1 to 1");
  for (const float c : table->coefficients_)
    if (!(std::fabs(c) < 1e12f)) throw bad("a coefficient is no number");
  table->offset_.resize(cells);
  table->order_.resize(cells);
  for (std::size_t i = 0; i < cells; ++i) {
    const std::int64_t offset = places[2 * i], order = places[2 * i + 1];
    if (order < 0 || order > h.longest || (order > 0 && (offset < 0 || offset + order * h.channels > h.coefficients)))
      throw bad("a series lies outside of the coefficients");
    table->offset_[i] = static_cast<std::uint32_t>(order > 0 ? offset : 0);
    table->order_[i] = static_cast<std::uint32_t>(order);
  }
  table->integrate();
  return table;
}

}  // namespace cloudrenderer
