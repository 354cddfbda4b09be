// What the service says of the hosts that would help.
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "base/log.h"
#include "service/service.h"

namespace cloudrenderer {
namespace {

constexpr double kPlanEvery = 1;

Json or_null(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

}  // namespace

void Service::plan_hosts(double now) {
  if (now >= planned_ && now < planned_ + kPlanEvery) return;
  planned_ = now;
  look_at_frames();
  const std::vector<ElasticHost> hosts = elastic_hosts(host_view_, progress_);
  std::uint64_t largest = 0;
  if (prices_)
    for (const auto& [name, kind] : prices_->kinds())
      if (kind.memory && kind.most.value_or(1) > 0) largest = std::max(largest, *kind.memory);
  scheduler_.set_largest_to_come(largest);
  planned_hosts_ = hosts;
  const std::uint32_t before = hosts_wanted_.wanted();
  hosts_wanted_ = steady_hosts_.settle(
      cloudrenderer::hosts_wanted(elastic_jobs(scheduler_.jobs(), progress_, users_.limits(), config_.scheduler.slots),
                                  host_kinds(prices_, host_view_, seen_kinds_), hosts, config_.elastic, now),
      hosts, now);
  if (hosts_wanted_.wanted() != before) {
    std::string why;
    for (const auto& r : hosts_wanted_.reasons) why += (why.empty() ? "" : "; ") + r.text;
    spdlog::info("hosts wanted: {}, there: {} ({})", hosts_wanted_.wanted(), hosts_wanted_.there(), why);
  }
}

Json Service::hosts_wanted(const Caller& caller) {
  const std::lock_guard lock(mutex_);
  const HostsWanted& w = hosts_wanted_;
  const auto theirs = [&](std::uint64_t id) {
    const Job* job = scheduler_.find(id);
    return caller.admin || (job && job->request.user == caller.name);
  };
  Json kinds = Json::array(), hosts = Json::array(), surplus = Json::array(), reasons = Json::array(), jobs = Json::array();
  for (const auto& k : w.kinds) kinds.push_back({{"kind", k.name}, {"wanted", k.wanted}, {"there", k.there}, {"price_an_hour", k.price}});
  const auto add = [&](Json& list, std::uint64_t id) {
    if (const auto host = host_view_.find(id); host != host_view_.end())
      list.push_back({{"id", fmt::format("{:016x}", id)}, {"name", host->second.name}, {"kind", host->second.kind}});
  };
  for (const ElasticHost& h : planned_hosts_) add(hosts, h.id);
  for (const std::uint64_t id : w.surplus) add(surplus, id);
  for (const auto& r : w.reasons)
    if (!r.job || theirs(*r.job)) reasons.push_back({{"job", r.job ? Json(*r.job) : Json(nullptr)}, {"text", r.text}});
  for (const auto& f : w.jobs)
    if (theirs(f.job))
      jobs.push_back({{"job", f.job}, {"work_s", f.work}, {"measured", f.measured}, {"deadline_at", or_null(f.deadline)},
                      {"ends_at", or_null(f.ends)}, {"ends_at_with_wanted", or_null(f.ends_then)}});
  return {{"wanted", w.wanted()},
          {"there", w.there()},
          {"currency", prices_ ? prices_->currency() : ""},
          {"kinds", std::move(kinds)},
          {"hosts", std::move(hosts)},
          {"surplus", std::move(surplus)},
          {"reasons", std::move(reasons)},
          {"jobs", std::move(jobs)}};
}

void Service::add_wanted(Families& f) const {
  for (const auto& k : hosts_wanted_.kinds) f.gauge("cloudrenderer_service_hosts_wanted", "Hosts that would help, by kind", k.wanted, {{"kind", k.name}});
  for (const auto& k : hosts_wanted_.kinds) f.gauge("cloudrenderer_service_hosts_there", "Hosts that are there, by kind", k.there, {{"kind", k.name}});
  f.gauge("cloudrenderer_service_hosts_surplus", "Hosts that may be ended", static_cast<double>(hosts_wanted_.surplus.size()));
}

}  // namespace cloudrenderer
