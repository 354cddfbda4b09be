#include "tasks/placement.h"

#include <algorithm>
#include <bit>
#include <numeric>
#include <set>

#include "base/random.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kNobody = ~std::size_t{0};

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
      add(h, 0);
      for (const PartId p : in.hosts[h].holds)
        if (p.value != 0) add(h, p.value);
    }
    total_memory_ = std::accumulate(
        in.hosts.begin(), in.hosts.end(), 0.0,
        [](double sum, const PlacementHost& h) { return sum + static_cast<double>(h.memory); });
    for (std::size_t p = 1; p < in.parts.size(); ++p) {
      order_.push_back(p);
      total_bytes_ += static_cast<double>(in.parts[p].bytes);
    }
    // Largest first, by powers of two, so that parts of about one size keep their spatial order.
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
      return std::bit_width(in.parts[a].bytes) > std::bit_width(in.parts[b].bytes);
    });
  }

  // What every host must hold, while it is built.
  std::uint64_t main_bytes() const { return cost({}, 0) + in_.parts[0].build; }

  // One more copy of every part that has not more than `copy` of them. False if some part found no
  // room.
  bool pass(std::uint32_t copy, bool neighbours) {
    bool all = true;
    std::size_t last = kNobody;
    for (const std::size_t p : order_) {
      if (copies_[p] > copy) continue;
      const std::size_t h = neighbours ? choose(p, copy, last) : roomiest(p);
      last = h;
      if (h == kNobody)
        all = false;
      else
        add(h, p);
    }
    return all;
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
    host.has[p] = true;
    ++copies_[p];
  }
  bool can_take(std::size_t h, std::size_t p) const {
    const Host& host = hosts_[h];
    if (host.has[p] || host.cannot[p]) return false;
    return host.used + cost(host, p) + std::max(host.build, in_.parts[p].build) <=
           in_.hosts[h].memory;
  }
  // What a host holds when `copies` of everything are spread by memory, with a little slack.
  bool balanced(std::size_t h, std::size_t p, std::uint32_t copies) const {
    const double share = static_cast<double>(in_.hosts[h].memory) / std::max(1.0, total_memory_);
    const double limit =
        share * total_bytes_ * copies + 0.5 * static_cast<double>(in_.parts[p].bytes);
    const double here =
        static_cast<double>(hosts_[h].used) - static_cast<double>(in_.parts[0].bytes);
    return here + 0.5 * static_cast<double>(in_.parts[p].bytes) <= limit;
  }
  std::size_t choose(std::size_t p, std::uint32_t copy, std::size_t last) const {
    if (last != kNobody && can_take(last, p) && balanced(last, p, copy + 1))
      return last;  // beside its neighbour
    std::size_t best = kNobody;
    std::pair<bool, std::uint64_t> best_rank{};
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      if (!can_take(h, p)) continue;
      const std::uint64_t dice =
          mix64(in_.seed ^ mix64((std::uint64_t{in_.hosts[h].host.value} << 32) + p) ^ copy);
      const std::pair rank{balanced(h, p, copy + 1), dice};
      if (best != kNobody && rank <= best_rank) continue;
      best = h;
      best_rank = rank;
    }
    return best;
  }
  std::size_t roomiest(std::size_t p) const {
    std::size_t best = kNobody;
    std::uint64_t most = 0;
    for (std::size_t h = 0; h < hosts_.size(); ++h) {
      if (!can_take(h, p)) continue;
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
  double total_memory_ = 0, total_bytes_ = 0;
};

}  // namespace

Result<std::vector<std::vector<PartId>>> place(const PlacementInput& input) {
  using Placement = Result<std::vector<std::vector<PartId>>>;
  if (input.hosts.empty()) return Placement::failure("there is no host to hold the scene");
  const auto copies = static_cast<std::uint32_t>(
      std::min<std::size_t>(std::max(1u, input.min_replication), input.hosts.size()));
  std::uint64_t needed = 0, room = 0;
  for (std::size_t p = 1; p < input.parts.size(); ++p) needed += input.parts[p].bytes;
  for (const bool neighbours : {true, false}) {
    Placer placer(input);
    room = 0;
    for (std::size_t h = 0; h < input.hosts.size(); ++h) {
      if (placer.main_bytes() > input.hosts[h].memory)
        return Placement::failure("host " + std::to_string(input.hosts[h].host.value) +
                                  " may use " + mebibytes(input.hosts[h].memory) +
                                  ", but what every host must hold needs " +
                                  mebibytes(placer.main_bytes()));
      room += input.hosts[h].memory - placer.main_bytes();
    }
    bool all = true;
    for (std::uint32_t c = 0; c < copies && all; ++c) all = placer.pass(c, neighbours);
    if (!all) continue;
    // What is left of the memory saves moves.
    for (auto c = copies; c < input.hosts.size(); ++c) placer.pass(c, neighbours);
    return placer.result();
  }
  return Placement::failure("the parts need " + mebibytes(needed * copies) + " (" +
                            std::to_string(copies) + (copies == 1 ? " copy" : " copies") +
                            "), the hosts have room for " + mebibytes(room) +
                            " beside main scene and textures, less what building the largest part "
                            "takes on each");
}

}  // namespace cloudrenderer
