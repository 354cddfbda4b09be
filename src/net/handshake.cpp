#include "net/handshake.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "base/error.h"

namespace cloudrenderer {
namespace {

constexpr std::size_t kNonceBytes = 32, kMaxNonceBytes = 64;

constexpr const char* kTokenVariable = "CLOUDRENDERER_TOKEN";

std::string hmac_sha256(const std::string& key, const std::string& text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned int length = 0;
  if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
           reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(),
           &length) == nullptr)
    throw std::runtime_error("HMAC-SHA256 failed");
  return {reinterpret_cast<const char*>(digest.data()), length};
}

}  // namespace

Handshake::Handshake(Role role, const std::string& secret, const std::string& channel_binding)
    : role_(role), key_(secret), nonce_(kNonceBytes, '\0') {
  // A key of its own, not more text: a peer chooses its nonce, and could write a channel into it.
  if (!secret.empty() && !channel_binding.empty())
    key_ = hmac_sha256(secret, "tls-exporter" + channel_binding);
  answered_ = role == Role::accepts;
  if (RAND_bytes(reinterpret_cast<unsigned char*>(nonce_.data()),
                 static_cast<int>(nonce_.size())) != 1)
    throw std::runtime_error("no random numbers from the system");
}

std::vector<wire::Message> Handshake::begin() {
  wire::Challenge c;
  c.set_nonce(nonce_);
  return {c};
}

Result<std::vector<wire::Message>> Handshake::receive(const wire::Message& message) {
  using Answer = Result<std::vector<wire::Message>>;
  if (const auto* challenge = std::get_if<wire::Challenge>(&message)) {
    if (challenge->nonce().size() < kNonceBytes || challenge->nonce().size() > kMaxNonceBytes)
      return Answer::failure("its challenge has a wrong length");
    wire::Proof proof;
    proof.set_code(code(role_, challenge->nonce()));
    answered_ = true;
    return std::vector<wire::Message>{proof};
  }
  if (const auto* proof = std::get_if<wire::Proof>(&message)) {
    const std::string expected =
        code(role_ == Role::accepts ? Role::connects : Role::accepts, nonce_);
    if (proof->code().size() != expected.size() ||
        CRYPTO_memcmp(proof->code().data(), expected.data(), expected.size()) != 0)
      return Answer::failure("it does not know the cluster's secret (--token-file)");
    proved_ = true;
    return std::vector<wire::Message>{};
  }
  return Answer::failure(std::string("it sent ") + wire::message_name(message) +
                         " before it had proved who it is");
}

std::string Handshake::code(Role role, const std::string& nonce) const {
  if (key_.empty()) return {};
  return hmac_sha256(key_, (role == Role::connects ? "connects" : "accepts") + nonce);
}

std::string read_token(const std::string& path) {
  std::string token, where;
  if (!path.empty()) {
    where = "the token file " + path;
    std::ifstream in(path, std::ios::binary);
    if (!in) throw UsageError("cannot read " + where);
    token.assign(std::istreambuf_iterator<char>(in), {});
  } else if (const char* variable = std::getenv(kTokenVariable)) {
    where = kTokenVariable;
    token = variable;
  } else {
    return {};
  }
  const auto first = token.find_first_not_of(" \t\r\n");
  if (first == std::string::npos) throw UsageError(where + " is empty");
  return token.substr(first, token.find_last_not_of(" \t\r\n") - first + 1);
}

}  // namespace cloudrenderer
