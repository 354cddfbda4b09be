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

// Where workers and users are awaited.
struct Serving {
  Address hosts;
  std::string api;          // an address for browsers
  std::string certificate;  // PEM file of the one that the service has made for itself; "": of another one, or none
};

// Serves until it is interrupted. Throws UsageError, ClusterError.
void serve(const ServeConfig& config, Users users, std::optional<PriceTable> prices, Interrupts& interrupts,
           const std::function<void(const Serving&)>& ready);

}  // namespace cloudrenderer
