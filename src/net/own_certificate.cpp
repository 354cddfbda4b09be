#include "net/own_certificate.h"

#include <openssl/evp.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <cstdint>
#include <stdexcept>

namespace cloudrenderer {
namespace {

constexpr long kSecondsPerDay = 86400, kDaysValid = 3650;

template <auto release>
struct Release {
  template <class T>
  void operator()(T* t) const {
    release(t);
  }
};

void require(bool good) {
  if (!good) throw std::runtime_error("OpenSSL cannot make a certificate");
}

}  // namespace

struct OwnCertificate::Parts {
  std::unique_ptr<EVP_PKEY, Release<EVP_PKEY_free>> key{EVP_EC_gen("P-256")};
  std::unique_ptr<X509, Release<X509_free>> certificate{X509_new()};
};

OwnCertificate::OwnCertificate() : parts_(std::make_unique<Parts>()) {
  require(parts_->key && parts_->certificate);
  X509* c = parts_->certificate.get();
  std::int32_t serial = 0;
  require(RAND_bytes(reinterpret_cast<unsigned char*>(&serial), sizeof serial) == 1);
  require(X509_set_version(c, X509_VERSION_3) == 1);
  require(ASN1_INTEGER_set(X509_get_serialNumber(c), (serial & 0x7fffffff) | 1) == 1);
  // Clocks of hosts differ, and renders may be long.
  require(X509_gmtime_adj(X509_getm_notBefore(c), -kSecondsPerDay) != nullptr);
  require(X509_gmtime_adj(X509_getm_notAfter(c), kDaysValid * kSecondsPerDay) != nullptr);
  X509_NAME* name = X509_get_subject_name(c);
  require(X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>("cloudrenderer"),
                                     -1, -1, 0) == 1);
  require(X509_set_issuer_name(c, name) == 1 && X509_set_pubkey(c, parts_->key.get()) == 1);
  require(X509_sign(c, parts_->key.get(), EVP_sha256()) != 0);
}

OwnCertificate::~OwnCertificate() = default;

void OwnCertificate::use(SSL_CTX* context) const {
  require(SSL_CTX_use_certificate(context, parts_->certificate.get()) == 1 &&
          SSL_CTX_use_PrivateKey(context, parts_->key.get()) == 1);
}

}  // namespace cloudrenderer
