#include <spdlog/fmt/fmt.h>

#include <chrono>

#include "cli/commands.h"
#include "service/api.h"
#include "service/serve.h"

namespace cloudrenderer {

int run_serve(const ServeOptions& o, Interrupts& interrupts) {
  if (o.users.empty() && o.config.token.empty())
    throw UsageError("a service needs --users, or a token (--token-file, CLOUDRENDERER_TOKEN) that its only user has");
  if (o.users.empty() && !o.api.is_loopback())
    throw UsageError("--api " + o.api.to_string() + ": without --users only the machine itself may ask: an address of the loopback");
  if (!o.listen.is_loopback() && o.config.token.empty() && o.config.tls.authority.empty())
    throw UsageError("--listen " + o.listen.to_string() + ": workers and others need the same token (--token-file, CLOUDRENDERER_TOKEN)");
  Users users = o.users.empty() ? Users::only(o.config.token) : Users::from_file(o.users);
  std::optional<PriceTable> prices;
  if (!o.prices.empty()) prices = PriceTable::read(o.prices);
  serve({o.config, o.listen, o.api, o.lost_after_s}, std::move(users), std::move(prices), interrupts, [](const Serving& s) {
    fmt::print("listening on {}\n{} is for users\n", s.hosts.to_string(), s.api);
    if (!s.certificate.empty()) fmt::print("{} is what they trust it by (--service-ca, CLOUDRENDERER_SERVICE_CA)\n", s.certificate);
    std::fflush(stdout);
  });
  return kDone;
}

}  // namespace cloudrenderer
