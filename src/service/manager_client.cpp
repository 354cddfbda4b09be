#include "service/manager_client.h"

namespace cloudrenderer {

std::unique_ptr<httplib::Client> manager_client(const std::string& url, const std::string& token) {
  auto client = std::make_unique<httplib::Client>(url.substr(0, url.find('/', url.find("//") + 2)));
  client->enable_server_certificate_verification(false);  // it is our child, on the loopback
  if (!token.empty()) client->set_bearer_token_auth(token.c_str());
  return client;
}

}  // namespace cloudrenderer
