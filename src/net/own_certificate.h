#pragma once
#include <memory>
#include <span>
#include <string>

// As OpenSSL names it.
typedef struct ssl_ctx_st SSL_CTX;

namespace cloudrenderer {

// A certificate that ends with this process, unless it is saved: a P-256 key, signed by itself. Throws std::runtime_error.
class OwnCertificate {
 public:
  OwnCertificate() : OwnCertificate(std::span<const std::string>()) {}  // of nobody
  // Of a server with these names (hosts, IP addresses), for those who have the certificate and trust it. Throws UsageError, too.
  explicit OwnCertificate(std::span<const std::string> names);
  ~OwnCertificate();
  OwnCertificate(const OwnCertificate&) = delete;
  OwnCertificate& operator=(const OwnCertificate&) = delete;

  void use(SSL_CTX* context) const;
  // PEM files, one after the other replaced as a whole; the key is for nobody else to read. Throws ClusterError that names the file.
  void save(const std::string& certificate, const std::string& key) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

struct CertificateFiles {
  std::string certificate, key;  // PEM
  bool made = false;             // just now
};

// A server's own certificate that outlives it: certificate.pem and certificate-key.pem in the folder. They are made where
// they are not there, do not belong together, will end within 30 days, or do not name all of `names`; then they name the `others`, too.
CertificateFiles kept_certificate(const std::string& folder, std::span<const std::string> names, std::span<const std::string> others);

}  // namespace cloudrenderer
