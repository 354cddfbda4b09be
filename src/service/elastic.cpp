#include "service/elastic.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

namespace cloudrenderer {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kInTime = 0.9;     // of the time that a deadline leaves
constexpr double kMostWork = 1e15;  // seconds: sums stay finite

std::string memory_text(std::uint64_t bytes) {
  const double mebibytes = static_cast<double>(bytes) / (1 << 20);
  return mebibytes < 8192 ? fmt::format("{:.4g} MiB", mebibytes) : fmt::format("{:.4g} GiB", mebibytes / 1024);
}
std::string hosts_text(std::size_t n) { return fmt::format("{} host{}", n, n == 1 ? "" : "s"); }

double finite_work(double work) { return work > 0 ? std::min(work, kMostWork) : 0; }

class Planner {
 public:
  Planner(const std::vector<ElasticJob>& jobs, const std::vector<HostKind>& kinds, const std::vector<ElasticHost>& hosts,
          const ElasticLimits& limits, double now)
      : jobs_(jobs), kinds_(kinds), can_be_had_(kinds.size(), true), limits_(limits), now_(now) {
    for (const ElasticHost& h : hosts) {
      there_.push_back({&h, kind_of(h.kind)});
      if (there_.back().kind < kinds_.size()) continue;
      kinds_.emplace_back().name = h.kind;
      can_be_had_.push_back(false);
    }
    // First those that are to stay.
    std::ranges::sort(there_, [&](const There& a, const There& b) {
      const auto key = [&](const There& t) {
        return std::tuple(t.host->lone_parts, t.host->frames, t.host->loaded, -cost(kinds_[t.kind]), ~t.host->id);
      };
      return key(a) > key(b);
    });
    fleet_ = {std::vector<char>(there_.size(), 0), std::vector<std::uint32_t>(kinds_.size(), 0)};
  }

  HostsWanted plan() {
    if (jobs_.empty()) out_.reasons.push_back({{}, "nothing to do"});
    clip_to_budgets();
    least_hosts();
    for (std::size_t i = 0; i < jobs_.size(); ++i) memory_for(jobs_[i], i < limits_.jobs_at_once);
    undated_jobs();
    dated_jobs();
    const Fleet there{std::vector<char>(there_.size(), 1), std::vector<std::uint32_t>(kinds_.size(), 0)};
    const auto now = forecast(jobs_, groups(there), limits_.jobs_at_once), then = forecast(jobs_, groups(fleet_), limits_.jobs_at_once);
    tell_dated(now, then);
    if (limited_)
      out_.reasons.push_back({{}, total(fleet_) >= limits_.most ? fmt::format("no more than {} are allowed", hosts_text(limits_.most))
                                                                : "more would help; no more of their kinds are allowed"});
    return answer(now, then);
  }

 private:
  struct There {
    const ElasticHost* host;
    std::size_t kind;
  };
  struct Fleet {  // what is wanted so far
    std::vector<char> kept;            // of there_
    std::vector<std::uint32_t> fresh;  // new ones, by kind
  };
  struct Run {  // hosts that may be taken next
    std::optional<std::size_t> host;  // of there_; else new ones
    std::size_t kind = 0;
    std::uint32_t count = 1;
  };
  enum class By { compute, memory };

  std::size_t kind_of(const std::string& name) const {
    return static_cast<std::size_t>(std::ranges::find(kinds_, name, &HostKind::name) - kinds_.begin());
  }
  static double cost(const HostKind& k) { return k.price / k.capacity(); }
  double capacity(const There& t) const { return std::max(1e-9, t.host->threads * kinds_[t.kind].speed); }

  std::uint32_t count(const Fleet& f, std::size_t kind) const {
    std::uint32_t n = f.fresh[kind];
    for (std::size_t i = 0; i < there_.size(); ++i) n += f.kept[i] && there_[i].kind == kind;
    return n;
  }
  std::uint32_t total(const Fleet& f) const {
    return static_cast<std::uint32_t>(std::ranges::count(f.kept, 1)) + std::accumulate(f.fresh.begin(), f.fresh.end(), 0u);
  }
  double capacity(const Fleet& f) const {
    double sum = 0;
    for (std::size_t i = 0; i < there_.size(); ++i) sum += f.kept[i] ? capacity(there_[i]) : 0;
    for (std::size_t k = 0; k < kinds_.size(); ++k) sum += f.fresh[k] * kinds_[k].capacity();
    return sum;
  }

  // What is there and not taken yet, then what can be had, the cheapest first, as far as the limits let it.
  template <class Wanted>
  std::vector<Run> runs(const Wanted& wanted, By by = By::compute) {
    std::vector<Run> out;
    std::vector<std::uint32_t> left(kinds_.size());
    for (std::size_t k = 0; k < kinds_.size(); ++k) left[k] = kinds_[k].most - std::min(kinds_[k].most, count(fleet_, k));
    std::uint32_t all = limits_.most - std::min(limits_.most, total(fleet_));
    for (std::size_t i = 0; i < there_.size(); ++i) {
      if (fleet_.kept[i] || !wanted(there_[i].host->memory, there_[i].kind) || left[there_[i].kind] == 0 || all == 0) continue;
      out.push_back({i, there_[i].kind, 1});
      --left[there_[i].kind];
      --all;
    }
    std::vector<std::size_t> order(kinds_.size());
    std::iota(order.begin(), order.end(), 0);
    std::ranges::sort(order, [&](std::size_t a, std::size_t b) {
      const auto key = [&](const HostKind& k) {
        const double use = by == By::compute ? k.capacity() : static_cast<double>(std::max<std::uint64_t>(k.memory, 1));
        return std::tuple(k.price / use, -use, k.name);
      };
      return key(kinds_[a]) < key(kinds_[b]);
    });
    for (const std::size_t k : order) {
      const std::uint32_t n = can_be_had_[k] && wanted(kinds_[k].memory, k) ? std::min(left[k], all) : 0;
      if (n > 0) out.push_back({std::nullopt, k, n});
      all -= n;
    }
    return out;
  }
  static std::uint32_t length(const std::vector<Run>& runs) {
    std::uint32_t n = 0;
    for (const Run& r : runs) n += r.count;
    return n;
  }
  Fleet with(const std::vector<Run>& more, std::uint32_t n) const {
    Fleet f = fleet_;
    for (const Run& r : more) {
      const std::uint32_t taken = std::min(n, r.count);
      if (r.host)
        f.kept[*r.host] = f.kept[*r.host] || taken > 0;
      else
        f.fresh[r.kind] += taken;
      n -= taken;
    }
    return f;
  }
  void take(const std::vector<Run>& more, std::uint64_t n) {
    if (n > length(more)) limited_ = true;
    fleet_ = with(more, static_cast<std::uint32_t>(std::min<std::uint64_t>(n, length(more))));
  }

  std::vector<HostGroup> groups(const Fleet& f) const {
    std::map<std::pair<std::uint64_t, double>, double> sums;
    for (std::size_t i = 0; i < there_.size(); ++i)
      if (f.kept[i]) sums[{there_[i].host->memory, 0}] += capacity(there_[i]);
    for (std::size_t k = 0; k < kinds_.size(); ++k)
      if (f.fresh[k] > 0) sums[{kinds_[k].memory, limits_.start_s}] += f.fresh[k] * kinds_[k].capacity();
    std::vector<HostGroup> out;
    for (const auto& [key, sum] : sums) out.push_back({sum, key.first, key.second});
    return out;
  }

  void clip_to_budgets() {
    double price = kNever;  // of a second of a thread
    for (std::size_t k = 0; k < kinds_.size(); ++k)
      if (can_be_had_[k] || std::ranges::any_of(there_, [&](const There& t) { return t.kind == k; })) price = std::min(price, cost(kinds_[k]) / 3600);
    for (ElasticJob& job : jobs_) {
      job.work = finite_work(job.work);
      if (!job.money || price <= 0 || price == kNever) continue;
      const double paid = std::max(0.0, *job.money) / price;
      if (paid >= job.work) continue;
      out_.reasons.push_back({job.id, fmt::format("the budget of job {} pays for {:.0f} of the {:.0f} s of processors that it has left", job.id, paid, job.work)});
      job.work = paid;
    }
  }

  void least_hosts() {
    const auto any = [](std::uint64_t, std::size_t) { return true; };
    for (std::size_t k = 0; k < kinds_.size(); ++k) {
      const std::uint32_t there = count(fleet_, k);
      if (kinds_[k].least > there) take(runs([k](std::uint64_t, std::size_t kind) { return kind == k; }), kinds_[k].least - there);
    }
    if (total(fleet_) < limits_.least) take(runs(any), limits_.least - total(fleet_));
    if (total(fleet_) > 0) out_.reasons.push_back({{}, fmt::format("{} {} kept always", hosts_text(total(fleet_)), total(fleet_) == 1 ? "is" : "are")});
  }

  // The room that a host has for parts of the job.
  static double room(const ElasticJob& job, std::uint64_t memory) {
    if (memory == 0) return kNever;
    const double given = std::max(static_cast<double>(memory) * job.memory_part, static_cast<double>(job.least_memory));
    return job.fits(memory) ? std::max(0.0, given - static_cast<double>(job.main_bytes)) : 0;
  }

  void memory_for(const ElasticJob& job, bool now) {
    if (job.work <= 0) return;
    std::uint32_t fitting = 0;
    double there = 0;
    for (std::size_t i = 0; i < there_.size(); ++i)
      if (fleet_.kept[i] && job.fits(there_[i].host->memory)) ++fitting, there += room(job, there_[i].host->memory);
    for (std::size_t k = 0; k < kinds_.size(); ++k)
      if (fleet_.fresh[k] > 0 && job.fits(kinds_[k].memory)) fitting += fleet_.fresh[k], there += fleet_.fresh[k] * room(job, kinds_[k].memory);
    const std::uint32_t before = total(fleet_);
    std::vector<Run> more = runs([&](std::uint64_t memory, std::size_t) { return job.fits(memory); }, By::memory);
    double missing = now ? static_cast<double>(job.bytes - std::min(job.bytes, job.main_bytes)) - there : 0;
    std::uint64_t n = 0;
    for (const Run& r : more) {
      if (missing <= 0) break;
      const double each = room(job, r.host ? there_[*r.host].host->memory : kinds_[r.kind].memory);
      const double wanted = each > 0 ? std::max(1.0, std::ceil(missing / each)) : 0;
      const auto taken = static_cast<std::uint32_t>(std::min<double>(r.count, wanted));
      n += each > 0 ? taken : r.count;  // what has no room lies on the way
      missing -= taken > 0 ? taken * each : 0;
    }
    if (fitting == 0) n = std::max<std::uint64_t>(n, 1);
    limited_ = limited_ || missing > 0;
    if (n == 0) return;
    take(more, n);
    const std::uint32_t got = total(fleet_) - before;
    if (fitting + got == 0)
      out_.reasons.push_back({job.id, fmt::format("job {} needs a host with {} of memory; none that is allowed has it", job.id, memory_text(job.least_memory))});
    else if (now && job.bytes > 0 && fitting + got > 1)
      out_.reasons.push_back({job.id, fmt::format("job {} needs {} for its {} of parts", job.id, hosts_text(fitting + got), memory_text(job.bytes))});
    else
      out_.reasons.push_back({job.id, fmt::format("job {} needs a host{}", job.id, job.least_memory > 0 ? " with " + memory_text(job.least_memory) + " of memory" : "")});
  }

  void undated_jobs() {
    double work = 0, threads = 0;
    std::uint32_t jobs = 0;
    std::uint64_t memory = std::numeric_limits<std::uint64_t>::max();
    std::optional<std::uint64_t> first;
    for (const ElasticJob& job : jobs_) {
      if (job.deadline || job.work <= 0) continue;
      work += job.work;
      if (jobs < limits_.jobs_at_once) threads += job.most_threads;
      memory = std::min(memory, job.least_memory);
      if (!first) first = job.id;
      ++jobs;
    }
    if (jobs == 0) return;
    const std::vector<Run> more = runs([&](std::uint64_t m, std::size_t) { return m == 0 || m >= memory; });
    double there = capacity(fleet_);
    std::uint64_t n = 0;
    bool all = false;  // that could be used
    for (const Run& r : more) {
      const double each = r.host ? capacity(there_[*r.host]) : kinds_[r.kind].capacity();
      double use = std::ceil((threads - there) / each);
      if (!r.host) use = std::min(use, std::floor((work / limits_.worth_s - there) / each * (1 + 1e-12)));
      const auto taken = static_cast<std::uint32_t>(std::clamp<double>(use, 0, r.count));
      n += taken;
      there += taken * each;
      if (taken < r.count) {
        all = true;
        break;
      }
    }
    take(more, n);
    limited_ = limited_ || (!all && there < threads && work / limits_.worth_s > there + 1);
    const std::string who = jobs == 1 ? fmt::format("job {} has", *first) : fmt::format("{} jobs without a deadline have", jobs);
    out_.reasons.push_back({jobs == 1 ? first : std::nullopt,
                            fmt::format("{} {:.0f} s of processors to do: {:.0f} s for each thread of {}", who, work, there > 0 ? work / there : 0, hosts_text(total(fleet_)))});
  }

  // Seconds by which the worst job with a deadline is late; with a margin.
  double lateness(const Fleet& f, double in_time) const {
    const std::vector<double> ends = forecast(jobs_, groups(f), limits_.jobs_at_once);
    double worst = -kNever;
    for (std::size_t i = 0; i < jobs_.size(); ++i)
      if (jobs_[i].deadline && jobs_[i].work > 0) worst = std::max(worst, ends[i] - std::max(0.0, *jobs_[i].deadline - now_) * in_time);
    return worst;
  }

  void dated_jobs() {
    double work = 0;
    std::uint64_t memory = std::numeric_limits<std::uint64_t>::max();
    for (const ElasticJob& job : jobs_)
      if (job.deadline && job.work > 0) work += job.work, memory = std::min(memory, job.least_memory);
    if (work <= 0) return;
    if (lateness(fleet_, kInTime) <= 0) return;
    const std::vector<Run> more = runs([&](std::uint64_t m, std::size_t) { return m == 0 || m >= memory; });
    const auto late = [&](std::uint32_t n) { return lateness(with(more, n), kInTime); };
    // The fewest for which it holds; it holds for `most`, and for all beyond the first.
    const auto fewest = [](std::uint32_t most, const auto& holds) {
      std::uint32_t low = 0;
      while (low < most) {
        const std::uint32_t middle = low + (most - low) / 2;
        if (holds(middle))
          most = middle;
        else
          low = middle + 1;
      }
      return most;
    };
    const std::uint32_t most = length(more);
    const double best = late(most);
    std::uint32_t n = fewest(most, [&](std::uint32_t k) { return late(k) <= std::max(0.0, best + 1); });
    if (best > 0) {  // hopeless: as many as have more to do than their start takes
      const auto idle = [&](std::uint32_t k) { return work / std::max(capacity(with(more, k)), 1e-9) < limits_.start_s; };
      std::uint32_t free = 0;
      for (const Run& r : more) free += r.host.has_value();
      if (idle(n)) n = std::max(std::min(n, free), fewest(n, idle) - (fewest(n, idle) > 0));
      limited_ = limited_ || n == most;
    }
    take(more, n);
  }

  // When jobs end, with the hosts that are there and with those that are wanted.
  void tell_dated(const std::vector<double>& now, const std::vector<double>& then) {
    for (std::size_t i = 0; i < jobs_.size(); ++i) {
      const ElasticJob& job = jobs_[i];
      if (!job.deadline || job.work <= 0) continue;
      const double left = *job.deadline - now_;
      const auto misses = [&](double end, const std::string& with_what) {
        return end == kNever ? fmt::format("job {} cannot begin {}", job.id, with_what)
                             : fmt::format("job {} misses its deadline by {:.0f} s {}", job.id, end - left, with_what);
      };
      if (then[i] > left)
        out_.reasons.push_back({job.id, misses(then[i], "even with " + hosts_text(total(fleet_)))});
      else if (now[i] > left)
        out_.reasons.push_back({job.id, misses(now[i], "with " + hosts_text(there_.size()))});
      else
        out_.reasons.push_back({job.id, fmt::format("job {} meets its deadline with {:.0f} s to spare with {}", job.id, left - then[i], hosts_text(total(fleet_)))});
    }
  }

  HostsWanted answer(const std::vector<double>& now, const std::vector<double>& then) {
    std::map<std::string, HostsWanted::Kind> kinds;
    for (std::size_t k = 0; k < kinds_.size(); ++k) kinds[kinds_[k].name] = {kinds_[k].name, count(fleet_, k), 0, kinds_[k].price};
    for (const There& t : there_) ++kinds.at(kinds_[t.kind].name).there;
    for (auto& [name, kind] : kinds) out_.kinds.push_back(kind);
    for (std::size_t i = there_.size(); i-- > 0;)
      if (!fleet_.kept[i]) out_.surplus.push_back(there_[i].host->id);
    const auto at = [&](double s) { return s < kNever ? std::optional(now_ + s) : std::nullopt; };
    for (std::size_t i = 0; i < jobs_.size(); ++i)
      out_.jobs.push_back({jobs_[i].id, jobs_[i].work, jobs_[i].measured, jobs_[i].deadline, at(now[i]), at(then[i])});
    return std::move(out_);
  }

  std::vector<ElasticJob> jobs_;
  std::vector<HostKind> kinds_;  // those of hosts that are there at the end
  std::vector<char> can_be_had_;
  const ElasticLimits& limits_;
  const double now_;
  std::vector<There> there_;
  Fleet fleet_;
  HostsWanted out_;
  bool limited_ = false;
};

}  // namespace

std::uint32_t HostsWanted::wanted() const {
  std::uint32_t n = 0;
  for (const Kind& k : kinds) n += k.wanted;
  return n;
}

std::uint32_t HostsWanted::there() const {
  std::uint32_t n = 0;
  for (const Kind& k : kinds) n += k.there;
  return n;
}

HostsWanted hosts_wanted(const std::vector<ElasticJob>& jobs, const std::vector<HostKind>& kinds, const std::vector<ElasticHost>& hosts,
                         const ElasticLimits& limits, double now) {
  return Planner(jobs, kinds, hosts, limits, now).plan();
}

HostsWanted SteadyHosts::settle(HostsWanted wanted, const std::vector<ElasticHost>& hosts, double now) {
  if (!began_) began_ = now;
  const bool just_begun = now < *began_ + limits_.idle_s;  // nobody knows what was wanted before
  std::uint32_t all = 0, kept = 0;
  for (HostsWanted::Kind& kind : wanted.kinds) {
    std::deque<Said>& said = said_[kind.name];
    for (Said& s : said) s.at = std::min(s.at, now);  // clocks may go back
    while (!said.empty() && said.front().at < now - limits_.idle_s) said.pop_front();
    while (!said.empty() && said.back().wanted <= kind.wanted) said.pop_back();
    said.push_back({now, kind.wanted});
    // What was wanted and has not come is not kept up.
    const std::uint32_t most = std::max(kind.wanted, just_begun ? kind.there : std::min(said.front().wanted, kind.there));
    kept += most - kind.wanted;
    kind.wanted = most;
    all += most;
  }
  // Where one kind has taken another's place both together may be too many.
  for (HostsWanted::Kind& kind : wanted.kinds) {
    const std::uint32_t over = all - std::min(all, limits_.most), less = std::min({over, kind.wanted, kept});
    kind.wanted -= less;
    all -= less;
    kept -= less;
  }
  if (kept > 0) wanted.reasons.push_back({{}, fmt::format("{} more {} kept until {:.0f} s after they were last wanted", kept, kept == 1 ? "is" : "are", limits_.idle_s)});
  std::map<std::string, std::uint32_t> over;
  for (const HostsWanted::Kind& kind : wanted.kinds) over[kind.name] = kind.there - std::min(kind.there, kind.wanted);
  std::map<std::uint64_t, std::string> kind_of;
  for (const ElasticHost& h : hosts) kind_of[h.id] = h.kind;
  std::erase_if(wanted.surplus, [&](std::uint64_t id) {
    std::uint32_t& n = over[kind_of[id]];
    if (n == 0) return true;
    --n;
    return false;
  });
  return wanted;
}

}  // namespace cloudrenderer
