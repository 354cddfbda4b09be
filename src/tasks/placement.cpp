#include "tasks/placement.h"

#include <algorithm>
#include <bit>
#include <set>

#include "base/random.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kNobody = ~std::size_t{0};
constexpr std::size_t kFew = 64;  // hosts that are all compared; of more the first that suits, in a random order

std::string mebibytes(std::uint64_t bytes) {
  return std::to_string((bytes + (1u << 20) - 1) >> 20) + " MiB";
}

class Placer {
 public:
  explicit Placer(const PlacementInput& in)
      : in_(in), hosts_(in.hosts.size()), copies_(in.parts.size()) {
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      hosts_[h].has.resize(in.parts.size());
      hosts_[h].cannot.resize(in.parts.size());
      for (const PartId p : in.hosts[h].cannot) hosts_[h].cannot[p.value] = true;
      if (in.hosts[h].traces) add(h, 0);
      for (const PartId p : in.hosts[h].holds)
        if (p.value != 0) add(h, p.value);
    }
    for (std::size_t p = 1; p < in.parts.size(); ++p) {
      order_.push_back(p);
      by_visits_ = by_visits_ || in.parts[p].visits > 0;
    }
    for (const std::size_t p : order_) total_load_ += load(p);
    for (std::size_t h = 0; h < hosts_.size(); ++h) total_capacity_ += capacity(h);
    // Largest first, by powers of two, so that parts of about one size keep their spatial order.
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
      return std::bit_width(in.parts[a].bytes) > std::bit_width(in.parts[b].bytes);
    });
  }

  // Puts the parts with most visits on every host, as far as memory allows beside `copies` of the others: what all
  // hosts hold needs no moves and balances by itself.
  void spread_visited(std::uint32_t copies) {
    if (!by_visits_) return;
    double free = 0, largest = 0;
    for (std::size_t h = 0; h < hosts_.size(); ++h) free += static_cast<double>(room(h) - std::min(room(h), hosts_[h].build));
    for (const std::size_t p : order_) {
      const double bytes = static_cast<double>(cost({}, p));
      free -= bytes * copies;
      largest = std::max(largest, bytes + static_cast<double>(in_.parts[p].build));
    }
    free -= largest * static_cast<double>(hosts_.size());  // whole parts do not fill hosts to the brim
    std::vector<std::size_t> hottest = order_;
    std::stable_sort(hottest.begin(), hottest.end(),
                     [&](std::size_t a, std::size_t b) { return in_.parts[a].visits > in_.parts[b].visits; });
    for (const std::size_t p : hottest) {
      free -= static_cast<double>(cost({}, p)) * static_cast<double>(hosts_.size() - copies);
      if (free < 0) return;
      for (std::size_t h = 0; h < hosts_.size(); ++h)
        if (can_take(h, p, true)) add(h, p);
      total_load_ -= load(p);  // every host's own: nothing to share out
      for (Host& host : hosts_) host.load -= host.has[p] ? load(p) : 0;
    }
  }

  // From here on the parts with most visits come first.
  void prefer_visited() {
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
      return in_.parts[a].visits > in_.parts[b].visits;
    });
  }

  // What every host must hold, while it is built.
  std::uint64_t main_bytes() const { return cost({}, 0) + in_.parts[0].build; }

  enum class Pass { all, some, nothing };
  // One more copy of every part that has not more than `copy` of them: all found room, or some, or none has a copy more
  // and none ever will.
  Pass pass(std::uint32_t copy, bool neighbours) {
    bool all = true, hope = false;
    std::size_t last = kNobody;
    for (const std::size_t p : order_) {
      if (copies_[p] > copy) {
        hope = hope || copies_[p] < hosts_.size();
        continue;
      }
      const std::size_t h = neighbours ? choose(p, copy, last) : roomiest(p, copy);
      last = h;
      if (h == kNobody) {
        all = false;
      } else {
        add(h, p);
        hope = true;
      }
    }
    return all ? Pass::all : hope ? Pass::some : Pass::nothing;
  }

  // Sets room aside for one part that comes and goes, whichever it is. False: a host has not got it.
  bool set_page_aside(std::size_t& without) {
    std::uint64_t page = 0;
    for (const std::size_t p : order_) {
      const PlacementPart& part = in_.parts[p];
      page = std::max(page, cost({}, p) - part.bytes + (part.page != 0 ? part.page : part.bytes + part.build));
    }
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      if (!in_.hosts[h].traces) continue;  // it is never who needs a part
      // What stays is built before pages come, or they go for it: the two need room in turn.
      hosts_[h].build = std::max(hosts_[h].build, page);
      without = h;
      if (hosts_[h].used + hosts_[h].build > in_.hosts[h].memory) return false;
    }
    return true;
  }

  // One copy of what fits, most visits a byte first; the parts that found no room.
  std::vector<PartId> hold_visited(const std::vector<PlacementHost>& now) {
    const auto density = [&](std::size_t p) { return load(p) / static_cast<double>(std::max<std::uint64_t>(1, cost({}, p))); };
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) { return density(a) > density(b); });
    const auto part = [](std::size_t p) { return PartId(static_cast<std::uint32_t>(p)); };
    // What is somewhere already stays, as far as there is room: else a new host would turn everything round.
    for (const std::size_t p : order_)
      for (std::size_t h = 0; h < now.size() && copies_[p] == 0; ++h)
        if (std::ranges::find(now[h].holds, part(p)) != now[h].holds.end() && can_take(h, p)) add(h, p);
    std::vector<PartId> rest;
    for (const std::size_t p : order_) {
      if (copies_[p] != 0) continue;
      const std::size_t h = roomiest(p);
      if (h == kNobody)
        rest.push_back(part(p));
      else
        add(h, p);
    }
    std::ranges::sort(rest);
    return rest;
  }

  std::vector<std::vector<PartId>> result() const {
    std::vector<std::vector<PartId>> out(hosts_.size());
    for (std::size_t h = 0; h < hosts_.size(); ++h)
      for (std::size_t p = 1; p < in_.parts.size(); ++p)
        if (hosts_[h].has[p]) out[h].emplace_back(static_cast<std::uint32_t>(p));
    return out;
  }

 private:
  // Nothing for a host that holds more than it may: its memory has become less.
  std::uint64_t room(std::size_t h) const {
    return in_.hosts[h].memory - std::min(in_.hosts[h].memory, hosts_[h].used);
  }
  struct Host {
    std::uint64_t used = 0, build = 0;
    double load = 0;  // of its parts, a part's with several copies in full
    std::vector<bool> has, cannot;
    std::set<std::uint32_t> prototypes;
  };

  std::uint64_t cost(const Host& host, std::size_t p) const {
    std::uint64_t bytes = in_.parts[p].bytes;
    for (const std::uint32_t t : in_.parts[p].prototypes)
      if (!host.prototypes.contains(t)) bytes += in_.prototype_bytes[t];
    return bytes;
  }
  void add(std::size_t h, std::size_t p) {
    Host& host = hosts_[h];
    if (host.has[p]) return;
    host.used += cost(host, p);
    host.build = std::max(host.build, in_.parts[p].build);
    host.prototypes.insert(in_.parts[p].prototypes.begin(), in_.parts[p].prototypes.end());
    if (p != 0) host.load += load(p);
    host.has[p] = true;
    ++copies_[p];
  }
  // spare: one more copy than must be.
  bool can_take(std::size_t h, std::size_t p, bool spare = false) const {
    const Host& host = hosts_[h];
    if (host.has[p] || host.cannot[p] || (spare && !in_.hosts[h].traces)) return false;
    return host.used + cost(host, p) + std::max(host.build, in_.parts[p].build) <=
           in_.hosts[h].memory;
  }
  double load(std::size_t p) const {
    return by_visits_ ? in_.parts[p].visits : static_cast<double>(in_.parts[p].bytes);
  }
  double capacity(std::size_t h) const {
    return by_visits_ ? in_.hosts[h].speed : static_cast<double>(in_.hosts[h].memory);
  }
  // With half of the part the host has no more than its share of `copies` of everything.
  bool balanced(std::size_t h, std::size_t p, std::uint32_t copies) const {
    const double share = capacity(h) / std::max(1e-30, total_capacity_);
    return hosts_[h].load + 0.5 * load(p) <= share * total_load_ * copies;
  }
  std::size_t choose(std::size_t p, std::uint32_t copy, std::size_t last) const {
    const bool spare = copy >= in_.min_replication;
    if (last != kNobody && can_take(last, p, spare) && balanced(last, p, copy + 1))
      return last;  // beside its neighbour
    std::size_t best = kNobody;
    if (hosts_.size() > kFew) {
      const std::uint64_t dice = mix64(in_.seed ^ mix64(p) ^ copy);
      for (std::size_t i = 0; i < hosts_.size(); ++i) {
        const std::size_t h = (dice + i) % hosts_.size();
        if (!can_take(h, p, spare)) continue;
        if (balanced(h, p, copy + 1)) return h;
        if (best == kNobody) best = h;
      }
      return best;
    }
    std::pair<bool, std::uint64_t> best_rank{};
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      if (!can_take(h, p, spare)) continue;
      const std::uint64_t dice =
          mix64(in_.seed ^ mix64((std::uint64_t{in_.hosts[h].host.value} << 32) + p) ^ copy);
      const std::pair rank{balanced(h, p, copy + 1), dice};
      if (best != kNobody && rank <= best_rank) continue;
      best = h;
      best_rank = rank;
    }
    return best;
  }
  std::size_t roomiest(std::size_t p, std::uint32_t copy = 0) const {
    std::size_t best = kNobody;
    std::uint64_t most = 0;
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      if (!can_take(h, p, copy >= in_.min_replication)) continue;
      if (best != kNobody && room(h) <= most) continue;
      best = h;
      most = room(h);
    }
    return best;
  }

  const PlacementInput& in_;
  std::vector<Host> hosts_;
  std::vector<std::uint32_t> copies_;
  std::vector<std::size_t> order_;
  bool by_visits_ = false;
  double total_capacity_ = 0, total_load_ = 0;
};

}  // namespace

Result<std::vector<std::vector<PartId>>> place(const PlacementInput& input) {
  using Placement = Result<std::vector<std::vector<PartId>>>;
  if (input.hosts.empty()) return Placement::failure("there is no host to hold the scene");
  const auto copies = static_cast<std::uint32_t>(
      std::min<std::size_t>(std::max(1u, input.min_replication), input.hosts.size()));
  std::uint64_t needed = 0, room = 0;
  for (std::size_t p = 1; p < input.parts.size(); ++p) needed += input.parts[p].bytes;
  // From the best to what finds room most surely.
  struct Way {
    bool spread, neighbours;
  };
  for (const auto [spread, neighbours] : {Way{true, true}, Way{false, true}, Way{false, false}}) {
    Placer placer(input);
    room = 0;
    for (std::size_t h = 0; h < input.hosts.size(); ++h) {
      if (!input.hosts[h].traces) {
        room += input.hosts[h].memory;
        continue;
      }
      if (placer.main_bytes() > input.hosts[h].memory)
        return Placement::failure("host " + std::to_string(input.hosts[h].host.value) +
                                  " may use " + mebibytes(input.hosts[h].memory) +
                                  ", but what every host must hold needs " +
                                  mebibytes(placer.main_bytes()));
      room += input.hosts[h].memory - placer.main_bytes();
    }
    if (spread) placer.spread_visited(copies);
    bool all = true;
    for (std::uint32_t c = 0; c < copies && all; ++c) all = placer.pass(c, neighbours) == Placer::Pass::all;
    if (!all) continue;
    // What is left of the memory saves moves.
    placer.prefer_visited();
    for (auto c = copies; c < input.hosts.size(); ++c)
      if (placer.pass(c, neighbours) == Placer::Pass::nothing) break;
    return placer.result();
  }
  return Placement::failure("the parts need " + mebibytes(needed * copies) + " (" +
                            std::to_string(copies) + (copies == 1 ? " copy" : " copies") +
                            "), the hosts have room for " + mebibytes(room) +
                            " beside main scene and textures, less what building the largest part "
                            "takes on each");
}

Result<PagedPlacement> place_paged(const PlacementInput& input) {
  using Placement = Result<PagedPlacement>;
  if (input.hosts.empty()) return Placement::failure("there is no host to hold the scene");
  PlacementInput empty = input;
  for (PlacementHost& h : empty.hosts) h.holds.clear();
  Placer placer(empty);
  std::size_t without = 0;
  if (!placer.set_page_aside(without))
    return Placement::failure("host " + std::to_string(input.hosts[without].host.value) + " may use " +
                              mebibytes(input.hosts[without].memory) +
                              ", which is too little for the main scene and one part at a time; "
                              "a smaller --part-size needs less");
  PagedPlacement result;
  result.paged = placer.hold_visited(input.hosts);
  result.hold = placer.result();
  return result;
}

}  // namespace cloudrenderer
