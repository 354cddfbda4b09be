#include "cluster/local_host.h"

#include <asio/post.hpp>

#include "cluster/worker.h"

namespace cloudrenderer {

LocalHost::LocalHost(asio::io_context& io, const Clock& clock, Manager& manager, Config config)
    : loader_(config.threads, config.memory, {config.manifest, {}, nullptr}) {
  WorkerOptions options;
  options.threads = config.threads;
  options.alpha = config.alpha;
  const std::uint64_t incarnation = new_incarnation();
  const Result<HostId> self = manager.join_local(
      make_hello(incarnation, config.name, config.memory, config.threads, options),
      [this](wire::Message&& m) {
        if (std::holds_alternative<wire::JobEnd>(m)) engine_seconds_ = loader_.engine_seconds();
        if (!std::holds_alternative<wire::Welcome>(m)) node_->receive(HostId{0}, std::move(m));
      });
  if (!self) throw ClusterError(self.error());
  ticker_ = std::make_shared<Ticker>(io, clock, [this] { return node_->tick(); });
  WorkerNode::Callbacks c;
  c.deliver = [&manager, host = *self](HostId, wire::Message&& m) {
    manager.receive_local(host, std::move(m));
  };
  c.deadline = [ticker = ticker_](double t) { ticker->at(t); };
  c.failed = [&io, failed = config.failed](const std::string& why) {
    asio::post(io, [failed, why] { failed(why); });
  };
  c.counters = [this] {
    DriverCounters counters = process_counters();
    counters.drained = true;  // there is no other host
    counters.memory_used = loader_.bytes_used();
    counters.memory_peak = memory_peak_ =
        std::max<std::uint64_t>(memory_peak_, loader_.peak_bytes());
    return counters;
  };
  node_ = std::make_unique<WorkerNode>(*self, incarnation, options, loader_, clock, std::move(c));
  ticker_->at(clock.now());
  manager.drain();
}

LocalHost::~LocalHost() { stop(); }

}  // namespace cloudrenderer
