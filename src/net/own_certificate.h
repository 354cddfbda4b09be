#pragma once
#include <memory>

// As OpenSSL names it.
typedef struct ssl_ctx_st SSL_CTX;

namespace cloudrenderer {

// A certificate that ends with this process: a P-256 key, signed by itself. It names nobody.
class OwnCertificate {
 public:
  OwnCertificate();  // throws std::runtime_error
  ~OwnCertificate();
  OwnCertificate(const OwnCertificate&) = delete;
  OwnCertificate& operator=(const OwnCertificate&) = delete;

  void use(SSL_CTX* context) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace cloudrenderer
