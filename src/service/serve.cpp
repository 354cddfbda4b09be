#include "service/serve.h"

#include <asio/io_context.hpp>
#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>

#include "base/log.h"
#include "cluster/pool.h"
#include "service/api.h"
#include "service/pool_hosts.h"

namespace cloudrenderer {
namespace {

constexpr auto kBeat = std::chrono::milliseconds(100);
constexpr auto kGoodbye = std::chrono::seconds(2);

double unix_time() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

}  // namespace

void serve(const ServeConfig& config, Users users, std::optional<PriceTable> prices, Interrupts& interrupts,
           const std::function<void(const Address& hosts, const std::string& api)>& ready) {
  asio::io_context io;
  const Clock clock;
  std::shared_ptr<const Tls> tls;
  if (config.service.tls.mode != TlsMode::off) tls = std::make_shared<const Tls>(config.service.tls);
  Pool pool(io, clock, {config.service.token, tls, config.lost_after_s, config.service.allow_inexact, nullptr});
  // Before anybody is listened to: a second service at the same folder ends here.
  Service service(config.service, std::move(users), std::move(prices), [&](const std::string& name) { return std::make_unique<PoolHosts>(pool, name); });
  const Address hosts = pool.listen(config.listen);
  Api api(service, config.api, config.service.tls);
  ready(hosts, api.url());
  asio::steady_timer timer(io);
  bool ending = false;
  std::function<void()> beat = [&] {
    if (ending) return;
    service.step(unix_time());
    timer.expires_after(kBeat);
    timer.async_wait([&](const asio::error_code& stopped) {
      if (!stopped) beat();
    });
  };
  beat();
  interrupts.set_handler([&] {
    asio::post(io, [&] {
      ending = true;
      pool.shut();
      timer.expires_after(kGoodbye);  // for hosts that do not listen
      timer.async_wait([&](const asio::error_code&) { io.stop(); });
    });
  });
  io.run();
  interrupts.set_handler(nullptr);
}

}  // namespace cloudrenderer
