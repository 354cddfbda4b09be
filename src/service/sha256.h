#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

namespace cloudrenderer {

// SHA-256 (FIPS 180-4, by OpenSSL) of bytes that come one after another; in small hexadecimal digits.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  void add(std::string_view bytes);
  std::string finish();  // once

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

std::string sha256(std::string_view bytes);
std::string sha256_of_file(const std::string& path);  // throws std::runtime_error
bool is_sha256(std::string_view text);                // 64 small hexadecimal digits

}  // namespace cloudrenderer
