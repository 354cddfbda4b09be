#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "net/address.h"
#include "net/tls.h"
#include "service/service.h"

namespace cloudrenderer {

extern const std::string_view kOpenApi;  // openapi.json

// The service over HTTP: what openapi.json says. Has threads of its own.
class Api {
 public:
  // Port 0 takes a free one. Throws UsageError.
  Api(Service& service, const Address& listen, const TlsOptions& tls);
  ~Api();
  Api(const Api&) = delete;
  Api& operator=(const Api&) = delete;

  // `name`: of this machine, where it listens at all of its addresses.
  std::string url(const std::string& name) const;
  // "GET /v1/jobs/{job}" and so on, all that there are.
  static std::vector<std::string> routes();

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace cloudrenderer
