#pragma once
#include <functional>
#include <optional>
#include <string>

#include "cluster/interrupts.h"
#include "service/service.h"

namespace cloudrenderer {

struct ServeConfig {
  ServiceConfig service;
  Address listen, api;  // of workers, of users
  double lost_after_s = 3;
};

// Serves until it is interrupted. `ready` is told where workers and users are awaited. Throws UsageError, ClusterError.
void serve(const ServeConfig& config, Users users, std::optional<PriceTable> prices, Interrupts& interrupts,
           const std::function<void(const Address& hosts, const std::string& api)>& ready);

}  // namespace cloudrenderer
