#include "net/own_certificate.h"

#include <fcntl.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <asio/ip/address.hpp>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "base/error.h"

namespace cloudrenderer {
namespace {

constexpr long kSecondsPerDay = 86400, kDaysValid = 3650, kDaysLeft = 30;

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

using File = std::unique_ptr<std::FILE, Release<std::fclose>>;
using Key = std::unique_ptr<EVP_PKEY, Release<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Release<X509_free>>;

bool is_address(const std::string& name) {
  std::error_code no;
  asio::ip::make_address(name, no);
  return !no;
}

void extend(X509* certificate, int kind, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, certificate, certificate, nullptr, nullptr, 0);
  const std::unique_ptr<X509_EXTENSION, Release<X509_EXTENSION_free>> extension(X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str()));
  require(extension && X509_add_ext(certificate, extension.get(), -1) == 1);
}

void extend_for(X509* certificate, std::span<const std::string> names) {
  std::string all;
  for (const std::string& name : names) {
    // What ends the name, or begins another one, for OpenSSL; an address of one interface is none that others could use.
    if (name.empty() || name.find_first_of(",;% ") != std::string::npos)
      throw UsageError("a certificate cannot name '" + name + "'; another name (--advertise), or a certificate of your own (--tls-cert), can help");
    all += (all.empty() ? "" : ",") + std::string(is_address(name) ? "IP:" : "DNS:") + name;
  }
  extend(certificate, NID_subject_alt_name, all);
  extend(certificate, NID_basic_constraints, "critical,CA:FALSE");
  extend(certificate, NID_key_usage, "critical,digitalSignature");
  extend(certificate, NID_ext_key_usage, "serverAuth");
  extend(certificate, NID_subject_key_identifier, "hash");
}

// By another name first: whoever reads it finds all of it or nothing.
template <class Write>
void save_file(const std::string& path, mode_t mode, Write write) {
  const std::string part = path + ".part";
  std::remove(part.c_str());
  const int descriptor = open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  const File file(descriptor < 0 ? nullptr : fdopen(descriptor, "w"));
  if (!file || !write(file.get()) || std::fflush(file.get()) != 0 || std::rename(part.c_str(), path.c_str()) != 0)
    throw ClusterError(path + " cannot be written: " + std::generic_category().message(errno));
}

bool names(X509* certificate, const std::string& name) {
  return is_address(name) ? X509_check_ip_asc(certificate, name.c_str(), 0) == 1
                          : X509_check_host(certificate, name.data(), name.size(), 0, nullptr) == 1;
}

bool is_good(const CertificateFiles& files, std::span<const std::string> wanted) {
  const File from(std::fopen(files.certificate.c_str(), "r")), key_from(std::fopen(files.key.c_str(), "r"));
  if (!from || !key_from) return false;
  const Certificate certificate(PEM_read_X509(from.get(), nullptr, nullptr, nullptr));
  const Key key(PEM_read_PrivateKey(key_from.get(), nullptr, nullptr, nullptr));
  if (!certificate || !key || X509_check_private_key(certificate.get(), key.get()) != 1) return false;
  std::time_t soon = std::time(nullptr) + kDaysLeft * kSecondsPerDay;
  if (X509_cmp_time(X509_get0_notAfter(certificate.get()), &soon) != 1) return false;
  return std::ranges::all_of(wanted, [&](const std::string& name) { return names(certificate.get(), name); });
}

}  // namespace

struct OwnCertificate::Parts {
  Key key{EVP_EC_gen("P-256")};
  Certificate certificate{X509_new()};
};

OwnCertificate::OwnCertificate(std::span<const std::string> names) : parts_(std::make_unique<Parts>()) {
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
  if (!names.empty()) extend_for(c, names);
  require(X509_sign(c, parts_->key.get(), EVP_sha256()) != 0);
}

OwnCertificate::~OwnCertificate() = default;

void OwnCertificate::use(SSL_CTX* context) const {
  require(SSL_CTX_use_certificate(context, parts_->certificate.get()) == 1 &&
          SSL_CTX_use_PrivateKey(context, parts_->key.get()) == 1);
}

void OwnCertificate::save(const std::string& certificate, const std::string& key) const {
  save_file(key, S_IRUSR | S_IWUSR, [&](std::FILE* f) {
    return PEM_write_PrivateKey(f, parts_->key.get(), nullptr, nullptr, 0, nullptr, nullptr) == 1;
  });
  save_file(certificate, S_IRUSR | S_IWUSR | S_IRGRP | S_IROTH,
            [&](std::FILE* f) { return PEM_write_X509(f, parts_->certificate.get()) == 1; });
}

CertificateFiles kept_certificate(const std::string& folder, std::span<const std::string> names, std::span<const std::string> others) {
  CertificateFiles files{folder + "/certificate.pem", folder + "/certificate-key.pem"};
  if (is_good(files, names)) return files;
  std::vector<std::string> all(names.begin(), names.end());
  all.insert(all.end(), others.begin(), others.end());
  OwnCertificate(all).save(files.certificate, files.key);
  files.made = true;
  return files;
}

}  // namespace cloudrenderer
