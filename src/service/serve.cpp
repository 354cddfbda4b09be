#include "service/serve.h"

#include <asio/io_context.hpp>
#include <asio/ip/host_name.hpp>
#include <asio/post.hpp>
#include <asio/steady_timer.hpp>
#include <chrono>

#include "base/log.h"
#include "cluster/pool.h"
#include "net/own_certificate.h"
#include "service/api.h"
#include "service/pool_hosts.h"
#include "web/http_server.h"

namespace cloudrenderer {
namespace {

constexpr auto kBeat = std::chrono::milliseconds(100);
constexpr auto kGoodbye = std::chrono::seconds(2);

double unix_time() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

// Users are given the certificate once, and so it must be the same when the service is started again.
TlsOptions certified(const ServeConfig& config) {
  TlsOptions tls = config.service.tls;
  if (!encrypts(tls, config.api) || !tls.certificate.empty()) return tls;
  std::vector<std::string> names{config.service.managers_host};
  if (!config.api.is_wildcard() && config.api.host != names.front()) names.push_back(config.api.host);
  std::error_code unknown;
  const std::string machine = asio::ip::host_name(unknown);
  std::vector<std::string> others{"localhost", "127.0.0.1", "::1"};
  if (!unknown && !machine.empty()) others.push_back(machine);
  const CertificateFiles files = kept_certificate(config.service.folder, names, others);
  if (files.made) spdlog::info("made {}, which users need (--service-ca), and its key", files.certificate);
  tls.certificate = files.certificate;
  tls.key = files.key;
  return tls;
}

}  // namespace

void serve(const ServeConfig& config, Users users, std::optional<PriceTable> prices, Interrupts& interrupts,
           const std::function<void(const Serving&)>& ready) {
  asio::io_context io;
  const Clock clock;
  std::shared_ptr<const Tls> tls;
  if (config.service.tls.mode != TlsMode::off) tls = std::make_shared<const Tls>(config.service.tls);
  Pool pool(io, clock, {config.service.token, tls, config.lost_after_s, config.service.allow_inexact, nullptr});
  // Before anybody is listened to: a second service at the same folder ends here.
  Service service(config.service, std::move(users), std::move(prices), [&](const std::string& name) { return std::make_unique<PoolHosts>(pool, name); });
  const Address hosts = pool.listen(config.listen);
  const TlsOptions users_tls = certified(config);
  Api api(service, config.api, users_tls);
  const bool own = config.service.tls.certificate.empty();
  ready({hosts, api.url(config.service.managers_host), own ? users_tls.certificate : ""});
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
