#pragma once
// What the window of a render and the service's API have in common.
#include <httplib.h>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "net/address.h"
#include "net/tls.h"

namespace cloudrenderer {

// Whether what listens there speaks TLS: automatic means all but the loopback.
bool encrypts(const TlsOptions& tls, const Address& listen);
// With threads, timeouts, socket options and headers as all of ours have them, and answers where the library refuses by
// itself. A request of which something may be left unread ends its connection. `option` names the address in messages.
// Throws UsageError when the certificate cannot be used.
std::unique_ptr<httplib::Server> make_http_server(const TlsOptions& tls, bool encrypted, std::size_t threads, const std::string& option);
// The port that it listens on. Throws UsageError.
int bind_http(httplib::Server& server, const Address& listen, const std::string& option);

void answer_json(httplib::Response& response, const nlohmann::ordered_json& json);
// Without holding it in memory; false: there is no such file.
bool send_file(httplib::Response& response, const std::string& path, const char* type);
void refuse(httplib::Response& response, int status, const std::string& why);
// When this is the answer; for who answers without having read the whole body.
void end_connection(httplib::Response& response);

bool same_secret(const std::string& a, const std::string& b);  // takes the same time wherever they differ
std::string host_of(const std::string& host_header);            // without the port

}  // namespace cloudrenderer
