// Grids of densities: `Volume "volumegrid"`, MakeNamedMedium "heterogeneous" (pbrt-v3), "uniformgrid", "rgbgrid", "nanovdb"
// and "cloud" (pbrt-v4).
#include <algorithm>
#include <cmath>

#include "scene/cloud_voxels.h"
#include "scene/description.h"
#include "scene/nanovdb.h"
#include "scene/param_make.h"

namespace cloudrenderer {
namespace {

// As many samples along an axis as no file has; keeps products in 64 bits.
constexpr int kLongestAxis = 1 << 20;

// A grid while it is read.
struct Reading {
  MediumDesc& medium;
  GridDesc grid;
  std::vector<DenseVoxels::Channel> arrays;
  std::vector<std::string> names;      // of the channels
  std::vector<std::string> taken;      // parameters that are in the voxels now
  DenseVoxels::Beyond beyond = DenseVoxels::Beyond::nothing;

  const ParamSet& params() const { return medium.params; }
  [[noreturn]] void fail(const std::string& why) const { throw SceneError(medium.location, why); }

  std::uint32_t axis(const char* name) const {
    const int n = params().integer(name, 1);
    if (n < 1 || n > kLongestAxis)
      fail(std::string(name) + " of a density grid must be between 1 and " + std::to_string(kLongestAxis) + ", got " +
           std::to_string(n));
    return static_cast<std::uint32_t>(n);
  }
  std::uint64_t sample_count() const {
    const glm::uvec3& n = grid.layout.size;
    return std::uint64_t{n.x} * n.y * n.z;
  }
  void read_size() { grid.layout.size = {axis("nx"), axis("ny"), axis("nz")}; }

  BulkArray<float> array(const char* name, std::uint64_t numbers, bool negative = false) {
    BulkArray<float> values = params().reals(name);
    taken.emplace_back(name);
    if (values.size() != sample_count() * numbers)
      fail("a density grid of nx * ny * nz samples needs " + std::to_string(sample_count() * numbers) + " values of \"" + name +
           "\", got " + std::to_string(values.size()));
    for (const float d : values)
      if (!((negative || d >= 0.f) && std::fabs(d) < kInfinity))
        fail(std::string(name) == "density" ? "densities must be finite and at least 0"
                                            : "the values of " + std::string(name) + " must be finite" + (negative ? "" : " and at least 0"));
    return values;
  }
  void add(std::string name, DenseVoxels::Channel channel) {
    names.push_back(std::move(name));
    arrays.push_back(std::move(channel));
  }
  // The channel of red, and those of green and blue behind it.
  void add_rgb(const std::string& name, DenseVoxels::Channel channel) {
    for (channel.first = 0; channel.first < 3; ++channel.first) add(name, channel);
  }
};

void read_density(Reading& r) {
  r.read_size();
  r.add("density", {r.array("density", 1)});
}

void read_uniform(Reading& r) {
  read_density(r);
  const Param* strength = r.params().find("Lescale");
  if (strength && (strength->reals.size() != 1 || r.sample_count() == 1)) r.add("strength", {r.array("Lescale", 1)});
  if (r.params().has("temperature")) r.add("temperature", {r.array("temperature", 1, true)});
}

void read_rgb(Reading& r) {
  r.read_size();
  const bool absorbs = r.params().has("sigma_a"), scatters = r.params().has("sigma_s"), shines = r.params().has("Le");
  if (!absorbs && !scatters) r.fail("an rgbgrid needs \"sigma_a\" or \"sigma_s\"");
  if (shines && !absorbs) r.fail("an rgbgrid with \"Le\" needs \"sigma_a\"");
  const BulkArray<float> a = absorbs ? r.array("sigma_a", 3) : BulkArray<float>(),
                         s = scatters ? r.array("sigma_s", 3) : BulkArray<float>();
  if (absorbs && scatters)
    r.add_rgb("sigma_t", {a, 3, 0, s});
  else
    r.add_rgb("sigma_t", {.values = absorbs ? a : s, .stride = 3, .plus = {}, .constant = 1});  // what is not given is 1
  r.add_rgb("sigma_s", {s, 3});
  if (shines) r.add_rgb("Le", {r.array("Le", 3), 3});
  r.grid.layout.densities = 3;
}

void read_nanovdb(Reading& r) {
  const Param* file = r.params().find("filename");
  const std::string path = r.params().string("filename", "");
  if (!file || path.empty()) r.fail("the nanovdb medium needs a \"string filename\"");
  const auto vdb = NanoVdb::open(
      path, {r.params().string("gridname", "density"), r.params().string("temperaturename", "temperature")}, file->location);
  for (const char* name : {"filename", "gridname", "temperaturename"}) r.taken.emplace_back(name);
  r.names.emplace_back("density");
  if (vdb->has(1)) r.names.emplace_back("temperature");
  r.grid.layout.size = vdb->size();
  r.grid.layout.p0 = Vec3(vdb->first());
  r.grid.layout.p1 = r.grid.layout.p0 + Vec3(vdb->size());
  r.grid.layout.first_sample = 0;  // samples lie at whole numbers
  r.grid.medium_to_world = r.medium.medium_to_world * vdb->index_to_world();
  r.grid.voxels = vdb;
}

void read_box(Reading& r) {
  GridLayout& grid = r.grid.layout;
  grid.p0 = r.params().point3("p0", Vec3(0.f));
  grid.p1 = r.params().point3("p1", Vec3(1.f));
  const Vec3 extent = glm::abs(grid.p1 - grid.p0);
  if (!(extent.x > 0.f && extent.y > 0.f && extent.z > 0.f) || !is_finite(extent))
    r.fail("the box of a density grid, from p0 to p1, must have a volume");
}

void read_cloud(Reading& r) {
  read_box(r);
  CloudVoxels::Shape shape;
  shape.density = r.params().real("density", 1.f);
  shape.wispiness = r.params().real("wispiness", 1.f);
  shape.frequency = r.params().real("frequency", 5.f);
  for (const float v : {shape.density, shape.wispiness, shape.frequency})
    if (!std::isfinite(v)) r.fail("density, wispiness and frequency of a cloud must be finite");
  for (const char* name : {"density", "wispiness", "frequency"}) r.taken.emplace_back(name);
  for (int a = 0; a < 3; ++a)
    r.grid.layout.size[a] = CloudVoxels::samples(std::fabs(r.grid.layout.p1[a] - r.grid.layout.p0[a]), shape);
  r.names.emplace_back("density");
  r.grid.voxels = std::make_shared<CloudVoxels>(r.grid.layout, shape);
}

}  // namespace

bool is_grid(const MediumDesc& medium, Dialect dialect) {
  if (dialect == Dialect::v2) return medium.type == "volumegrid";
  constexpr std::array<std::string_view, 5> kTypes{"heterogeneous", "uniformgrid", "rgbgrid", "nanovdb", "cloud"};
  return std::find(kTypes.begin(), kTypes.end(), medium.type) != kTypes.end();
}

std::uint32_t grid_channels(const MediumDesc& medium) {
  const Param* channels = medium.params.find("channels");
  return channels ? static_cast<std::uint32_t>(channels->strings.size()) : 1;
}

std::optional<GridDesc> take_grid(MediumDesc& medium, MediumId id, Dialect dialect) {
  if (!is_grid(medium, dialect)) return std::nullopt;
  const bool v2 = dialect == Dialect::v2;
  Reading r{medium, {}, {}, {}, {}};
  r.grid.medium = id;
  r.grid.medium_to_world = medium.medium_to_world;
  r.grid.location = medium.location;
  if (v2) r.beyond = DenseVoxels::Beyond::last;
  if (medium.type == "nanovdb") {
    read_nanovdb(r);
  } else if (medium.type == "cloud") {
    read_cloud(r);
  } else {
    if (medium.type == "uniformgrid")
      read_uniform(r);
    else if (medium.type == "rgbgrid")
      read_rgb(r);
    else
      read_density(r);
    read_box(r);
    GridLayout& grid = r.grid.layout;
    if (v2) {  // sorts the corners; pbrt-v3 mirrors the grid
      const Vec3 low = glm::min(grid.p0, grid.p1);
      grid.p1 = glm::max(grid.p0, grid.p1);
      grid.p0 = low;
    }
    r.grid.voxels = std::make_shared<DenseVoxels>(grid.size, r.beyond, std::move(r.arrays));
  }
  r.grid.layout.channels = static_cast<std::uint32_t>(r.names.size());
  ParamSet others;
  for (const Param& p : medium.params.all())
    if (std::find(r.taken.begin(), r.taken.end(), p.name) == r.taken.end()) others.add(p);
  if (r.names.size() > 1) {  // what the samples mean, for those who have only the parts
    Param channels = make_param(ParamType::string, "channels", medium.location);
    channels.strings = r.names;
    others.add(std::move(channels));
  }
  medium.params = std::move(others);
  return std::move(r.grid);
}

}  // namespace cloudrenderer
