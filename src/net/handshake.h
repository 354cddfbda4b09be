#pragma once
#include <string>
#include <vector>

#include "wire/messages.h"

namespace cloudrenderer {

// Both ends of a new connection prove that they know the shared secret, without saying it
// (HMAC-SHA256 of the other's random challenge; the code of the connecting and of the accepting end
// differ, so that none can be played back). On an encrypted connection the key is one of the secret
// and of the channel: whoever decrypts in between has another channel to either side, and cannot
// pass a proof on. A value: the session's owner feeds it what arrives and sends what it gives.
// Without a secret the codes are empty.
class Handshake {
 public:
  enum class Role { connects, accepts };
  Handshake(Role role, const std::string& secret, const std::string& channel_binding = {});

  std::vector<wire::Message> begin();  // to be sent first
  // A message that arrived before done(). The answer is to be sent; a failure closes the
  // connection.
  Result<std::vector<wire::Message>> receive(const wire::Message& message);
  bool done() const { return proved_ && answered_; }

 private:
  std::string code(Role role, const std::string& nonce) const;

  Role role_;
  std::string key_, nonce_;
  bool proved_ = false;    // the peer knows the secret
  bool answered_ = false;  // the peer's challenge; one that connects need not challenge
};

// The shared secret: of the file if one is named, else of the environment (CLOUDRENDERER_TOKEN),
// else "". White space at the ends is removed. Throws UsageError when it is empty or unreadable.
std::string read_token(const std::string& path);

}  // namespace cloudrenderer
