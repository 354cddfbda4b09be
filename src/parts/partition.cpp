#include "parts/partition.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>

namespace cloudrenderer {
namespace {

constexpr std::size_t kBins = 256;
constexpr std::size_t kMinBoxes = 4, kMaxBoxes = 8;

struct Bin {
  Bounds3 box;
  double bytes = 0;
};

// Maps a box centre to a bin of one axis; the same for counting and for cutting.
struct BinMap {
  float start = 0, scale = 0;

  BinMap() = default;
  BinMap(float low, float high) : start(low) {
    const float width = high - low;
    if (width > 0.f) scale = static_cast<float>(kBins) / width;
    if (!std::isfinite(scale)) scale = 0.f;
  }
  std::size_t operator()(float center) const {
    const float b = (center - start) * scale;
    return std::min(kBins - 1, static_cast<std::size_t>(std::max(b, 0.f)));
  }
};

float center(const Bounds3& b, int axis) { return 0.5f * b.min[axis] + 0.5f * b.max[axis]; }

double half_area(const Bounds3& b) {
  if (b.empty()) return 0;
  const glm::dvec3 d = glm::dvec3(b.max) - glm::dvec3(b.min);
  return d.x * d.y + d.y * d.z + d.z * d.x;
}

struct Histogram {
  std::array<BinMap, 3> map;
  std::array<std::array<Bin, kBins>, 3> bins;
  double bytes = 0;
  bool flat = true;  // all centres are (nearly) the same
};

std::unique_ptr<Histogram> histogram(std::span<const Item> items, const ItemCost& cost) {
  Bounds3 centers;
  for (const Item& i : items) centers.extend(i.box.center());
  auto h = std::make_unique<Histogram>();
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    h->map[a] = BinMap(centers.min[axis], centers.max[axis]);
    if (h->map[a](centers.max[axis]) > 0) h->flat = false;
  }
  for (const Item& i : items) {
    const double bytes = cost(i);
    h->bytes += bytes;
    for (std::size_t a = 0; a < 3; ++a) {
      Bin& bin = h->bins[a][h->map[a](center(i.box, static_cast<int>(a)))];
      bin.box.extend(i.box);
      bin.bytes += bytes;
    }
  }
  return h;
}

struct Cut {
  std::size_t axis = 0, bin = 0;  // items of bins below `bin` go to the first side
  bool unbalanced = true;
  double score = std::numeric_limits<double>::infinity();
};

// What a cut is for. Parts: both sides keep a fair share, and cuts that waste room in parts pay for
// it. Boxes: each box costs the same whatever it holds, so only surface counts.
enum class Goal { parts, boxes };

Cut best_cut(const Histogram& h, double capacity, Goal goal) {
  const double parts = std::max(2.0, std::ceil(h.bytes / capacity));
  const double least = parts >= 4 ? 0.25 : 0.15;
  Cut best;
  for (std::size_t a = 0; a < 3; ++a) {
    std::array<Bounds3, kBins> above;  // union of bins from i on
    Bounds3 box;
    for (std::size_t i = kBins; i-- > 0;) {
      box.extend(h.bins[a][i].box);
      above[i] = box;
    }
    Bounds3 below;
    double bytes = 0;
    for (std::size_t i = 1; i < kBins; ++i) {
      below.extend(h.bins[a][i - 1].box);
      bytes += h.bins[a][i - 1].bytes;
      if (below.empty() || above[i].empty()) continue;
      const double other = h.bytes - bytes;
      if (goal == Goal::boxes) {
        const double surface = half_area(below) + half_area(above[i]);
        if (best.unbalanced || surface < best.score) best = {a, i, false, surface};
        continue;
      }
      const double waste = std::ceil(bytes / capacity) + std::ceil(other / capacity) - parts;
      const bool unbalanced = std::min(bytes, other) < least * h.bytes;
      const double sah = half_area(below) * bytes + half_area(above[i]) * other;
      const double score =
          unbalanced ? std::fabs(bytes - other) : sah * (1 + 2 * std::max(0.0, waste) / parts);
      if (std::pair(unbalanced, score) < std::pair(best.unbalanced, best.score))
        best = {a, i, unbalanced, score};
    }
  }
  return best;
}

// Cuts into two sides, neither empty; returns the size of the first. items.size() >= 2.
std::size_t cut_in_two(std::span<Item> items, const Histogram& h, double capacity, Goal goal) {
  const Cut cut = h.flat ? Cut{} : best_cut(h, capacity, goal);
  if (cut.bin == 0) return items.size() / 2;  // nothing tells the items apart in space
  const auto middle = std::partition(items.begin(), items.end(), [&](const Item& i) {
    return h.map[cut.axis](center(i.box, static_cast<int>(cut.axis))) < cut.bin;
  });
  return static_cast<std::size_t>(middle - items.begin());
}

}  // namespace

void partition(std::span<Item> items, const ItemCost& cost, double capacity,
               const std::function<bool(std::span<Item>)>& fits) {
  if (items.empty()) return;
  std::size_t half = 0;
  {
    const double room = std::max(capacity, 1.0);
    const std::unique_ptr<Histogram> h = histogram(items, cost);
    if (h->bytes <= room || items.size() == 1)
      if (fits(items) || items.size() == 1) return;
    half = cut_in_two(items, *h, room, Goal::parts);
  }
  partition(items.first(half), cost, capacity, fits);
  partition(items.subspan(half), cost, capacity, fits);
}

std::vector<Bounds3> tight_boxes(std::span<Item> items) {
  struct Group {
    std::span<Item> items;
    Bounds3 box;
    bool final = false;  // cutting it gained nothing
  };
  const auto grouped = [](std::span<Item> run) {
    Group g{run, {}, run.size() < 2};
    for (const Item& i : run) g.box.extend(i.box);
    return g;
  };
  const ItemCost one = [](const Item&) { return 1.f; };
  std::vector<Group> groups;
  if (!items.empty()) groups.push_back(grouped(items));
  while (groups.size() < kMaxBoxes) {
    Group* largest = nullptr;
    for (Group& g : groups)
      if (!g.final && (!largest || half_area(g.box) > half_area(largest->box))) largest = &g;
    if (!largest) break;
    const std::span<Item> run = largest->items;
    const auto h = histogram(run, one);
    const std::size_t half = cut_in_two(run, *h, 0, Goal::boxes);
    const Group a = grouped(run.first(half)), b = grouped(run.subspan(half));
    // More boxes than four must earn their test: they must leave out a tenth of the surface.
    const double before = half_area(largest->box), after = half_area(a.box) + half_area(b.box);
    if (groups.size() >= kMinBoxes && after > 0.9 * before) {
      largest->final = true;
      continue;
    }
    *largest = a;
    groups.push_back(b);
  }
  std::vector<Bounds3> boxes;
  for (const Group& g : groups) boxes.push_back(g.box);
  return boxes;
}

}  // namespace cloudrenderer
